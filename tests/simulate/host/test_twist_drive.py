"""A Twist drives a robot as it says, whatever its actuators are called."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jaxtyping import Float64

from specs.ros_robot import DifferentialDrive, RosRobot, VelocityDrive
from tasks.simulate.application.mjcf_check import RobotRefused
from tasks.simulate.application.robot_file import read_robot_mjcf
from tasks.simulate.application.robot_model import (
    base_of,
    compile_robot,
    coordinates_at,
    pose_of,
    rest_position,
    velocity_of,
)
from tasks.simulate.host.twist_drive import TwistMap, robot_view, twist_map
from tests.factories.simulations import REPOSITORY

_CONTROL_S, _SETTLE_STEPS, _MEASURED_STEPS = 0.05, 40, 20
_SHIPPED = {
    "courier": Path("applications/courier/robot.xml"),
    "wanderer": Path("applications/wanderer/robot.xml"),
    "differential": Path("examples/robots/differential/robot.xml"),
    "holonomic": Path("examples/robots/holonomic/robot.xml"),
    "skid-steer": Path("examples/robots/skid-steer/robot.xml"),
}
# Wheels that slip as it turns: they stand for a wider track than the 0.26 m between them.
_SLIPPING = DifferentialDrive(
    left=("front_left", "rear_left"), right=("front_right", "rear_right"), track_m=0.61, wheel_radius_m=0.065
)
_DECLARED = {"skid-steer": _SLIPPING}
# Of a speed and of a turn rate: wheels that slip follow a command less exactly.
_TOLERANCE = {"skid-steer": (0.05, 0.12)}
_PLANAR = """
<mujoco><worldbody><body name="base" pos="0 0 0.1">
  <joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
  <joint name="yaw" type="hinge" axis="0 0 1"/><geom type="sphere" size="0.1" mass="1"/>
  <site name="middle"/><site name="left" pos="0 0.2 0"/><site name="right" pos="0 -0.2 0"/>{parts}
</body></worldbody><actuator>{actuators}</actuator>{more}</mujoco>
"""
_AXES = '<velocity name="x" joint="x" kv="50"/><velocity name="y" joint="y" kv="50"/>'
_YAW = '<velocity name="yaw" joint="yaw" kv="0.5"/>'
_ALONG_WORLD = VelocityDrive(forward="x", sideways="y", turn="yaw")
_ROLLING = """
<mujoco><option integrator="implicitfast"/><worldbody><body name="base" pos="0 0 0.05"><freejoint/>
  <geom type="box" size="0.1 0.1 0.02" mass="2"/>
  <geom type="sphere" pos="-0.09 0 -0.02" size="0.03" condim="1" priority="1" mass="0.1"/>
  <body pos="0.05 0.12 0"><joint name="left" axis="0 1 0"/>
    <geom type="cylinder" size="0.05 0.01" euler="90 0 0" mass="0.2"/></body>
  <body pos="0.05 -0.12 0"><joint name="right" axis="0 1 0"/>
    <geom type="cylinder" size="0.05 0.01" euler="90 0 0" mass="0.2"/></body>
</body></worldbody><actuator><velocity name="left" joint="left" kv="1"/><velocity name="right" joint="right" kv="1"/>
</actuator></mujoco>
"""


def _written(folder: Path, text: str) -> Path:
    path = folder / "robot.xml"
    path.write_text(text)
    return path


def _planar(folder: Path, actuators: str, parts: str = "", more: str = "") -> Path:
    return _written(folder, _PLANAR.format(actuators=actuators, parts=parts, more=more))


def _driven(
    robot: Path, twists: TwistMap, twist: tuple[float, float, float], start: tuple[float, float, float]
) -> Float64[np.ndarray, "3"]:
    """Returns a robot's mean speeds in its own frame, on C MuJoCo, after it was driven for two seconds."""
    model = compile_robot(read_robot_mjcf(robot))
    base, data, seen = base_of(model), mujoco.MjData(model), list[Float64[np.ndarray, "3"]]()
    data.qpos[:] = coordinates_at(base, rest_position(model), np.array(start), np)
    for step in range(_SETTLE_STEPS + _MEASURED_STEPS):
        mujoco.mj_forward(model, data)
        yaw_rad = pose_of(base, np.array(data.qpos), np)[2]
        data.ctrl[:] = twists.controls(np.array([twist]), np.array([yaw_rad]))[0]
        mujoco.mj_step(model, data, round(_CONTROL_S / model.opt.timestep))
        if step >= _SETTLE_STEPS:
            seen.append(_own_speeds(base_of(model), data))
    return np.mean(seen, axis=0)


