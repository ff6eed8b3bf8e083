"""What a ROS launch file would start, found without starting it: in the confinement that applications run in.

A launch file runs programs when it is read (``<param command="...">``): reading one is running what its author wrote.
``python -m tasks.simulate.sandbox.launch_check`` is the process that reads it.
"""

import itertools
import json
import os
import shlex
import shutil
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path

import yaml
from pydantic import Field, ValidationError

from specs.base import Spec
from specs.errors import LaunchRefused, StageFailed
from specs.launched_file import PACKAGE_XML, bundle_files, is_ros2, package_folders
from specs.program_file import HEAD_BYTES, needed_programs, start_fault
from tasks.ros.launch.gazebo_launch import GazeboLaunch, read_gazebo_launch, shown_node
from tasks.ros.launch.launch_plan import (
    ImageLaunch,
    LaunchPlan,
    LaunchSource,
    NodePlan,
    read_launch,
    run_launch_program,
)
from tasks.ros.launch.node_topics import TypedTopic, WantedTopic, node_topics, own_programs
from tasks.ros.launch.packages import missing_packages, ros_installation, runtime_needs
from tasks.ros.launch.python2 import imported_modules, python2_sentences
from tasks.ros.ros2.launch_file.launch_description import ament_packages, resolve_description
from tasks.ros.ros2.ros2_installation import ros2_installation
from tasks.simulate.application.mjcf_check import RobotRefused
from tasks.simulate.host.declaration import ROBOT_FILE, read_ros_robot
from tasks.simulate.sandbox.confinement import Place, confined_command, confinement, require_confined
from tasks.simulate.sandbox.process_environment import process_environment
from tasks.storage.image_files import image_root, missing_program

_MODULE = "tasks.simulate.sandbox.launch_check"
_LIMIT_S = 90.0
# Of a report: names of nodes and packages, a robot's description, and for each environment a refusal.
_REPORT_BYTES, _REPORT_BYTES_EACH = 16 << 20, 1 << 14
_CLOCK = "/use_sim_time"
_ROBOT, _COMMANDS = "the robot", ("geometry_msgs/Twist", "geometry_msgs/TwistStamped")
_OWN_TOPICS = ("/clock", "/tf", "/tf_static", "/rosout", "/rosout_agg", "/gazebo/model_states")
# Nodes written for Python 2 ask for it; the home folder of an episode has it.
_OF_EACH_EPISODE = "python"
_NOT_OWN = "it is not this document's own bundle, and reading it would run what it says: install bubblewrap"
_NO_DDS = "nodes of ROS 2 need Cyclone DDS: pip install 'simyard[ros2]'"
# What nodes are written with, by what their package.xml, their Python or their linked program says.
_CLIENT_LIBRARIES = {"rclpy": (b">rclpy<", b"import rclpy", b"from rclpy"), "rclcpp": (b">rclcpp<", b"librclcpp.so")}
# How packages of messages are called; other names may be those of programs, which are not in ROS 2's index.
_OF_MESSAGES = ("_msgs", "_srvs", "_interfaces", "_actions")
_PROGRAM_BYTES = 64 << 20
_ROS2_PLACES = "AMENT_PREFIX_PATH, or below /opt/ros"
# What a refusal says that is no fault of the document: another machine may have it.
_OF_ROS2 = ("install ROS 2", *(f" needs {name}" for name in _CLIENT_LIBRARIES))
_PARAMETERS = "--params-file"


