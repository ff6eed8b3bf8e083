"""Launch files of ROS 2 where ROS 2 is not: what they start, and what is refused by its name."""

import itertools
import signal
import stat
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from specs.data.world import Start
from specs.errors import LaunchRefused
from tasks.ros.launch.gazebo_launch import read_gazebo_launch
from tasks.ros.launch.launch_plan import LaunchPlan, LaunchSource, NodePlan
from tasks.ros.ros2.launch_file import robot_launch
from tasks.ros.ros2.launch_file.launch_description import resolve_description

_IMPORTS = """
import launch, launch_ros.actions, launch_ros.substitutions, launch.substitutions as s, launch.actions as a
from launch import LaunchDescription
from launch.conditions import IfCondition, UnlessCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch_ros.actions import Node, PushRosNamespace, SetParameter, SetRemap
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare
"""


class Bundle:
    """A bundle: ``robot``, a package that has the programs ``driver`` and ``mapper``, and ``bare``, that has none."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.package = folder / "bundle", folder / "bundle/src/robot"
        (self.package / "launch").mkdir(parents=True)
        (self.package / "scripts").mkdir()
        (self.package / "package.xml").write_text("<package><name>robot</name></package>")
        for name in ("driver", "mapper"):
            program = self.package / "scripts" / name
            program.write_text("#!/bin/sh\n")
            program.chmod(program.stat().st_mode | stat.S_IXUSR)
        (folder / "bundle/src/bare").mkdir()
        (folder / "bundle/src/bare/package.xml").write_text("<package><name>bare</name></package>")
        self.parameters = folder / "parameters"

    def write(self, entities: str, name: str = "robot.launch.py") -> None:
        """Writes a launch file of these entities."""
        body = f"def generate_launch_description():\n    return LaunchDescription([{entities}])\n"
        (self.package / "launch" / name).write_text(_IMPORTS + body)

    def resolve(self, name: str = "robot.launch.py", **variables: str) -> LaunchPlan:
        """Returns what a launch file starts."""
        return resolve_description(LaunchSource(self.folder, "robot", name), variables, self.parameters)

    def node(self, entities: str, **variables: str) -> NodePlan:
        """Returns the one node that a launch file of these entities starts."""
        self.write(entities)
        (node,) = self.resolve(**variables).nodes
        return node


@pytest.fixture
def bundle(tmp_path: Path) -> Bundle:
    return Bundle(tmp_path)


def test_a_node_gets_its_name_arguments_and_simulated_time(bundle: Bundle) -> None:
    node = bundle.node(
        "Node(package='robot', executable='driver', name='wheels', namespace='left', output='screen', "
        "arguments=['--fast'], remappings=[('cmd_vel', '/cmd_vel')], ros_arguments=['--log-level', 'info'])"
    )
    program = str(bundle.package / "scripts/driver")
    begin = (program, "--fast", "--ros-args", "--log-level", "info", "-r", "__node:=wheels", "-r", "__ns:=/left")
    assert node.command == (*begin, "-r", "cmd_vel:=/cmd_vel", "-p", "use_sim_time:=true")
    assert (node.name, node.package, node.kind) == ("/left/wheels", "robot", "driver")


def test_parameters_become_a_file_of_the_nodes_own(bundle: Bundle) -> None:
    node = bundle.node(
        "a.DeclareLaunchArgument('speed', default_value='0.5'), Node(package='robot', executable='driver', name='d', "
        "parameters=[{'speed': s.LaunchConfiguration('speed'), 'frames': {'base': 'base_link'}, 'ids': [1, 2], "
        "'text': ParameterValue(s.LaunchConfiguration('speed'), value_type=str)}])"
    )
    path = node.command[node.command.index("--params-file") + 1]
    values = {"speed": 0.5, "frames.base": "base_link", "ids": [1, 2], "text": "0.5"}
    assert yaml.safe_load(Path(path).read_text()) == {"/**": {"ros__parameters": values}}
    assert Path(path).parent == bundle.parameters


def test_groups_scope_namespaces_remappings_parameters_and_the_environment(bundle: Bundle) -> None:
    bundle.write(
        "a.GroupAction([PushRosNamespace('/arm'), SetRemap('in', 'out'), SetParameter('gain', 2), "
        "a.SetEnvironmentVariable('MODE', 'inner'), Node(package='robot', executable='driver', name='one')]), "
        "Node(package='robot', executable='mapper', name='two')"
    )
    one, two = bundle.resolve().nodes
    assert one.command[1:] == (
        *("--ros-args", "-r", "__node:=one", "-r", "__ns:=/arm", "-p", "gain:=2", "-r", "in:=out"),
        *("-p", "use_sim_time:=true"),
    )
    assert dict(one.environment) == {"MODE": "inner"}
    assert two.command[1:] == ("--ros-args", "-r", "__node:=two", "-p", "use_sim_time:=true")
    assert two.environment == ()


def test_conditions_and_expressions_choose_nodes_by_the_environment(bundle: Bundle) -> None:
    bundle.write(
        "a.DeclareLaunchArgument('map', default_value=s.EnvironmentVariable('MAP', default_value='false')), "
        "Node(package='robot', executable='mapper', condition=IfCondition(s.LaunchConfiguration('map'))), "
        "Node(package='robot', executable='driver', condition=UnlessCondition(s.PythonExpression("
        "['\"', s.LaunchConfiguration('map'), '\" == \"true\"'])))"
    )
    assert [node.kind for node in bundle.resolve().nodes] == ["driver"]
    assert [node.kind for node in bundle.resolve(MAP="true").nodes] == ["mapper"]


def test_a_package_is_found_while_the_file_is_read(bundle: Bundle) -> None:
    node = bundle.node("Node(package='robot', executable='driver', arguments=[FindPackageShare('x').find('robot')])")
    assert node.command[1] == str(bundle.package)


def test_an_included_launch_file_takes_arguments_and_paths_in_packages(bundle: Bundle) -> None:
    bundle.write(
        "a.DeclareLaunchArgument('who'), Node(package='robot', executable='driver', name=s.LaunchConfiguration('who'), "
        "arguments=[s.PathJoinSubstitution([FindPackageShare('robot'), 'maps', 'a.yaml'])])",
        "inner.launch.py",
    )
    node = bundle.node(
        "a.IncludeLaunchDescription(PythonLaunchDescriptionSource([s.ThisLaunchFileDir(), '/inner.launch.py']), "
        "launch_arguments={'who': 'guest'}.items())"
    )
    assert node.name == "/guest"
    assert node.command[1] == str(bundle.package / "maps/a.yaml")


def test_a_function_of_the_launch_file_and_a_process_are_done(bundle: Bundle) -> None:
    (bundle.package / "launch/robot.launch.py").write_text(
        _IMPORTS + "def more(context):\n"
        "    text = s.LaunchConfiguration('n').perform(context)\n"
        "    return [a.ExecuteProcess(cmd=['sleep', text], additional_env={'A': 'b'}, on_exit=a.Shutdown())]\n"
        "def generate_launch_description():\n"
        "    found = LaunchDescription()\n"
        "    found.add_action(a.DeclareLaunchArgument('n', default_value='3'))\n"
        "    found.add_action(a.OpaqueFunction(function=more))\n"
        "    return found\n"
    )
    (node,) = bundle.resolve().nodes
    assert node.command == ("sleep", "3"), "what is no node of ROS 2 is told nothing of simulated time"
    assert (dict(node.environment), node.required) == ({"A": "b"}, True)


def test_an_executable_of_a_python_package_that_is_not_built_is_its_function(bundle: Bundle) -> None:
    (bundle.package / "src/robot").mkdir(parents=True)
    (bundle.package / "src/robot/__init__.py").touch()
    (bundle.package / "setup.py").write_text(
        "from setuptools import setup\nsetup(entry_points={'console_scripts': ['turn = robot.turn:main']})\n"
    )
    node = bundle.node("Node(package='robot', node_executable='turn', node_name='rotate')")
    assert node.command[1] == "-c"
    assert "from robot.turn import main" in node.command[2]
    assert dict(node.environment) == {"PYTHONPATH": str(bundle.package / "src")}


def test_an_install_space_has_its_programs_below_lib(tmp_path: Path) -> None:
    prefix = tmp_path / "install"
    for folder in ("share/ament_index/resource_index/packages", "share/robot/launch", "lib/robot"):
        (prefix / folder).mkdir(parents=True)
    (prefix / "share/ament_index/resource_index/packages/robot").touch()
    (prefix / "lib/robot/driver").write_text("#!/bin/sh\n")
    (prefix / "lib/robot/driver").chmod(0o755)
    body = (
        "def generate_launch_description():\n return LaunchDescription([Node(package='robot', executable='driver')])\n"
    )
    (prefix / "share/robot/launch/robot.launch.py").write_text(_IMPORTS + body)
    plan = resolve_description(LaunchSource(tmp_path, "robot", "robot.launch.py"), {}, tmp_path / "parameters")
    assert plan.nodes[0].command[0] == str(prefix / "lib/robot/driver")


@pytest.mark.parametrize(
    ("entities", "why"),
    [
        ("a.TimerAction(period=1.0, actions=[])", r"line \d+: launch.actions.TimerAction is not done"),
        ("a.RegisterEventHandler(None)", "launch.actions.RegisterEventHandler is not done"),
        (
            "a.LogInfo(msg='x'), a.SetLaunchConfiguration('x', s.Command(['false']))",
            "'false' fails: it ends with status 1",
        ),
        ("a.SetLaunchConfiguration('x', s.Command('no-such-program x'))", "cannot be run: .*no-such-program"),
        ("launch_ros.actions.LifecycleNode(name='a')", "launch_ros.actions.LifecycleNode is not done"),
        ("Node(package='nav2', executable='a')", "no package 'nav2' in the bundle or in ROS 2"),
        ("Node(package='robot', executable='a')", "no executable 'a'; it has driver, mapper"),
        ("Node(package='robot', executable='driver', name=s.LaunchConfiguration('n'))", "'n' has no value"),
        ("Node(package='bare', executable='a')", "'a', and none at all: build it with colcon"),
        ("Node(package='robot', executable='driver', exit_at=3)", "Node: exit_at is not done"),
        ("", "it starts no node"),
        ("1 / 0", "ZeroDivisionError"),
        ("__import__('nav2_common')", "it imports nav2_common, which is not here"),
        ("a.IncludeLaunchDescription(s.TextSubstitution(text='/a.launch.xml'))", "/a.launch.xml is not there"),
    ],
)
def test_what_is_not_done_or_wrong_is_refused_by_name(bundle: Bundle, entities: str, why: str) -> None:
    bundle.write(entities)
    with pytest.raises(LaunchRefused, match=f"^robot robot.launch.py: .*{why}"):
        bundle.resolve()


@pytest.mark.parametrize(
    ("code", "why"),
    [
        ("import atexit; atexit.register(print, 'bye')", "answers what is no list of processes"),
        ("import atexit; atexit.register(print, '{\"processes\": [{}]}')", "answers what is no list of processes"),
        ("import os; os._exit(0)", "it ends without an answer"),
    ],
)
def test_a_launch_file_that_answers_by_itself_is_refused(bundle: Bundle, code: str, why: str) -> None:
    bundle.write("Node(package='robot', executable='driver')")
    path = bundle.package / "launch/robot.launch.py"
    path.write_text(f"{path.read_text()}\n{code}\n")
    with pytest.raises(LaunchRefused, match=why):
        bundle.resolve()


@pytest.mark.parametrize(("name", "text"), [("setup.py", "def ("), ("setup.cfg", "no section"), ("setup.py", "\0")])
def test_a_setup_file_that_cannot_be_read_is_refused(bundle: Bundle, name: str, text: str) -> None:
    (bundle.package / name).write_text(text)
    with pytest.raises(LaunchRefused, match=r"robot: its setup\.py or setup\.cfg cannot be read"):
        bundle.resolve()


_XML = """<launch>
  <arg name="who" default="guest"/>
  <let name="both" value="$(var who)-$(env SIDE left)"/>
  <group if="$(eval '\\'$(var who)\\' == &quot;guest&quot;')">
    <push-ros-namespace namespace="house"/>
    <node pkg="robot" exec="driver" name="$(var both)" args="--file '$(find-pkg-share robot)/a b' -x $(env X 2)">
      <param name="gain" value="2.5"/><param name="frames"><param name="base" value="7" type="str"/></param>
      <remap from="cmd_vel" to="/cmd_vel"/><env name="MODE" value="x"/>
    </node>
  </group>
  <node pkg="robot" exec="mapper" unless="true"/>
  <include file="$(dirname)/inner.launch.py"><arg name="n" value="3"/></include>
