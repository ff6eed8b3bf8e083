"""What is known of a launch file before the run: of ROS 1, and of ROS 2 on a machine without it."""

import shutil
from pathlib import Path

import pytest

from flows.pipeline.launch_notes import report_lines, ros_launch_faults, topic_lines
from tasks.ros.launch.launch_plan import LaunchSource
from tasks.ros.launch.packages import RosInstallation
from tasks.ros.ros2.ros2_installation import ros2_installation
from tasks.simulate.sandbox import launch_check
from tasks.simulate.sandbox.launch_check import LaunchReport, check_launch_file
from tests.repository import ROOT
from tests.ros.conftest import COURIER, ros
from tests.ros.ros2.players import make_bundle

pytestmark = pytest.mark.skipif(bool(ros2_installation().prefixes), reason="ROS 2 is installed")
__all__ = ["ros"]


def report(bundle: Path, *programs: str) -> LaunchReport:
    source = LaunchSource(bundle, "play", "play.launch.py")
    return check_launch_file(source, [{"PROGRAM": each} for each in programs], own=True)


def test_nodes_that_need_no_ros_2_are_told_and_nothing_is_missing(tmp_path: Path):
    found = report(make_bundle(tmp_path), "avoider", "timed")
    assert (found.has_ros, found.missing, found.refusals, found.unread) == (True, (), (), "")
    assert found.nodes == ("/player (play avoider)", "/player (play timed)")
    assert "no ROS 2 with launch_ros" in found.ros


@pytest.mark.parametrize("told", ["package", "program"])
def test_a_node_that_needs_rclpy_cannot_run_without_ros_2(tmp_path: Path, told: str):
    bundle = make_bundle(tmp_path)
    if told == "package":
        (bundle / "play/package.xml").write_text("<package><name>play</name><depend>rclpy</depend></package>")
    else:
        (bundle / "play/scripts/avoider").write_text("#!/usr/bin/env python3\nimport rclpy\n")
    found = report(bundle, "avoider")
    assert not found.has_ros
    assert found.refusals == ()
    assert "no ROS 2 is here (AMENT_PREFIX_PATH, or below /opt/ros)" in found.ros
    assert "/player (play avoider) needs rclpy: install ros-jazzy-rclpy" in found.ros


def test_what_the_stand_ins_refuse_for_want_of_ros_2_is_no_fault_of_the_document(tmp_path: Path):
    bundle = make_bundle(tmp_path)
    _edit(bundle, 'os.environ.get("BESIDE"', 'os.environb.getenv("BESIDE"')
    found = report(bundle, "avoider")
    assert (found.has_ros, found.refusals) == (False, ())
    assert "has no attribute 'getenv'; if ROS 2's own launch takes it, install ROS 2" in found.ros


def _edit(bundle: Path, old: str, new: str) -> None:
    path = bundle / "play/launch/play.launch.py"
    path.write_text(path.read_text().replace(old, new))


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("executable=program", "executable='avoid'", "no executable 'avoid'; it has advised"),
        ("package=", "package='pley' or ", "no package 'pley' in the bundle or in ROS 2: did you mean \"play\"?"),
        ("LaunchDescription([", "LaunchDescriptionn([", "NameError: name 'LaunchDescriptionn' is not defined"),
        ("return ", "retrun ", "SyntaxError: invalid syntax"),
    ],
)
def test_what_is_wrong_with_ros_2_and_without_is_a_fault_of_the_document(tmp_path: Path, old: str, new: str, why: str):
    bundle = make_bundle(tmp_path)
    _edit(bundle, old, new)
    source = LaunchSource(bundle, "play", "play.launch.py")
    found = report(bundle, "avoider")
    (fault,) = ros_launch_faults("requests", source, found)
    assert found.has_ros
    assert fault.allowed.startswith("a launch file that ros2 launch takes, and not this one: play play.launch.py: ")
    assert why in fault.allowed


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("player:\n  ros__parameters:\n    speed: [1\n", "line 4: its parameters are no YAML: expected ',' or ']'"),
        ("- 1\n", "holds no parameters: write them below NODE: and ros__parameters:"),
        ("\0", "its parameters are no YAML: unacceptable character #x0000"),
    ],
)
def test_a_file_of_parameters_that_no_node_can_read_is_named_with_its_line(tmp_path: Path, text: str, why: str):
    bundle = make_bundle(tmp_path)
    (bundle / "play/tuning.yaml").write_text(text)
    _edit(bundle, 'name="player"', f'name="player", parameters=["{bundle}/play/tuning.yaml"]')
    (lost,) = report(bundle, "avoider").lost
    assert lost.startswith(f"/player (play avoider): play/tuning.yaml: {why}")


def test_a_file_of_parameters_that_is_not_there_is_named_and_its_node_starts_without(tmp_path: Path):
    bundle = make_bundle(tmp_path)
    _edit(bundle, 'name="player"', f'name="player", parameters=["{bundle}/play/gone.yaml", {{"a": 1}}]')
    found = report(bundle, "avoider")
    assert (found.refusals, found.lost) == ((), ())
    line = "/player (play avoider): its file of parameters play/gone.yaml is not there, and ROS 2 starts it without"
    assert line in [*report_lines(LaunchSource(bundle, "play", "play.launch.py"), found)]