class LaunchReport(Spec):
    """What is known of a launch file before it is launched.

    Attributes:
        ros: Which ROS is here, and where; or why none is, and what to install.
        has_ros: Whether one is.
        nodes: What is started for each lane, such as ``/roam (roamer roam.py)``.
        lost: Nodes that cannot be started, and why; no episode begins without.
        gazebo: What it asks of Gazebo, with the first environment that it does so with.
        wants: Topics that its nodes subscribe to, as their programs say.
        gives: Topics that its nodes or its bundle's robot publish.
        undeclared: Topics that the bundle's robot lacks, and what in ``ros.yaml`` would declare their sensor.
        reads: What its nodes and the robot subscribe to, where the type is known.
        writes: What they publish so.
        unknown: Nodes that publish what nobody can read, such as those in C++.
        refusals: Why roslaunch refuses it, once for each environment that it does so for.
        missing: Packages that its package names and that are not here.
        absent: Files of parameters that nodes are named and that are not there, of each node.
        python2: What its nodes' programs have of Python 2, with file and line.
        simulated_clock: Whether it asks nodes itself to go by ``/clock``, as a robot has none.
        unread: Why it was not read; or empty.
        declaration: What is wrong with the bundle's ``ros.yaml``; or empty.
    """

    ros: str
    has_ros: bool
    nodes: tuple[str, ...] = ()
    lost: tuple[str, ...] = ()
    gazebo: GazeboLaunch | None = None
    wants: tuple[WantedTopic, ...] = ()
    gives: tuple[str, ...] = ()
    undeclared: dict[str, str] = Field(default_factory=dict[str, str])
    reads: tuple[TypedTopic, ...] = ()
    writes: tuple[TypedTopic, ...] = ()
    unknown: tuple[str, ...] = ()
    refusals: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()
    absent: tuple[str, ...] = ()
    python2: tuple[str, ...] = ()
    simulated_clock: bool = False
    unread: str = ""
    declaration: str = ""


def check_launch_file(source: LaunchSource, environments: Sequence[Mapping[str, str]], *, own: bool) -> LaunchReport:
    """Returns what a launch file would start.

    Args:
        source: The launch file.
        environments: Environment variables of episodes.
        own: Whether the bundle is the user's own; where nothing shuts it in, no other one is read.
    """
    if image := ImageLaunch.of(source, image_root(source.bundle)):
        report = _image_report(image)
    else:
        report = (_ros2_report if is_ros2(source.launch_file) else _ros1_report)(source, environments, own=own)
    try:
        robot = read_ros_robot(source.bundle)
    except RobotRefused as refused:
        return report.model_copy(update={"declaration": str(refused)})
    # NumPy, which messages are made with, is loaded where a robot is read alone.
    from tasks.ros.lockstep.robot_topics import published, undeclared  # noqa: PLC0415

    told = sorted((each.name, each.kind) for each in published(robot))
    names = [name for name, _ in told]
    found = {"gives": (*report.gives, *_OWN_TOPICS, *names), "undeclared": dict(undeclared(robot))}
    if (source.bundle / ROBOT_FILE).is_file():
        taken = _COMMANDS if is_ros2(source.launch_file) else _COMMANDS[:1]
        commands = [TypedTopic(node=_ROBOT, topic=robot.topics.command, types=taken)]
        tells = [TypedTopic(node=_ROBOT, topic=name, types=(kind,)) for name, kind in told if kind]
        found |= {"reads": (*report.reads, *commands), "writes": (*report.writes, *tells)}
    return report.model_copy(update=found)


def _image_report(image: ImageLaunch) -> LaunchReport:
    """Returns what is known of a container image that nobody has run yet."""
    why = missing_program(image.root, image.image, image.words, ros=True)
    ros = f"ROS {image.image.ros} in the container image {image.image.digest[:12]}"
    nodes = (shlex.join(image.words),)  # which may publish anything
    return LaunchReport(ros=ros, has_ros=True, nodes=nodes, unknown=nodes, refusals=(why,) if why else ())


def _ros1_report(source: LaunchSource, environments: Sequence[Mapping[str, str]], *, own: bool) -> LaunchReport:
    installation = ros_installation()
    report = LaunchReport(ros=installation.sentence, has_ros=not installation.missing)
    if installation.missing:
        return report
    try:
        report = report.model_copy(
            update={"missing": tuple(each.sentence for each in missing_packages(source.bundle, source.package))}
        )
    except LaunchRefused as exc:
        return report.model_copy(update={"refusals": (str(exc),)})
    return report.model_copy(update=_read(source, environments, own=own))


