"""The program that reads a launch file is bounded, whatever a stranger wrote into the file."""

import os
import sys
import time
from pathlib import Path
from xmlrpc.client import Binary

import pytest

from specs.data.world import Start
from specs.errors import LaunchRefused
from tasks.ros.launch.gazebo_launch import read_gazebo_launch
from tasks.ros.launch.launch_plan import LaunchPlan, LaunchSource, read_launch, resolve_launch, run_launch_program
from tasks.ros.process.application_processes import alive


def read(folder: Path, program: str, limit_s: float = 60.0) -> str:
    return run_launch_program([sys.executable, "-I", "-S", "-c", program], dict(os.environ), folder, "asked", limit_s)


def test_the_last_line_is_the_answer(tmp_path: Path) -> None:
    assert read(tmp_path, "import sys; print('before'); print(sys.stdin.read())") == "asked"


@pytest.mark.parametrize(
    ("program", "why"),
    [
        ("import sys; sys.exit('no such thing')", "it fails: no such thing"),
        ("import os; os._exit(3)", "it fails: it says nothing"),
        ("import os; os._exit(0)", "it ends without an answer"),
        ("print('1' * 16_777_217)", "it answers with a line of more than 16,777,216 bytes"),
        ("held = b'1' * (5 << 30)", "it fails: MemoryError"),
        ("import os\nwhile True: os.write(1, b'1' * (1 << 20))", "it fails: OSError: .*File too large"),
    ],
)
def test_whatever_goes_wrong_is_a_refusal_with_words(tmp_path: Path, program: str, why: str) -> None:
    with pytest.raises(LaunchRefused, match=why):
        read(tmp_path, program)


def test_what_is_printed_before_the_answer_may_be_longer(tmp_path: Path) -> None:
    assert read(tmp_path, "print('1\\n' * 16_777_216 + 'last')") == "last"


def test_it_ends_in_time(tmp_path: Path) -> None:
    with pytest.raises(LaunchRefused, match=r"reading it takes longer than 0\.2 s"):
        read(tmp_path, "import time; time.sleep(600)", 0.2)


def test_what_it_leaves_behind_is_ended_and_nobody_waits_for_it(tmp_path: Path) -> None:
    program = "import os, time\npid = os.fork()\nif pid: print(pid)\nelse: time.sleep(600)"
    left = int(read(tmp_path, program))
    while alive(left):
        time.sleep(0.002)


pytestmark = pytest.mark.long


@pytest.fixture
def bundle(courier: Path, tmp_path: Path) -> Path:
    (tmp_path / "courier").symlink_to(courier / "courier")
    own = tmp_path / "own"
    (own / "launch").mkdir(parents=True)
    (own / "package.xml").write_text("<package><name>own</name></package>")
    program = own / "tool.sh"
    program.write_text("#!/bin/sh\nsleep 60\n")
    program.chmod(0o755)
    return tmp_path


def plan(bundle: Path, text: str, **variables: str) -> LaunchPlan:
    (bundle / "own/launch/x.launch").write_text(f"<launch>{text}</launch>")
    return only(resolve_launch(LaunchSource(bundle, "own", "x.launch"), [variables]))


def only(found: list[LaunchPlan | LaunchRefused]) -> LaunchPlan:
    (one,) = found
    if isinstance(one, LaunchRefused):
        raise one
    return one


def test_each_environment_has_its_own_plan(courier: Path) -> None:
    fast, usual, again = resolve_launch(LaunchSource(courier, "courier", "answer.launch"), [{"SPEED": "0.7"}, {}, {}])
    assert isinstance(fast, LaunchPlan)
    assert isinstance(usual, LaunchPlan)
    assert (fast.parameters, usual.parameters) == ({"/answer/speed": 0.7}, {"/answer/speed": 0.4})
    assert again is usual


@pytest.mark.parametrize("name", ["answer.launch", "launch/answer.launch"])
def test_a_file_is_found_below_its_package(courier: Path, name: str) -> None:
    found = only(resolve_launch(LaunchSource(courier, "courier", name), [{}]))
    assert found.file == str(courier / "courier/launch/answer.launch")
    assert [node.name for node in found.nodes] == ["/answer"]


def test_groups_remaps_environments_and_prefixes_are_the_nodes(bundle: Path) -> None:
    node = '<node pkg="own" type="tool.sh" name="a" args="--x 1" launch-prefix="nice -n 1" required="true" cwd="node">'
    inside = '<remap from="scan" to="/front"/><env name="MODE" value="$(env WHO)"/><param name="p" value="2"/>'
    found = plan(bundle, f'<group ns="robot">{node}{inside}</node></group>', WHO="me").nodes[0]
    assert found.name == "/robot/a"
    assert found.command[:3] == ("nice", "-n", "1")
    assert {"--x", "1", "scan:=/front", "__name:=a"} <= set(found.command)
    assert found.own_environment() == {"MODE": "me", "ROS_NAMESPACE": "/robot"}
    assert found.required
    assert found.cwd.endswith("own")