@pytest.mark.parametrize(
    ("first", "why"),
    [
        ("#!/usr/bin/env python3\r\n", "line 1: ends in CR LF, and the CR counts to the interpreter's name: dos2unix"),
        ("import os\n", "line 1: says not what runs it: begin it with #!/bin/sh"),
        ("#!/opt/gone/python\n", "line 1: needs /opt/gone/python, which is not here: install it"),
    ],
)
def test_a_script_that_linux_does_not_start_is_a_fault_of_the_launch_file(tmp_path: Path, first: str, why: str):
    bundle = make_bundle(tmp_path)
    script = bundle / "play/scripts/avoider"
    script.write_bytes(first.encode() + b"import sys\n")
    (lost,) = report(bundle, "avoider").lost
    assert lost.startswith(f"/player (play avoider): play/scripts/avoider, {why}")


@pytest.mark.long
def test_a_script_of_ros_1_that_linux_does_not_start_is_told_as_well(ros: RosInstallation, tmp_path: Path):
    shutil.copytree(COURIER / "courier", tmp_path / "courier")
    node = tmp_path / "courier/scripts/answer.py"
    node.write_bytes(node.read_bytes().replace(b"\n", b"\r\n"))
    found = check_launch_file(LaunchSource(tmp_path, "courier", "answer.launch"), [{}], own=True)
    (lost,) = found.lost
    assert lost.startswith("/answer (courier answer.py): courier/scripts/answer.py, line 1: ends in CR LF")


def test_a_node_that_reads_the_robots_topic_with_another_type_is_told(tmp_path: Path):
    bundle = make_bundle(tmp_path)
    reads = 'from sensor_msgs.msg import PointCloud2\nself.create_subscription(PointCloud2, "scan", self.see, 1)\n'
    (bundle / "play/scripts/avoider").write_text(f"#!/usr/bin/env python3\n{reads}")
    (bundle / "robot.xml").write_bytes((ROOT / "examples/ros/turtlebot3/robot.xml").read_bytes())
    (line,) = topic_lines([report(bundle, "avoider")])
    assert line == (
        "the robot publishes /scan as sensor_msgs/LaserScan, and /player (play avoider) reads it as "
        "sensor_msgs/PointCloud2: it does not arrive; give both one type"
    )


def test_without_cyclone_dds_no_node_is_heard(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(launch_check, "find_spec", lambda _: None)
    found = report(make_bundle(tmp_path), "avoider")
    assert not found.has_ros
    assert "pip install 'simyard[ros2]'" in found.ros


@pytest.mark.long
def test_missing_packages_of_ros_1_and_python_2_are_told_besides_what_is_started(ros: RosInstallation, tmp_path: Path):
    package = tmp_path / "courier"
    shutil.copytree(COURIER / "courier", package)
    manifest, node = package / "package.xml", package / "scripts/answer.py"
    manifest.write_text(
        manifest.read_text().replace(
            "</package>", "<depend>nowhere_msgs</depend><depend>turtle_description</depend></package>"
        )
    )
    node.write_text(node.read_text() + "print 'hello'\n")
    found = check_launch_file(LaunchSource(tmp_path, "courier", "answer.launch"), [{}], own=True)
    assert (found.nodes, found.refusals) == (("/answer (courier answer.py)",), ())
    assert found.missing == (
        "the ROS package nowhere_msgs, which courier needs, is missing: try apt-get install python3-nowhere-msgs",
        "the ROS package turtle_description, which courier needs, is missing: install it, or put it into the bundle",
    )
    (old,) = found.python2
    assert old.startswith("courier/scripts/answer.py, line 33: no Python 3: Missing parentheses in call to 'print'")


@pytest.mark.long
def test_what_it_asks_of_gazebo_comes_out_of_the_process_that_reads_it(ros: RosInstallation, tmp_path: Path):
    (tmp_path / "sim/launch").mkdir(parents=True)
    (tmp_path / "sim/package.xml").write_text("<package><name>sim</name><depend>gazebo_ros</depend></package>")
    (tmp_path / "sim/hall.world").write_text("<sdf/>")
    (tmp_path / "sim/launch/sim.launch").write_text(
        '<launch><include file="$(find gazebo_ros)/launch/empty_world.launch">'
        '<arg name="world_name" value="$(find sim)/hall.world"/><arg name="gui" value="false"/></include>'
        '<node pkg="nav" type="plan" name="plan"/></launch>'
    )
    source = LaunchSource(tmp_path, "sim", "sim.launch")
    found = check_launch_file(source, [{}], own=True)
    assert (found.unread, found.refusals, found.missing, found.nodes) == ("", (), (), ())
    assert [each.split(":")[0] for each in found.lost] == ["/plan (nav plan)"]
    assert list(report_lines(source, found))[1:] == [
        "sim sim.launch: /gazebo (gazebo_ros gzserver) is not started; in its place: Simyard's engine, in the world "
        "that is imported",
        "sim sim.launch: its world is sim/hall.world",
    ]
