"""Robots are read from their MJCF; what cannot be represented is refused with the element and the remedy."""

from pathlib import Path

import pytest

from tasks.simulate.model import load_robot
from tasks.simulate.robot import RobotRefused, hull_of, read_robot
from tests.simulate_factory import COURIER, FAULTY, FOLDERS

PLANAR = """<mujoco><option timestep="0.005"/><worldbody><body name="b" pos="0 0 0.3">
<joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
<joint name="t" type="hinge" axis="0 0 1"/>{geom}</body></worldbody><actuator><motor joint="x"/></actuator></mujoco>"""
BALL = '<geom name="hull" type="sphere" size="0.2" mass="1"/>'


def robot(folder: Path, text: str) -> Path:
    path = folder / "robot.xml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("geom", "radius_m", "low_m", "high_m"),
    [
        (BALL, 0.2, 0.1, 0.5),
        ('<geom type="sphere" size="0.2" pos="0.1 0 0" mass="1"/>', 0.3, 0.1, 0.5),
        ('<geom type="capsule" size="0.1 0.15" mass="1"/>', 0.1, 0.05, 0.55),
        ('<geom type="box" size="0.3 0.4 0.1" mass="1"/>', 0.5, 0.2, 0.4),
        (BALL + '<geom type="box" size="1 1 1" mass="0" contype="0" conaffinity="0"/>', 0.2, 0.1, 0.5),
    ],
)
def test_the_hull_encloses_what_collides(tmp_path: Path, geom: str, radius_m: float, low_m: float, high_m: float):
    hull = hull_of(read_robot(robot(tmp_path, PLANAR.format(geom=geom))).compile())
    assert hull == pytest.approx((radius_m, low_m, high_m))


def test_scenery_in_a_robots_file_is_left_out():
    model = read_robot(FOLDERS[FAULTY] / "robot.xml").compile()
    assert [model.geom(k).name for k in range(model.ngeom)] == ["body"]


def test_a_robot_with_other_joints_is_refused(tmp_path: Path):
    legged = PLANAR.format(geom=BALL).replace('type="slide" axis="0 1 0"', 'type="hinge" axis="0 1 0"')
    with pytest.raises(RobotRefused, match=r"joints x, y, t: .*slide along x, slide along y, hinge about z"):
        read_robot(robot(tmp_path, legged))


def test_a_hull_that_mjx_cannot_collide_is_refused_by_name(tmp_path: Path):
    cylinder = PLANAR.format(geom='<geom name="drum" type="cylinder" size="0.2 0.1" mass="1"/>')
    with pytest.raises(RobotRefused, match=r"geom 'drum': MJX cannot collide a cylinder .*use a sphere"):
        load_robot(robot(tmp_path, cylinder))


def test_a_robot_that_touches_nothing_is_refused(tmp_path: Path):
    ghost = PLANAR.format(geom=BALL.replace("mass", 'contype="0" conaffinity="0" mass'))
    with pytest.raises(RobotRefused, match="no geom collides"):
        load_robot(robot(tmp_path, ghost))


def test_a_robot_without_actuators_is_refused(tmp_path: Path):
    bare = PLANAR.format(geom=BALL).replace('<actuator><motor joint="x"/></actuator>', "")
    with pytest.raises(RobotRefused, match="no actuator"):
        read_robot(robot(tmp_path, bare))


def test_a_timestep_that_does_not_divide_a_control_step_is_refused(tmp_path: Path):
    with pytest.raises(RobotRefused, match=r"timestep 0\.007 s"):
        read_robot(robot(tmp_path, PLANAR.format(geom=BALL).replace("0.005", "0.007")))


def test_an_integrator_that_mjx_lacks_is_refused_in_its_words(tmp_path: Path):
    implicit = PLANAR.format(geom=BALL).replace('timestep="0.005"', 'timestep="0.005" integrator="implicit"')
    with pytest.raises(RobotRefused, match=r"MJX refuses: .*IMPLICIT"):
        load_robot(robot(tmp_path, implicit))


@pytest.mark.parametrize("text", ["", "<mujoco><worldbody><body></mujoco>", "no xml"])
def test_a_file_that_is_no_mjcf_is_refused(tmp_path: Path, text: str):
    with pytest.raises(RobotRefused, match=r"robot\.xml"):
        read_robot(robot(tmp_path, text))


def test_a_missing_file_is_refused(tmp_path: Path):
    with pytest.raises(RobotRefused, match=r"robot\.xml"):
        read_robot(tmp_path / "robot.xml")


def test_the_courier_is_a_ball_of_18_cm_two_centimetres_above_the_floor():
    loaded = load_robot(FOLDERS[COURIER] / "robot.xml")
    assert loaded.hull == pytest.approx((0.18, 0.02, 0.38))
    assert loaded.physics_steps == 10
    assert loaded.actuators == 3
