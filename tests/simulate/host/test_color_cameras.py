"""Robots that drive by pictures in colour: drawn on the host, the same whoever drives beside them."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from specs.bundle_files import ColorCameraDeclaration
from specs.data.episode import ApplicationLaunch, EpisodeRequest, EpisodeResult
from specs.data.robot_shape import RobotPart
from specs.data.world import World
from specs.errors import SimyardError
from tasks.render.camera_pool import Shot, open_cameras
from tasks.render.gl_process import DrawingFailed
from tasks.simulate.application.bundle_code import BundleCrash
from tasks.simulate.application.contract import Observation
from tasks.simulate.chunk.byproducts import collect_timings
from tasks.simulate.geometry.hull_outline import robot_shape
from tasks.simulate.host import color_cameras
from tasks.simulate.host.color_cameras import LanePictures, SeeingControllers
from tasks.simulate.host.controllers import HostStart, with_color
from tasks.simulate.plan.chunks import plan_chunks
from tasks.simulate.sensors.sensor_table import read_color_camera, sensors_of
from tests.factories.simulations import FOLDERS, PLAIN, pushing, simulate_lanes
from tests.servers.tools import skip_or_fail

WATCHER = ApplicationLaunch(name="plain", version="1", digest=PLAIN, package="plain", launch_file="watching")
LANES = 8


def watching(index: int, noise: str = "0.05") -> EpisodeRequest:
    drawn = pushing(index, world=f"hand/pen-{index % 3}", seed=index, fault=noise, duration_s=2.0)
    return drawn.model_copy(update={"robot": WATCHER})


def run(requests: Sequence[EpisodeRequest], pens: dict[str, World], engine: str = "auto") -> list[EpisodeResult]:
    (chunk,) = plan_chunks(list(requests), LANES)
    return simulate_lanes(chunk, pens, FOLDERS, lanes=LANES, engine=engine, should_stop=lambda: False)


@pytest.fixture(scope="module")
def gl() -> None:
    try:
        with open_cameras(1):
            pass
    except SimyardError as exc:
        skip_or_fail(str(exc))


@pytest.mark.long
@pytest.mark.usefixtures("gl")
def test_it_drives_by_what_it_sees_whoever_drives_beside_it(pens: dict[str, World]):
    requests = [watching(index) for index in range(6)]
    with collect_timings() as timings:
        rows = run(requests, pens)
    (gl,) = {each.gl.partition(":")[0] for each in timings}
    assert gl in {"egl", "osmesa"}
    assert {(row.status, row.outcome_reason, row.failure_reason) for row in rows} == {("Completed", "timeout", "")}
    assert run(requests[2:3], pens) == rows[2:3]
    assert len({row.final_x_m for row in rows}) == len(rows)
    (other,) = run([watching(2, noise="0.0")], pens)
    assert other.final_x_m != rows[2].final_x_m, "its noise is another"


@pytest.mark.long
@pytest.mark.usefixtures("gl")
def test_it_drives_on_mujoco(pens: dict[str, World]):
    rows = run([watching(index) for index in range(3)], pens, "mujoco")
    assert {(row.status, row.engine) for row in rows} == {("Completed", "mujoco")}


@pytest.mark.long
def test_without_gl_each_row_says_what_to_install(pens: dict[str, World], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("MUJOCO_GL", "nonsense")
    (row,) = run([watching(0)], pens)
    assert (row.status, row.failure_code) == ("Failed", "InternalServiceError")
    assert "no GL is there (Debian: apt-get install libosmesa6" in row.failure_reason


ROBOT = FOLDERS[PLAIN] / "robot.xml"


class Drawer:
    """Stands for the processes that draw: a picture has its number, from 1, in all pixels."""

    gl = "none"

    def __init__(self) -> None:
        self.shots: list[list[Shot]] = []
        self.robots: list[int] = []

    def add(self, key: str, world: World, camera: ColorCameraDeclaration, robot: Sequence[RobotPart]) -> None:
        del key, world, camera
        self.robots.append(len(robot))

    def color(self, shots: Sequence[Shot]) -> np.ndarray:
        self.shots.append([*shots])
        return np.stack([np.full((4, 6, 3), shot.number + 1, np.uint8) for shot in shots])


class Watcher:
    """Stands for controllers: keeps what lane 0 is shown."""

    crashes: dict[int, str] = {}  # noqa: RUF012 - nobody changes it

    def __init__(self) -> None:
        self.shown: list[int] = []

    def controls(self, observed: Observation, moving: np.ndarray) -> np.ndarray:
        del moving
        assert observed.color is not None
        self.shown.append(int(observed.color[0].max()))
        return np.zeros((2, 1), np.float32)


def shown(
    rate_hz: float, latency_steps: int, pens: dict[str, World], monkeypatch: pytest.MonkeyPatch
) -> tuple[list[int], Drawer]:
    """Returns which picture lane 0 is shown at each of eight control steps, 0 for none."""
    drawer, watcher = Drawer(), Watcher()

    def standing(most: int) -> Drawer:
        assert most == 1, "no process for a lane that sees nothing"
        return drawer

    monkeypatch.setattr(color_cameras, "standing_cameras", standing)
    camera = ColorCameraDeclaration(columns=6, rows=4, rate_hz=rate_hz, latency_steps=latency_steps)
    lane: Any = type("Lane", (), {"request": watching(0), "robots": None})
    start = HostStart([lane, lane], 2, 1, sensors_of(object()), pens)
    pictures = LanePictures([camera, BundleCrash("RobotApplicationCrash", "broken")], start, ROBOT)
    seeing = SeeingControllers(watcher, pictures, start)  # type: ignore[arg-type]
    for _ in range(8):
        seeing.see(np.zeros((2, 3), np.float32))
        controls = seeing.controls(Observation(*[None] * 8), np.array([True, True]))  # type: ignore[arg-type]
        assert np.isnan(controls[1]).all()
    assert dict(seeing.crashes) == {1: "broken"}
    return watcher.shown, drawer


def test_pictures_come_at_their_rate_and_late(pens: dict[str, World], monkeypatch: pytest.MonkeyPatch):
    assert shown(0.0, 0, pens, monkeypatch)[0] == [1, 2, 3, 4, 5, 6, 7, 8]
    assert shown(10.0, 0, pens, monkeypatch)[0] == [1, 1, 2, 2, 3, 3, 4, 4]
    assert shown(5.0, 3, pens, monkeypatch)[0] == [0, 0, 0, 1, 1, 1, 1, 2]
    pictures, drawer = shown(10.0, 3, pens, monkeypatch)
    assert pictures == [0, 0, 0, 1, 1, 2, 2, 3]
    assert [len(shots) for shots in drawer.shots] == [1, 1, 1, 1], "a lane that crashed is not drawn"


def test_where_nothing_can_be_drawn_the_robot_is_not_to_blame(pens: dict[str, World], monkeypatch: pytest.MonkeyPatch):
    def broken(most: int) -> Drawer:
        raise DrawingFailed(f"no GL\nfor {most}")

    monkeypatch.setattr(color_cameras, "standing_cameras", broken)
    lane: Any = type("Lane", (), {"request": watching(0), "robots": None})
    start = HostStart([lane, lane, lane], 3, 1, sensors_of(object()), pens)
    watcher = Watcher()
    watcher.crashes = {1: "it raised"}
    seeing = SeeingControllers(watcher, LanePictures([ColorCameraDeclaration()] * 3, start, ROBOT), start)  # type: ignore[arg-type]
    controls = seeing.controls(Observation(*[None] * 8), np.array([True, False, True]))  # type: ignore[arg-type]
    assert np.isnan(controls).all()
    assert dict(seeing.crashes) == {0: "no GL for 3", 1: "it raised", 2: "no GL for 3"}
    codes = [seeing.failure_code(lane) for lane in range(3)]
    assert codes == ["InternalServiceError", "RobotApplicationCrash", "InternalServiceError"]


def test_a_camera_sees_its_robot_only_if_it_says_so(pens: dict[str, World], monkeypatch: pytest.MonkeyPatch):
    drawer = Drawer()
    monkeypatch.setattr(color_cameras, "standing_cameras", lambda _: drawer)
    lane: Any = type("Lane", (), {"request": watching(0), "robots": None})
    start = HostStart([lane, lane], 2, 1, sensors_of(object()), pens)
    camera = ColorCameraDeclaration(columns=6, rows=4)
    pictures = LanePictures([camera, camera.model_copy(update={"sees_robot": True})], start, ROBOT)
    pictures.shown_at_once(np.array([True, True]))
    assert drawer.robots == [0, len(robot_shape(ROBOT))]
    assert drawer.robots[1] > 0


def test_faults_of_a_camera_are_told_together():
    made = type("Made", (), {"color_camera": type("Camera", (), {"columns": 0, "noise": 2.0})})()
    with pytest.raises(BundleCrash, match=r"color_camera\.columns: 0: .*; controller\.color_camera\.noise: 2: "):
        read_color_camera(lambda _: made, {})


def test_a_camera_that_cannot_be_is_why_every_lane_crashed():
    made = type("Made", (), {"color_camera": type("Camera", (), {"columns": 64.5})})()
    lane: Any = type("Lane", (), {"request": watching(0), "robots": None})
    start = HostStart([lane, lane], 2, 1, sensors_of(object()))
    seeing = with_color(Watcher(), lambda _: made, start, ROBOT)  # type: ignore[arg-type]
    controls = seeing.controls(Observation(*[None] * 8), np.array([True, True]))  # type: ignore[arg-type]
    assert np.isnan(controls).all()
    assert sorted(seeing.crashes) == [0, 1]
    assert "controller.color_camera.columns: 64.5: " in seeing.crashes[0]