def _own_speeds(base: object, data: mujoco.MjData) -> Float64[np.ndarray, "3"]:
    qpos = np.array(data.qpos)
    x, y, turn = velocity_of(base, qpos, np.array(data.qvel), np)  # pyright: ignore[reportArgumentType] - a Base
    yaw_rad = pose_of(base, qpos, np)[2]  # pyright: ignore[reportArgumentType] - a Base
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([cos * x + sin * y, cos * y - sin * x, turn])


@pytest.mark.parametrize("name", sorted(_SHIPPED))
def test_each_shipped_robot_drives_as_a_twist_says(name: str):
    twists = twist_map(_SHIPPED[name], _DECLARED.get(name))
    speed_tolerance, turn_tolerance = _TOLERANCE.get(name, (0.03, 0.03))

    @given(st.floats(-0.4, 0.4), st.floats(-0.8, 0.8), st.floats(-3.0, 3.0))
    @settings(max_examples=8, deadline=None)
    def drives(ahead_m_s: float, turn_rad_s: float, yaw_rad: float):
        found = _driven(_SHIPPED[name], twists, (ahead_m_s, 0.0, turn_rad_s), (1.0, -2.0, yaw_rad))
        assert found[0] == pytest.approx(ahead_m_s, abs=speed_tolerance)
        assert found[1] == pytest.approx(0.0, abs=speed_tolerance)
        assert found[2] == pytest.approx(turn_rad_s, abs=turn_tolerance)

    drives()


def test_a_holonomic_robot_drives_sideways():
    found = _driven(_SHIPPED["holonomic"], twist_map(_SHIPPED["holonomic"]), (0.2, 0.3, -0.5), (0.0, 0.0, 2.0))
    np.testing.assert_allclose(found, (0.2, 0.3, -0.5), atol=0.03)


def test_tyres_hold_whatever_a_twist_says_of_sideways():
    controls = twist_map(_SHIPPED["differential"]).controls(np.array([[0.5, 0.7, 1.0]]), np.zeros(1))
    np.testing.assert_allclose(controls, [[0.35, 0.65, 0.0]], atol=1e-6)


@given(yaw_rad=st.floats(-3.0, 3.0))
@settings(max_examples=8, deadline=None)
def test_actuators_along_the_worlds_axes_get_the_turned_twist(tmp_path_factory: pytest.TempPathFactory, yaw_rad: float):
    robot = _planar(tmp_path_factory.mktemp("axes"), _AXES + _YAW)
    found = _driven(robot, twist_map(robot, _ALONG_WORLD), (0.3, 0.1, 0.5), (0.0, 0.0, yaw_rad))
    np.testing.assert_allclose(found, (0.3, 0.1, 0.5), atol=0.03)