</launch>"""


def test_a_launch_file_in_xml_starts_what_the_same_in_python_does(bundle: Bundle) -> None:
    bundle.write("a.ExecuteProcess(cmd=['sleep', s.LaunchConfiguration('n')])", "inner.launch.py")
    (bundle.package / "launch/robot.launch.xml").write_text(_XML)
    node, sleep = bundle.resolve("robot.launch.xml", SIDE="right").nodes
    assert node.name == "/house/guest-right"
    assert node.command[1:5] == ("--file", f"{bundle.package}/a b", "-x", "2")
    assert node.command[-4:] == ("-r", "cmd_vel:=/cmd_vel", "-p", "use_sim_time:=true")
    values = yaml.safe_load(Path(node.command[node.command.index("--params-file") + 1]).read_text())
    assert values == {"/house/guest-right": {"ros__parameters": {"gain": 2.5, "frames.base": "7"}}}
    assert dict(node.environment) == {"MODE": "x"}
    assert sleep.command == ("sleep", "3")


def test_of_parameters_in_xml_the_last_ones_count(bundle: Bundle) -> None:
    own = bundle.package / "own.yaml"
    own.write_text("/**: {ros__parameters: {gain: 2.0}}")
    file, gain = f'<param from="{own}"/>', '<param name="gain" value="{}"/>'
    parameters = f"{gain.format(1.0)}{file}{gain.format(3.0)}"
    text = f'<launch><node pkg="robot" exec="driver" name="a">{parameters}</node></launch>'
    (bundle.package / "launch/robot.launch.xml").write_text(text)
    (node,) = bundle.resolve("robot.launch.xml").nodes
    files = [Path(each) for before, each in itertools.pairwise(node.command) if before == "--params-file"]
    read = [next(iter(yaml.safe_load(each.read_text()).values())) for each in files]
    assert [each["ros__parameters"]["gain"] for each in read] == [1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("<launch><timer/></launch>", "<timer> is not done"),
        ("<launch><node exec='a'/></launch>", "<node> has no pkg"),
        ("<launch><log message='$(var'/><let name='a' value='$(var'/></launch>", "a substitution does not end"),
        ("<launch><let name='a' value='$(anon x)'/></launch>", r"\$\(anon\) is not done"),
        ("<launch><let name='a' value='$(var)'/></launch>", r"\$\(var\): .*missing 1 required"),
        ("<!DOCTYPE a [<!ENTITY b 'c'>]><launch/>", "no document type"),
        ("<robot/>", "its outermost element is <robot>"),
        ("<launch", "not a launch file"),
    ],
)
def test_what_is_not_done_or_wrong_in_xml_is_refused_by_name(bundle: Bundle, text: str, why: str) -> None:
    (bundle.package / "launch/robot.launch.xml").write_text(text)
    with pytest.raises(LaunchRefused, match=why):
        bundle.resolve("robot.launch.xml")


def test_launch_files_in_yaml_are_refused(bundle: Bundle) -> None:
    (bundle.package / "launch/robot.launch.yaml").write_text("launch: []")
    with pytest.raises(LaunchRefused, match="YAML are not done without ROS 2"):
        bundle.resolve("robot.launch.yaml")


def test_packages_and_launch_files_that_are_not_there_are_named(bundle: Bundle) -> None:
    with pytest.raises(LaunchRefused, match="has none of that name: name one by its path in the package"):
        bundle.resolve("other.launch.py")
    own = "no ROS 2 package 'ro' in the bundle, which has bare, robot: name it as <name> of its package.xml does"
    with pytest.raises(LaunchRefused, match=own):
        resolve_description(LaunchSource(bundle.folder, "ro", "robot.launch.py"), {}, bundle.parameters)


_XACRO = """<robot name="rover" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:property name="wide" value="$(arg wide)"/><link name="base_of_${wide}"/></robot>"""
_PUBLISHER = """Node(package='robot_state_publisher', executable='robot_state_publisher', parameters=[{
    'robot_description': ParameterValue(s.Command(['xacro ', FindPackageShare('robot'), '/rover.xacro wide:=3']),
    value_type=str)}])"""
_SERVERS = {
    "gazebo_ros": "a.IncludeLaunchDescription(PythonLaunchDescriptionSource([FindPackageShare('gazebo_ros'), "
    "'/launch/gazebo.launch.py']), launch_arguments={'world': [FindPackageShare('robot'), '/hall.sdf']}.items())",
    "ros_gz_sim": "a.IncludeLaunchDescription(PythonLaunchDescriptionSource([FindPackageShare('ros_gz_sim'), "
    "'/launch/gz_sim.launch.py']), launch_arguments={'gz_args': ['-r -s -v 2 ', FindPackageShare('robot'), "
    "'/hall.sdf']}.items())",
    "by itself": "a.ExecuteProcess(cmd=['ign gazebo -r', [FindPackageShare('robot'), '/hall.sdf']], shell=True)",
}
_SPAWNERS = {
    "gazebo_ros": "'spawn_entity.py', arguments=['-entity', 'rover'",
    "ros_gz_sim": "'create', arguments=['-name', 'rover'",
}


@pytest.mark.parametrize(("server", "spawner"), [*zip(_SPAWNERS, _SPAWNERS, strict=True), ("by itself", "ros_gz_sim")])
def test_what_starts_gazebo_is_read_and_not_started(bundle: Bundle, server: str, spawner: str) -> None:
    (bundle.package / "hall.sdf").write_text("<sdf version='1.9'/>")
    (bundle.package / "rover.xacro").write_text(_XACRO)
    spawn = f"Node(package='{spawner}', executable={_SPAWNERS[spawner]}, '-topic', 'robot_description', '-x', '1.5', "
    bridge = "Node(package='ros_gz_bridge', executable='parameter_bridge', arguments=['/clock'])"
    driver = "Node(package='robot', executable='driver', name='wheels')"
    bundle.write(f"{_SERVERS[server]}, {_PUBLISHER}, {spawn}'-Y', s.EnvironmentVariable('YAW')]), {bridge}, {driver}")
    found = read_gazebo_launch(bundle.resolve(YAW="-0.5"), bundle.folder, {})
    assert found is not None
    assert found.world == bundle.package / "hall.sdf"
    assert (found.entity, found.spawn) == ("rover", Start(x_m=1.5, y_m=0.0, yaw_rad=-0.5))
    assert found.description is not None
    assert '<link name="base_of_3"/>' in found.description
    assert [each.name for each in found.nodes] == ["/wheels"]
    assert [each.by.split(":")[0].split(",")[0] for each in found.replaced] == [
        "Simyard's engine",
        "the frames of the robot's base and sensors; no others",
        "the robot of robot.xml",
        "the robot's own topics",
    ]
    assert found.findings == ()


@pytest.mark.parametrize("text", ["/driver:\n  ros__parameters:\n", "/driver: {ros__parameters: [1]}", "[1]"])
def test_files_of_parameters_that_hold_none_describe_no_robot(bundle: Bundle, text: str) -> None:
    (bundle.package / "empty.yaml").write_text(text)
    bundle.write(f"Node(package='robot', executable='driver', parameters=['{bundle.package}/empty.yaml'])")
    assert bundle.resolve().parameters == {}


def test_a_robots_nodes_end_if_one_after_them_cannot_be_started(monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[subprocess.Popen[bytes]] = []

    def start(node: NodePlan, _: dict[str, str]) -> "subprocess.Popen[bytes]":
        if node.name == "/b":
            raise OSError("no such program")
        started.append(subprocess.Popen(["sleep", "1000"]))
        return started[-1]

    plan = LaunchPlan("", tuple(NodePlan(name, "", "", ("x",)) for name in ("/a", "/b")), {})
    monkeypatch.setattr(sys, "argv", ["", "bundle", "play", "play.launch.py"])
    monkeypatch.setattr(robot_launch, "resolve_description", lambda *_: plan)
    monkeypatch.setattr(robot_launch, "make_spaces", lambda *_: ())
    monkeypatch.setattr(robot_launch, "_start", start)
    status = robot_launch.main()
    ended = started[0].poll()
    started[0].kill()
    assert (status, ended) == (1, -signal.SIGINT)


def test_a_node_that_is_to_respawn_is_started_anew_until_the_launch_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """``/b`` ends twice; the third time it ends its neighbour, which is required, as soon as that one is there."""
    count, other = tmp_path / "count", tmp_path / "other"
    ending = f"until [ -f {other} ]; do sleep 0.01; done; kill $(cat {other}); exec sleep 1000"
    again = f'echo >> {count}; [ "$(wc -l < {count})" -lt 3 ] || {{ {ending}; }}; exit 1'
    required = f"echo $$ > {other}.partly; mv {other}.partly {other}; exec sleep 1000"
    nodes = (
        NodePlan("/a", "", "", ("sh", "-c", required), required=True),
        NodePlan("/b", "", "", ("sh", "-c", again), respawn=True),
    )
    monkeypatch.setattr(sys, "argv", ["", "bundle", "play", "play.launch.py"])
    monkeypatch.setattr(robot_launch, "resolve_description", lambda *_: LaunchPlan("", nodes, {}))
    monkeypatch.setattr(robot_launch, "make_spaces", lambda *_: ())
    monkeypatch.setattr(robot_launch, "_RESPAWN_S", 0.01)
    kept: list[subprocess.Popen[bytes]] = []
    end = robot_launch._end
    monkeypatch.setattr(robot_launch, "_end", lambda processes: kept.extend(processes) or end(processes))
    assert robot_launch.main() == signal.SIGTERM
    assert len(kept) == len(nodes), "it grows with no start"
    assert count.read_text() == "\n" * 3