def test_included_files_and_loaded_parameters_count(bundle: Path) -> None:
    (bundle / "own/values.yaml").write_text("gains: {p: 1.5, i: [1, 2]}\n")
    (bundle / "own/launch/part.launch").write_text(
        '<launch><arg name="n"/><node pkg="own" type="tool.sh" name="$(arg n)"/></launch>'
    )
    found = plan(
        bundle,
        '<include file="$(find own)/launch/part.launch"><arg name="n" value="b"/></include>'
        '<rosparam command="load" file="$(find own)/values.yaml" ns="c"/>'
        '<param name="f" binfile="$(find own)/tool.sh"/>',
    )
    assert [node.name for node in found.nodes] == ["/b"]
    assert found.parameters["/c/gains/p"] == 1.5
    assert found.parameters["/c/gains/i"] == [1, 2]
    assert isinstance(found.parameters["/f"], Binary)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('<node pkg="nowhere" type="x" name="a"/>', "no ROS package 'nowhere' in the bundle or in ROS: put it"),
        ('<arg name="map" default="$(find nowhere)/map.yaml"/>', "no ROS package 'nowhere' in the bundle or in ROS"),
        ('<node pkg="own" type="missing" name="a"/>', "missing"),
        ('<arg name="must"/><node pkg="own" type="tool.sh" name="$(arg must)"/>', "must"),
        ('<include file="$(find nowhere)/x.launch"/>', "no ROS package 'nowhere' in the bundle or in ROS: put it"),
        ("<node", "x.launch"),
        ("", "no node"),
        ('<node pkg="own" type="tool.sh" name="$(env WHO)"/>', "WHO"),
        (
            '<machine name="far" address="192.0.2.1" env-loader="/x"/>'
            '<node pkg="own" type="tool.sh" name="a" machine="far"/>',
            "one machine",
        ),
    ],
)
def test_what_cannot_be_run_is_refused_in_words(bundle: Path, text: str, words: str) -> None:
    with pytest.raises(LaunchRefused, match=words):
        plan(bundle, text)


def test_a_package_or_file_that_is_not_there_is_named(courier: Path) -> None:
    with pytest.raises(LaunchRefused, match="no ROS package 'nowhere'"):
        only(resolve_launch(LaunchSource(courier, "nowhere", "x.launch"), [{}]))
    with pytest.raises(LaunchRefused, match=r"no launch file 'x\.launch'"):
        only(resolve_launch(LaunchSource(courier, "courier", "x.launch"), [{}]))


def test_a_script_that_is_there_and_not_executable_is_named_with_the_command(bundle: Path) -> None:
    (bundle / "own/tool.sh").chmod(0o644)
    with pytest.raises(LaunchRefused, match=r"it is there: chmod \+x own/tool\.sh$"):
        plan(bundle, '<node pkg="own" type="tool.sh" name="a"/>')


def test_a_node_that_is_not_built_and_one_that_is_misspelled_are_named_with_what_to_do(bundle: Path) -> None:
    node = '<node pkg="own" type="driver" name="a"/>'
    with pytest.raises(LaunchRefused, match=r"; it has tool\.sh$"):
        plan(bundle, node)
    (bundle / "own/CMakeLists.txt").write_text("add_executable(driver src/driver.cpp)")
    with pytest.raises(LaunchRefused, match=r"its CMakeLists\.txt has it: build it, catkin_make install, and bring"):
        plan(bundle, node)


_GAZEBO = """<include file="$(find gazebo_ros)/launch/empty_world.launch">
  <arg name="world_name" value="$(find own)/hall.world"/><arg name="gui" value="false"/>
</include>
<param name="robot_description" textfile="$(find own)/bot.urdf"/>
<node pkg="gazebo_ros" type="spawn_model" name="spawn" args="-urdf -model bot -x 1.5 -Y -2 -param robot_description"/>
<node pkg="own" type="tool.sh" name="route"/>"""


def test_a_launch_file_that_starts_gazebo_is_read_without_gazebo(bundle: Path) -> None:
    (bundle / "own/hall.world").write_text("<sdf/>")
    (bundle / "own/bot.urdf").write_text("<robot/>")
    found = read_gazebo_launch(plan(bundle, _GAZEBO), bundle, {})
    assert found is not None
    assert (found.world, found.entity, found.description) == (bundle / "own/hall.world", "bot", "<robot/>")
    assert found.spawn == Start(x_m=1.5, y_m=0.0, yaw_rad=-2.0)
    assert [node.name for node in found.nodes] == ["/route"]
    assert found.findings == ()


def test_every_node_that_is_lost_is_named_beside_those_that_are_there(bundle: Path) -> None:
    (bundle / "own/launch/x.launch").write_text(
        '<launch><node pkg="nav" type="plan" name="a"/><node pkg="own" type="tool.sh" name="b"/>'
        '<node pkg="own" type="gone" name="c"/></launch>'
    )
    source = LaunchSource(bundle, "own", "x.launch")
    found = only(read_launch(source, [{}]))
    assert [node.name for node in found.nodes] == ["/b"]
    assert [each.split(":")[0] for each in found.lost] == ["/a (nav plan)", "/c (own gone)"]
    with pytest.raises(LaunchRefused, match=r"/a \(nav plan\).*'nav'.*/c \(own gone\)"):
        only(resolve_launch(source, [{}]))


def test_xacro_of_simyard_expands_where_ros_has_none(bundle: Path) -> None:
    (bundle / "own/part.xacro").write_text(
        '<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:property name="half" value="0.25"/></robot>'
    )
    (bundle / "own/bot.xacro").write_text(
        '<robot name="bot" xmlns:xacro="http://ros.org/wiki/xacro"><xacro:include filename="$(find own)/part.xacro"/>'
        '<xacro:arg name="mass" default="1"/><link name="a" mass="$(arg mass)" size="${2 * half}"/></robot>'
    )
    text = '<param name="d" command="$(find xacro)/xacro --inorder $(find own)/bot.xacro mass:=3"/>'
    found = plan(bundle, f'{text}<node pkg="own" type="tool.sh" name="a"/>')
    assert '<link mass="3" name="a" size="0.5"/>' in found.parameters["/d"]
