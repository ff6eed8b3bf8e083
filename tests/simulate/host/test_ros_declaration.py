"""What a bundle declares of its ROS robot: read before anything runs, and refused with all its faults."""

from pathlib import Path

import pytest

from specs.bundle_files import RosRobot
from tasks.simulate.application.bundle_code import BundleCrash
from tasks.simulate.application.mjcf_check import RobotRefused
from tasks.simulate.host.controllers import HostBundle
from tasks.simulate.host.declaration import read_ros_robot
from tasks.simulate.host.ros_controllers import ros_application
from tasks.simulate.sensors.lidar import Lidar
from tasks.simulate.sensors.sensor_table import Sensors, read_sensors
from tests.simulate.host.fake_lockstep import ROS_ROBOT, FakeLocksteps, ros_bundle


def sensors_of(folder: Path) -> Sensors:
    application = ros_application(HostBundle(folder, ROS_ROBOT), "ros", FakeLocksteps())
    return read_sensors(application.declare, {"KIND": "none"})


def test_a_bundle_that_declares_nothing_has_the_defaults(tmp_path: Path):
    assert read_ros_robot(tmp_path) == RosRobot()


def test_an_empty_file_declares_nothing(tmp_path: Path):
    (tmp_path / "ros.yaml").write_text("# nothing yet\n")
    assert read_ros_robot(tmp_path) == RosRobot()


def test_all_faults_of_a_declaration_are_told_at_once(tmp_path: Path):
    (tmp_path / "ros.yaml").write_text("topics: {command: cmd_vel}\nlidar: {rays: 0}\ncommand_timeout: 1\n")
    with pytest.raises(RobotRefused) as refused:
        read_ros_robot(tmp_path)
    for part in ("topics.command: 'cmd_vel'", "lidar.rays: 0", "command_timeout: 1"):
        assert f"ros.yaml: {part}" in str(refused.value)


def test_an_unknown_key_is_told_with_those_that_are_known(tmp_path: Path):
    (tmp_path / "ros.yaml").write_text("topics: {skan: /scan}\nlidr: {}\n")
    with pytest.raises(RobotRefused) as refused:
        read_ros_robot(tmp_path)
    assert "topics.skan: '/scan': an unknown key; known are command, scan, odometry" in str(refused.value)
    assert "lidr: {}: an unknown key; known are topics, frames, lidar" in str(refused.value)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("a: [1, 2", "no YAML"),
        ("- lidar", "should be a valid"),
        ("a: &a [x, x]\nb: &b [*a, *a]\n", "an alias"),
        ("[" * 5000, "more than 16 levels"),
        ("x" * 70_000, "more than 65536 bytes"),
        ("ready_s: " + ":".join(["1"] * 300) + ".0", "too large"),
        ("ready_s: !!int ''", "no YAML"),
        ("ready_s: !!timestamp x", "no YAML"),
        ("ready_s: !!bool x", "no YAML"),
    ],
)
def test_what_is_no_declaration_is_refused(tmp_path: Path, text: str, why: str):
    (tmp_path / "ros.yaml").write_text(text)
    with pytest.raises(RobotRefused, match=why):
        read_ros_robot(tmp_path)


def test_sensors_are_those_that_are_declared(tmp_path: Path):
    declaration = "lidar: {rays: 90, range_m: 5, x_m: 0.1}\nodometry: {sigma_m_per_m: 0.02}\nbumper: {sectors: 4}\n"
    found = sensors_of(ros_bundle(tmp_path, declaration))
    assert found.lidar == Lidar(rays=90, range_m=5.0, height_m=0.2, fov_rad=found.lidar.fov_rad, x_m=0.1)
    assert found.odometry is not None
    assert found.odometry.sigma_m_per_m == 0.02
    assert found.bumper.sectors == 4


def test_a_sensor_that_no_topic_tells_of_is_none(tmp_path: Path):
    found = sensors_of(ros_bundle(tmp_path, "topics: {scan: null, bumper: null}\nbumper: {}\n"))
    assert (found.lidar.rays, found.bumper.sectors) == (0, 0)


@pytest.mark.parametrize(
    ("declaration", "why"),
    [
        ("lidar: {rays: none}", "ros.yaml: lidar.rays: 'none'"),
        ("drive: {kind: velocity, forward: go}", "drive.forward: go: no actuator of robot.xml"),
    ],
)
def test_a_refused_declaration_is_the_applications_crash(tmp_path: Path, declaration: str, why: str):
    with pytest.raises(BundleCrash) as crash:
        sensors_of(ros_bundle(tmp_path, declaration))
    assert crash.value.code == "RobotApplicationCrash"
    assert crash.value.reason.startswith("wheels: ")
    assert why in crash.value.reason