def _ros2_report(source: LaunchSource, environments: Sequence[Mapping[str, str]], *, own: bool) -> LaunchReport:
    """Returns what a launch file of ROS 2 would start; without ROS 2, Simyard's stand-ins read it.

    What they refuse for want of ROS 2 is then no fault of the document: another machine may have it.
    """
    installation = ros2_installation()
    report = LaunchReport(ros=installation.sentence, has_ros=True)
    if find_spec("cyclonedds") is None:
        return report.model_copy(update={"ros": _NO_DDS, "has_ros": False})
    if installation.fault:
        return report.model_copy(update={"ros": installation.fault, "has_ros": False})
    report = report.model_copy(update=_read(source, environments, own=own))
    wanting = [each for each in report.refusals if any(mark in each for mark in _OF_ROS2)]
    if installation.here or not wanting:
        return report
    why, faults = "; ".join(wanting), tuple(each for each in report.refusals if each not in wanting)
    lacks = "ROS 2 is not all here" if installation.prefixes else "no ROS 2 is here"
    said = f"{lacks} ({_ROS2_PLACES}), and {source.package} {source.launch_file} needs it: {why}"
    return report.model_copy(update={"ros": said, "has_ros": False, "refusals": faults})


def _read(source: LaunchSource, environments: Sequence[Mapping[str, str]], *, own: bool) -> dict[str, object]:
    """Returns the fields of a report that are known once the launch file was read."""
    if confinement().level == "process" and not own:
        return {"unread": _NOT_OWN}
    try:
        require_confined([source.bundle])
    except StageFailed as refused:
        return {"unread": refused.reason}
    return _read_apart(source, environments)


def _read_apart(source: LaunchSource, environments: Sequence[Mapping[str, str]]) -> dict[str, object]:
    """Returns the fields of a report that a process of its own finds out."""
    asked = json.dumps([dict(each) for each in environments])
    with tempfile.TemporaryDirectory(prefix="simyard-check-") as folder:
        place = Place(Path(folder), Path(folder))
        arguments = [str(source.bundle), source.package, source.launch_file]
        try:
            command = confined_command(_MODULE, arguments, place, [source.bundle])
            environment = process_environment(os.environ, place.programs) | place.variables()
            most_bytes = _REPORT_BYTES + len(environments) * _REPORT_BYTES_EACH
            said = run_launch_program(command, environment, place.folder, asked, _LIMIT_S, most_bytes=most_bytes)
            answer = LaunchReport.model_validate_json(said)
        except LaunchRefused as exc:
            return {"unread": f"the process that reads it: {exc}"}
        except ValidationError:
            return {"unread": "the process that reads it says nothing"}
    return {name: getattr(answer, name) for name in answer.model_fields_set - {"ros", "has_ros"}}