def test_a_gear_is_part_of_what_an_actuator_is_told(tmp_path: Path):
    robot = _planar(tmp_path, '<velocity name="go" site="middle" gear="4 0 0 0 0 0" kv="9"/>' + _YAW)
    np.testing.assert_allclose(twist_map(robot).own, [[4.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def test_an_arm_keeps_the_controls_of_the_first_keyframe(tmp_path: Path):
    arm = '<body><joint name="lift" axis="0 1 0"/><geom size="0.01" contype="0" conaffinity="0"/></body>'
    ahead = '<velocity name="go" site="middle" gear="1 0 0 0 0 0" kv="9"/>'
    key = '<keyframe><key qpos="0 0 0 0.4" ctrl="0 0 0.4"/></keyframe>'
    robot = _planar(tmp_path, f'{ahead}{_YAW}<position name="lift" joint="lift"/>', arm, key)
    controls = twist_map(robot).controls(np.array([[0.5, 0.0, 1.0]]), np.zeros(1))
    np.testing.assert_allclose(controls, [[0.5, 1.0, 0.4]], atol=1e-6)


@pytest.mark.parametrize(
    ("actuators", "why"),
    [
        (_YAW, "no actuator drives it ahead that takes a speed"),
        ('<velocity site="middle" gear="1 0 0 0 0 0"/>', "no actuator turns it that takes a speed"),
        ('<motor name="push" joint="x"/>' + _YAW, "actuator push pushes the base and is no velocity actuator"),
        ('<velocity site="left" gear="1 0 0 0 0 0"/>', "cannot drive it ahead and turn it apart from each other"),
        (_AXES + _YAW, "actuator x does not push along the base's own axes; actuator y does not"),
    ],
)
def test_what_cannot_be_seen_is_refused_with_what_to_write(tmp_path: Path, actuators: str, why: str):
    with pytest.raises(RobotRefused) as refused:
        twist_map(_planar(tmp_path, actuators))
    assert why in str(refused.value)
    assert "write into ros.yaml beside it 'drive: {kind: differential, left: NAME" in str(refused.value)


def test_a_robot_on_wheels_that_turn_is_refused_with_what_to_write(tmp_path: Path):
    with pytest.raises(RobotRefused, match=r"a free joint, so that wheels or legs move it; write into ros\.yaml"):
        twist_map(_written(tmp_path, _ROLLING))


def test_a_declared_differential_drive_divides_by_the_wheels_radius(tmp_path: Path):
    robot = _written(tmp_path, _ROLLING)
    declared = twist_map(robot, DifferentialDrive(track_m=0.4, wheel_radius_m=0.1))
    np.testing.assert_allclose(declared.own, [[10.0, 0.0, -2.0], [10.0, 0.0, 2.0]])


def test_a_declared_differential_base_on_wheels_drives_as_a_twist_says(tmp_path: Path):
    robot = _written(tmp_path, _ROLLING)
    twists = twist_map(robot, DifferentialDrive(track_m=0.24, wheel_radius_m=0.05))
    found = _driven(robot, twists, (0.3, 0.0, 0.5), (0.0, 0.0, 1.0))
    np.testing.assert_allclose(found[[0, 2]], (0.3, 0.5), atol=0.05)


def test_a_declared_velocity_drive_along_the_worlds_axes_gets_the_turned_twist(tmp_path: Path):
    robot = _planar(tmp_path, '<motor name="x" joint="x"/><motor name="y" joint="y"/><motor name="yaw" joint="yaw"/>')
    declared = twist_map(robot, _ALONG_WORLD)
    controls = declared.controls(np.array([[1.0, 0.0, 0.5]]), np.array([np.pi / 2]))
    np.testing.assert_allclose(controls, [[0.0, 1.0, 0.5]], atol=1e-6)


def test_a_declaration_along_one_axis_of_the_world_is_refused(tmp_path: Path):
    robot = _planar(tmp_path, _AXES + _YAW)
    with pytest.raises(RobotRefused, match="a robot that turns needs sideways, too"):
        twist_map(robot, VelocityDrive(forward="x", turn="yaw"))


def test_all_actuators_that_a_declaration_names_in_vain_are_named():
    with pytest.raises(RobotRefused) as refused:
        twist_map(_SHIPPED["courier"], DifferentialDrive(left="port", right="starboard", track_m=0.3))
    assert "drive.left: port: no actuator of robot.xml; drive.right: starboard: no actuator" in str(refused.value)


@pytest.mark.parametrize("name", _SHIPPED)
def test_controls_tell_the_twist_that_they_came_from(name: str):
    drive, rng = twist_map(_SHIPPED[name], _DECLARED.get(name)), np.random.default_rng(5)
    twists, yaw_rad = rng.normal(size=(20, 3)), rng.uniform(-3.0, 3.0, 20)
    if name != "holonomic":
        twists[:, 1] = 0.0
    found = drive.twists(drive.controls(twists, yaw_rad), yaw_rad)
    np.testing.assert_allclose(found, twists, atol=1e-5)


def test_controls_along_the_worlds_axes_tell_the_twist_by_the_heading(tmp_path: Path):
    drive = twist_map(_planar(tmp_path, _AXES + _YAW), _ALONG_WORLD)
    twists, yaw_rad = np.array([[0.5, 0.1, -0.3], [0.2, 0.0, 0.4]]), np.array([1.0, -2.0])
    np.testing.assert_allclose(drive.twists(drive.controls(twists, yaw_rad), yaw_rad), twists, atol=1e-6)


def test_a_robot_that_declares_nothing_has_the_usual_names_and_its_controls_are_twists():
    robot, twists = robot_view(REPOSITORY / "applications/courier")
    assert robot == RosRobot()
    assert twists
    assert twists(np.array([[0.5, -1.0, 0.0]]), np.zeros(1))[0] == pytest.approx([0.5, 0.0, -1.0])


def test_a_robot_has_the_names_that_it_declares(tmp_path: Path):
    (tmp_path / "ros.yaml").write_text("topics: {scan: /front/scan}\n")
    assert robot_view(tmp_path).robot.topics.scan == "/front/scan"


def test_a_robot_without_a_drive_that_can_be_seen_has_no_twists(tmp_path: Path):
    (tmp_path / "ros.yaml").write_text("no declaration")
    (tmp_path / "robot.xml").write_text("<mujoco/>")
    assert robot_view(tmp_path) == (RosRobot(), None)
