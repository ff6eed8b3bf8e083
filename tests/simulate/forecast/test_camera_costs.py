"""What a plan knows of cameras without running any code, and what it says that they cost."""

import os
from pathlib import Path

import pytest

from specs.data.episode import ApplicationLaunch
from tasks.simulate.forecast.camera_costs import CameraPlan, Driven, camera_plans
from tasks.simulate.host.declaration import ControllerKind
from tests.repository import ROOT

LAUNCH = ApplicationLaunch(name="r", version="1", digest="0" * 64, package="nav", launch_file="nav")
CLASS = """
class Eye:
    columns, rows = 160, 120
    rate_hz: float = 10.0


class Seer:
    def __init__(self):
        self.{kind} = {made}
"""


def planned(
    folder: Path, files: dict[str, str], kind: ControllerKind = "plain", *, simulated_s: float = 100.0
) -> list[CameraPlan]:
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return camera_plans([Driven("r", LAUNCH, folder, kind, simulated_s)], "cpu")


def test_a_module_that_writes_its_numbers_down_is_known(tmp_path: Path):
    (camera,) = planned(tmp_path, {"nav/nav.py": CLASS.format(kind="depth_camera", made="Eye(rows=90)")})
    assert (camera.kind, camera.columns, camera.rows, camera.rate_hz) == ("depth_camera", 160, 90, 10.0)
    assert not camera.assumed


@pytest.mark.parametrize("made", ["Eye(160)", "Eye(columns=wide)", "elsewhere()", "eye"])
def test_of_another_it_is_said_that_its_code_alone_knows(made: str, tmp_path: Path):
    (camera,) = planned(
        tmp_path, {"nav/nav.py": CLASS.format(kind="color_camera", made=made).replace("160, 120", "w, h")}
    )
    assert (camera.kind, camera.columns, camera.rows, camera.rate_hz) == ("color_camera", 64, 48, 20.0)
    assert camera.assumed


def test_who_has_no_camera_pays_for_none(tmp_path: Path):
    assert planned(tmp_path, {"nav/nav.py": CLASS.format(kind="lidar", made="Eye()")}) == []
    assert planned(tmp_path, {"nav/nav.py": CLASS.format(kind="depth_camera", made="None")}) == []
    assert planned(tmp_path, {"ros.yaml": "lidar: null"}, "ros2") == []


def test_cameras_of_a_ros_robot_stand_in_its_file(tmp_path: Path):
    declared = "depth_camera: {columns: 80, rows: 60, rate_hz: 7}\ncolor_camera: {}"
    depth, color = planned(tmp_path, {"ros.yaml": declared}, "ros")
    assert (depth.columns, depth.rows, round(depth.rate_hz, 3)) == (80, 60, 6.667)
    assert (color.kind, color.assumed) == ("color_camera", False)


def test_more_pixels_pictures_and_episodes_cost_more_and_cores_share_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def cost(text: str, simulated_s: float = 100.0) -> CameraPlan:
        return planned(tmp_path, {"ros.yaml": f"color_camera: {{{text}}}"}, "ros", simulated_s=simulated_s)[0]

    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    small, large, rare = cost("rate_hz: 20"), cost("columns: 320, rows: 240"), cost("rate_hz: 5")
    assert large.pictures.high < small.pictures.high
    assert large.batch_s.low > small.batch_s.low
    assert small.batch_s.high == pytest.approx(4 * rare.batch_s.high)
    assert small.batch_s.high == pytest.approx(2000 / small.pictures.low)
    assert cost("rate_hz: 20", simulated_s=300.0).batch_s.low == pytest.approx(3 * small.batch_s.low)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1, 2, 3})
    assert cost("rate_hz: 20").batch_s.low == pytest.approx(small.batch_s.low / 4)


@pytest.mark.parametrize(
    ("kind", "column", "marker"),
    [("depth_camera", "Simyard", "cameras"), ("color_camera", "colour", "color cameras")],
)
def test_the_range_is_that_of_the_guide(kind: str, column: str, marker: str, tmp_path: Path):
    page = (ROOT / "docs/guide/cameras.md").read_text()
    table = page.split(f"<!-- {marker} -->")[1].split("<!-- end")[0]
    lines = (line for line in table.splitlines() if line.startswith("|"))
    head, _, *rows = ([cell.strip() for cell in line.strip("|").split("|")] for line in lines)
    for row in rows:
        columns, high = row[head.index("picture")].split("x")
        (camera,) = planned(tmp_path, {"ros.yaml": f"{kind}: {{columns: {columns}, rows: {high}}}"}, "ros")
        measured = float(row[head.index(column)].replace(",", ""))
        assert 0.5 * camera.pictures.low < measured < 2.0 * camera.pictures.high, row


@pytest.mark.parametrize("kind", ["depth_camera", "color_camera"])
def test_cameras_of_a_list_cost_what_each_costs(kind: str, tmp_path: Path):
    alone = "Eye(name='front')"
    (one,) = planned(tmp_path / "one", {"nav/nav.py": CLASS.format(kind=kind, made=alone)})
    made = f"[{alone}, Eye(name='rear', yaw_rad=3.1)]"
    (two,) = planned(tmp_path / "two", {"nav/nav.py": CLASS.format(kind=kind, made=made)})
    assert (one.cameras, two.cameras, two.columns, two.assumed) == (1, 2, 160, False)
    assert two.pictures == one.pictures
    assert two.batch_s.high == pytest.approx(2 * one.batch_s.high)
    listed = f"{kind}: [{{name: front}}, {{name: rear}}, {{name: left}}]"
    (three,) = planned(tmp_path / "ros", {"ros.yaml": listed}, "ros")
    assert three.cameras == 3
