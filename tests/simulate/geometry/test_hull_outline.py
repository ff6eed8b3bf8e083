"""What a robot looks like: each geom of its file that is seen, where it is at rest."""

from pathlib import Path

import numpy as np
import pytest

from tasks.simulate.application.robot_file import read_robot_mjcf
from tasks.simulate.application.robot_model import compile_robot
from tasks.simulate.geometry.hull_outline import hull_parts, robot_shape
from tests.factories.simulations import ROOT_ROBOTS
from tests.repository import ROOT


def test_a_skid_steer_is_a_deck_above_a_battery_and_four_wheels():
    shape = robot_shape(ROOT / "examples/robots/skid-steer/robot.xml")
    assert [part.kind for part in shape] == ["box", *["cylinder"] * 4, "box"]
    deck = shape[-1]
    assert (deck.position_m, deck.top_m) == (pytest.approx((0.0, 0.0, 0.135)), pytest.approx(0.185))
    assert deck.color == pytest.approx((0.7, 0.4, 0.15, 1.0))
    reach = {(round(abs(x), 3), round(abs(y), 3)) for x, y in deck.outline_m}
    assert reach == {(0.19, 0.17)}
    wheel = shape[1].outline_m
    assert max(x for x, _ in wheel) - min(x for x, _ in wheel) == pytest.approx(0.13, abs=1e-3)
    assert max(y for _, y in wheel) - min(y for _, y in wheel) == pytest.approx(0.04, abs=1e-3)


def test_what_is_round_has_a_round_outline():
    (hull, *_) = [part for part in robot_shape(ROOT / "applications/courier/robot.xml") if part.kind == "sphere"]
    assert len(hull.outline_m) == 32
    assert all(x * x + y * y == pytest.approx(0.18**2) for x, y in hull.outline_m)


@pytest.mark.parametrize("path", ROOT_ROBOTS, ids=lambda path: path.parent.name)
def test_every_robot_has_a_shape_whose_highest_part_is_last(path: Path):
    tops = [part.top_m for part in robot_shape(path)]
    assert tops
    assert tops == sorted(tops)


def test_a_mesh_has_its_vertices_and_what_nobody_sees_is_left_out(tmp_path: Path):
    path = tmp_path / "robot.xml"
    path.write_text(
        """<mujoco><asset><mesh name="m" vertex="0 0 0 .2 0 0 0 .2 0 0 0 .2"/></asset><worldbody><body name="b">
        <freejoint/><geom type="mesh" mesh="m" mass="1"/><geom size=".05" rgba="1 1 1 0"/>
        <body><joint name="j"/><geom size=".02"/></body></body></worldbody>
        <actuator><motor joint="j"/></actuator></mujoco>"""
    )
    assert sorted((part.kind, len(part.vertices_m)) for part in robot_shape(path)) == [("mesh", 4), ("sphere", 0)]


@pytest.mark.parametrize(
    ("joints", "turned"),
    [
        ('<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint axis="0 0 1"/>', {"key": "1 2 9"}),
        ("<freejoint/>", {"base": 'euler="0 0 90" pos="1 2 0.1"'}),
        ("<freejoint/>", {"key": "0 0 0.1 0.6 0 0 0.8"}),
    ],
)
def test_a_hull_is_where_it_is_in_the_bases_frame_however_the_base_is_turned_at_rest(
    tmp_path: Path, joints: str, turned: dict[str, str]
):
    def parts(base: str = 'pos="0 0 0.1"', key: str = "") -> list[list[float]]:
        path = tmp_path / "robot.xml"
        path.write_text(
            f"""<mujoco><worldbody><body name="base" {base}>{joints}<geom type="box" size=".2 .1 .05" pos=".3 .1 0"/>
            <site name="s"/></body></worldbody><keyframe>{f'<key qpos="{key}"/>' if key else ""}</keyframe>
            <actuator><motor site="s"/></actuator></mujoco>"""
        )
        seen = [[*part.position_m[:2], *np.array(part.outline_m).ravel()] for part in robot_shape(path)]
        return [*seen, *(np.ravel(part.corners).tolist() for part in hull_parts(compile_robot(read_robot_mjcf(path))))]

    for before, after in zip(parts(), parts(**turned), strict=True):
        assert {*np.round(before, 6)} == {*np.round(after, 6)}
