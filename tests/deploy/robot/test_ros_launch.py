"""What a robot does with a launch file of ROS; a script plays roslaunch, and in a long test it is roslaunch itself."""

import os
import shutil
from pathlib import Path

import pytest

from specs.robomaker.bundle import Version
from specs.robomaker.deployment import DeploymentLaunchConfig
from tasks.applications.registry import publish_bundle
from tasks.deploy.robot import launch as robot_launch
from tasks.ros.launch import robot_command
from tests.deploy.one_robot import GOOD, OneRobot
from tests.deploy.yard import PATIENCE_S
from tests.repository import ROOT
from tests.servers.eventually import eventually
from tests.servers.ports import free_port

ROAM = DeploymentLaunchConfig(packageName="roamer", launchFile="roam.launch")
HAS_ROS = shutil.which("roslaunch") is not None or os.environ.get("CI") == "true"


@pytest.fixture
def roslaunch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Returns a program in place of roslaunch that says how it was called, and stays up with a daemon of its own."""
    program = tmp_path / "ros" / "roslaunch"
    program.parent.mkdir()
    program.write_text('#!/bin/sh\n(env; echo "ARGS=$*") > "$HOME/seen"\nsetsid sleep 2000 &\nexec sleep 1000\n')
    program.chmod(0o755)
    monkeypatch.setattr(robot_command, "_PROGRAMS_PATH", str(program.parent))
    monkeypatch.setattr(robot_command, "_ROS_FOLDER", tmp_path / "none")
    monkeypatch.setattr(robot_launch, "_ROS_START_S", 0.0)
    return program


@pytest.fixture
def roamer(one: OneRobot) -> Version:
    return publish_bundle(one.yard.store, "robot-application", "roamer", ROOT / "examples/ros/turtlebot3")


def _seen(one: OneRobot) -> dict[str, str]:
    eventually((one.root / "seen").is_file)
    lines = (one.root / "seen").read_text().splitlines()
    return {name: value for name, _, value in (line.partition("=") for line in lines)}


@pytest.mark.usefixtures("roslaunch")
def test_a_robot_launches_the_file_that_episodes_are_driven_with_by_roslaunch(one: OneRobot, roamer: Version) -> None:
    reported = one.deploy(roamer, 1, launch=ROAM, environment={"SPEED": "0.1"})

    bundle, seen = one.root / "versions" / roamer.digest, _seen(one)
    assert reported.status == "InSync"
    assert seen["ARGS"] == str(bundle / "roamer/launch/roam.launch")
    assert (seen["SPEED"], seen["ROS_PACKAGE_PATH"]) == ("0.1", f"{bundle}:/usr/share")


@pytest.mark.usefixtures("roslaunch")
def test_where_the_master_is_a_document_says_before_the_robots_owner(
    one: OneRobot, roamer: Version, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:1")
    monkeypatch.setenv("ROS_IP", "127.0.0.1")

    one.deploy(roamer, 1, launch=ROAM, environment={"ROS_MASTER_URI": "http://127.0.0.1:2"})

    seen = _seen(one)
    assert (seen["ROS_MASTER_URI"], seen["ROS_IP"]) == ("http://127.0.0.1:2", "127.0.0.1")


@pytest.mark.usefixtures("roslaunch")
def test_what_roslaunch_leaves_in_sessions_of_their_own_ends_with_it(one: OneRobot, roamer: Version) -> None:
    one.deploy(roamer, 1, launch=ROAM)
    eventually(lambda: sorted(one.programs) == ["sleep 1000", "sleep 2000"])

    one.robot.end()

    assert one.programs == []


def test_a_robot_without_ros_says_so_and_what_runs_runs_on(one: OneRobot, roamer: Version, roslaunch: Path) -> None:
    one.deploy(one.yard.publish(GOOD), 1)
    roslaunch.unlink()

    reported = one.deploy(roamer, 2, launch=ROAM)

    # Only the bundle tells whether it is a container image, which brings its own ROS.
    found = (reported.status, reported.failure_code, reported.step)
    assert found == ("Failed", "EnvironmentSetupError", "DownloadingExtracting")
    assert "roam.launch needs ROS 1, and this robot has no roslaunch" in reported.failure_reason
    eventually(lambda: one.programs == ["sleep 1000"])


@pytest.mark.usefixtures("roslaunch")
def test_a_launch_file_that_the_bundle_does_not_have_is_told(one: OneRobot) -> None:
    reported = one.deploy(one.yard.publish(GOOD), 1, launch=ROAM)

    assert reported.failure_code == "MissingRobotDeploymentResource"
    assert "no launch file roam.launch in a package roamer" in reported.failure_reason


_LAUNCH2 = """
from launch import LaunchDescription
from launch_ros.actions import Node


def generate_launch_description():
    return LaunchDescription([Node(package="play", executable=each, name=each) for each in ("stay", "leave")])
"""
_SEEN = '#!/bin/sh\n(env; echo "ARGS=$*") > "$HOME/seen.tmp"; mv "$HOME/seen.tmp" "$HOME/seen"; exec sleep 1000\n'


def test_a_robot_whose_ros_2_has_no_launch_starts_the_same_nodes_by_the_walls_clock(
    one: OneRobot, roslaunch: Path, tmp_path: Path
) -> None:
    roslaunch.unlink()
    package, ros = tmp_path / "bundle/play", tmp_path / "ros2"
    for folder in (package / "launch", package / "scripts", ros):
        folder.mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>play</name></package>")
    (package / "launch/play.launch.py").write_text(_LAUNCH2)
    for name, script in (("stay", _SEEN), ("leave", "#!/bin/sh\n")):
        (package / "scripts" / name).write_text(script)
        (package / "scripts" / name).chmod(0o755)
    version = publish_bundle(one.yard.store, "robot-application", "play", tmp_path / "bundle")
    launch = DeploymentLaunchConfig(packageName="play", launchFile="play.launch.py")

    reported = one.deploy(version, 1, launch=launch, environment={"AMENT_PREFIX_PATH": str(ros)})
    seen = _seen(one)
    one.robot.end()

    assert reported.status == "InSync"
    assert seen["ARGS"] == "--ros-args -r __node:=stay"
    assert str(ros) in seen["AMENT_PREFIX_PATH"].split(":")
    assert one.programs == []


@pytest.mark.long
@pytest.mark.skipif(not HAS_ROS, reason="ROS 1 is not installed")
def test_nodes_of_ros_run_until_the_robot_ends(one: OneRobot, roamer: Version) -> None:
    own = {"ROS_MASTER_URI": f"http://127.0.0.1:{free_port()}", "ROS_IP": "127.0.0.1"}

    reported = one.deploy(roamer, 1, launch=ROAM, environment=own)
    eventually(lambda: any("roam.py" in each for each in one.programs))
    one.robot.end()

    assert reported.status == "InSync"
    assert one.programs == []


@pytest.mark.long
@pytest.mark.skipif(not HAS_ROS, reason="ROS 1 is not installed")
def test_a_launch_file_that_roslaunch_refuses_does_not_stay_up(one: OneRobot, tmp_path: Path) -> None:
    shutil.copytree(ROOT / "examples/ros/turtlebot3", tmp_path / "broken")
    (tmp_path / "broken/roamer/launch/roam.launch").write_text("<launch><node/></launch>")
    version = publish_bundle(one.yard.store, "robot-application", "roamer", tmp_path / "broken")

    one.restarted(PATIENCE_S)  # it ends when it ends
    reported = one.deploy(version, 1, launch=ROAM)

    assert reported.failure_code == "EnvironmentSetupError"
    assert "has to stay up" in reported.failure_reason
