"""What a robot looks like: each geom of its file that is seen, where it is at rest."""

from pathlib import Path

import pytest

from tasks.simulate.geometry.hull_outline import robot_shape
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