def _found(source: LaunchSource, environments: Sequence[Mapping[str, str]]) -> LaunchReport:
    plans = _plans(source, environments)
    good = [plan for plan in plans if isinstance(plan, LaunchPlan)]
    asked = [
        read_gazebo_launch(plan, source.bundle, own)
        for plan, own in zip(plans, environments, strict=True)
        if isinstance(plan, LaunchPlan)
    ]
    gazebo = next((each for each in asked if each), None)
    instead = {each.node for found in asked if found for each in found.replaced}
    every = {shown_node(node): node for plan in good for node in (*plan.nodes, *plan.tests)}
    nodes = {name: node for name, node in every.items() if name not in instead}
    topics = {name: node_topics(node, source.bundle) for name, node in nodes.items()}
    lost = dict.fromkeys(each for plan in good for each in plan.lost)
    for fault in (_unstartable, _unreadable):
        lost |= dict.fromkeys(each for node in nodes.values() for each in fault(source.bundle, node))
    refusals = dict.fromkeys(str(plan) for plan in plans if not isinstance(plan, LaunchPlan))
    clock = any(plan.parameters.get(_CLOCK) is True for plan in good)
    refusals |= dict.fromkeys(each for plan in good for each in _needed_of_ros2(source, plan))
    messages = dict.fromkeys(each for plan in good for each in _messages_of_ros2(source, plan))
    report = LaunchReport(
        ros="",
        has_ros=True,
        nodes=(*nodes,),
        lost=(*lost,),
        gazebo=gazebo,
        wants=tuple(WantedTopic(node=name, topic=topic) for name, own in topics.items() for topic in own.wants),
        gives=tuple(dict.fromkeys(topic for own in topics.values() for topic in own.gives)),
        reads=_typed((name, own.wanted_types) for name, own in topics.items()),
        writes=_typed((name, own.given_types) for name, own in topics.items()),
        unknown=tuple(name for name, own in topics.items() if not own.known),
        refusals=(*refusals,),
        simulated_clock=clock,
        absent=tuple(dict.fromkeys(each for node in nodes.values() for each in _absent(source.bundle, node))),
    )
    old = dict.fromkeys(each for node in every.values() for each in _python2(source.bundle, node))
    known = {"missing": (*messages,)} if messages else {}
    return report.model_copy(update={**known, "python2": (*old,)})


def _typed(nodes: Iterable[tuple[str, Mapping[str, str]]]) -> tuple[TypedTopic, ...]:
    """Returns topics of nodes with the one type that each has there."""
    return tuple(TypedTopic(node=name, topic=topic, types=(one,)) for name, own in nodes for topic, one in own.items())


def _unstartable(bundle: Path, node: NodePlan) -> Iterator[str]:
    """Yields why Linux does not start a node's own program, which is a file of the bundle, as its first bytes say."""
    program = Path(node.command[0])
    if not program.is_relative_to(bundle) or not program.is_file():
        return
    with program.open("rb") as file:
        head = file.read(HEAD_BYTES)
    shown = str(program.relative_to(bundle))
    if wrong := start_fault(head, shown):
        yield f"{shown_node(node)}: {wrong}"
        return
    path = os.pathsep.join((os.environ.get("PATH", ""), os.defpath))
    for name in needed_programs(head):
        if name != _OF_EACH_EPISODE and shutil.which(name, path=path) is None:
            yield f"{shown_node(node)}: {shown}, line 1: needs {name}, which is not here: install it, or name another"


def _unreadable(bundle: Path, node: NodePlan) -> Iterator[str]:
    """Yields why a node of ROS 2 ends at once: a file of parameters that it cannot read."""
    for flag, name in itertools.pairwise(node.command):
        path = Path(name)
        if flag == _PARAMETERS and path.is_relative_to(bundle) and (wrong := _parameters_fault(path)):
            yield f"{shown_node(node)}: {path.relative_to(bundle)}: {wrong}"


def _absent(bundle: Path, node: NodePlan) -> Iterator[str]:
    """Yields which files of parameters a node is started without, as ROS 2 does."""
    for name in node.absent:
        shown = name.removeprefix(f"{bundle}/")
        yield f"{shown_node(node)}: its file of parameters {shown} is not there, and ROS 2 starts it without"


def _parameters_fault(path: Path) -> str:
    try:
        found: object = yaml.safe_load(path.read_bytes())
    except (OSError, ValueError, RecursionError) as exc:
        return f"its parameters cannot be read: {exc}"
    except yaml.YAMLError as exc:
        mark = getattr(exc, "problem_mark", None)
        line = f"line {mark.line + 1}: " if mark else ""
        return f"{line}its parameters are no YAML: {getattr(exc, 'problem', None) or ' '.join(str(exc).split())}"
    return "" if isinstance(found, Mapping) else "holds no parameters: write them below NODE: and ros__parameters:"


def _python2(bundle: Path, node: NodePlan) -> Iterator[str]:
    """Yields what a node's own program has of Python 2; what ROS brings is not read."""
    for word in node.command:
        if word.startswith(f"{bundle}/"):
            yield from python2_sentences(Path(word), word.removeprefix(f"{bundle}/"))


def _plans(source: LaunchSource, environments: Sequence[Mapping[str, str]]) -> Sequence[LaunchPlan | LaunchRefused]:
    if not is_ros2(source.launch_file):
        try:
            return read_launch(source, environments)
        except LaunchRefused as exc:
            return [exc] * len(environments)
    found: list[LaunchPlan | LaunchRefused] = []
    with tempfile.TemporaryDirectory(prefix="simyard-check-") as folder:
        for number, variables in enumerate(environments):
            try:
                found.append(resolve_description(source, variables, Path(folder) / str(number)))
            except LaunchRefused as exc:
                found.append(exc)
    return found


def _needed_of_ros2(source: LaunchSource, plan: LaunchPlan) -> Iterator[str]:
    """Yields what nodes need of ROS 2 that is not here, as their packages and their programs' own text tell."""
    if not is_ros2(source.launch_file):
        return
    installation = ros2_installation()
    here = {"rclpy": bool(installation.python_paths("rclpy")), "rclcpp": installation.library("rclcpp")}
    lacking = [name for name in _CLIENT_LIBRARIES if not here[name]]
    files = bundle_files(source.bundle)
    for node in plan.nodes:
        manifests = _manifests(source.bundle, files, node)
        told = b"".join(map(_text, (*manifests, Path(node.command[0])))) if node.package else b""
        found = [name for name in lacking if any(mark in told for mark in _CLIENT_LIBRARIES[name])]
        for name in found:
            yield f"{shown_node(node)} needs {name}: install ros-{installation.distribution}-{name}"


def _messages_of_ros2(source: LaunchSource, plan: LaunchPlan) -> Iterator[str]:
    """Yields packages of messages that are not here; of several programs of a package not each may need them."""
    installation = ros2_installation()
    if not is_ros2(source.launch_file) or not installation.prefixes:
        return
    here = ament_packages(source.bundle, installation.prefixes, installation.python)
    files = bundle_files(source.bundle)
    for node in plan.nodes:
        names = {name for path in _manifests(source.bundle, files, node) for name in runtime_needs(path, "2")}
        needed = dict.fromkeys(sorted(names), f"{node.package} needs")
        for name, by in (needed | _imported_messages(source.bundle, files, node)).items():
            if name.endswith(_OF_MESSAGES) and name not in here and not installation.python_paths(name):
                package = f"ros-{installation.distribution}-{name.replace('_', '-')}"
                yield f"the ROS 2 package {name}, which {by}, is missing: install {package}"


def _imported_messages(bundle: Path, files: Sequence[str], node: NodePlan) -> dict[str, str]:
    """Returns packages that a node's program imports, with file and line, but modules of the bundle's own."""
    own = {part.removesuffix(".py") for each in files for part in each.split("/")}
    return {
        name: f"{program.relative_to(bundle)}, line {line} imports"
        for program in own_programs(node, bundle)
        for line, name in imported_modules(program)
        if name not in own
    }


def _manifests(bundle: Path, files: Sequence[str], node: NodePlan) -> list[Path]:
    found = [bundle / each / PACKAGE_XML for each in package_folders(files, node.package)] if node.package else []
    return [path for path in found if path.is_file()]


def _text(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(_PROGRAM_BYTES)
    except OSError:
        return b""


def main(arguments: Sequence[str]) -> None:
    """Prints the report of a launch file as its last line: bundle, package, launch file; environments come as input."""
    bundle, package, launch_file = arguments
    report = _found(LaunchSource(Path(bundle), package, launch_file), json.load(sys.stdin))
    # Whoever asked knows the rest already, such as missing packages of ROS 1.
    sys.stdout.write("\n" + report.model_dump_json(exclude_unset=True))


if __name__ == "__main__":
    main(sys.argv[1:])
