"""Launch files of ROS 2, resolved in a process of their own: a launch file in Python is the application's code.

ROS 2's own ``launch`` evaluates them where it is installed, the stand-ins elsewhere.

A bundle holds install spaces (``share/ament_index``), as ``colcon build`` makes them, or source packages
(``package.xml``), whose executables are found by name; an executable of a Python package that is not built is the
function that its ``setup.py`` or ``setup.cfg`` names.

The program for ROS 2's own ``launch`` is text here, because that is another Python than Simyard's, and has the modules
that it imports. Processes are noted where ``launch`` would start them. It asks and answers as the stand-ins' program.

Sources: ROS 2's design article "ament index"; setuptools' console scripts.
"""

import ast
import configparser
import itertools
import json
import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import yaml

import tasks
from specs.errors import LaunchRefused
from tasks.ros.launch.launch_plan import LaunchPlan, LaunchSource, NodePlan, run_launch_program
from tasks.ros.launch.packages import read_manifest
from tasks.ros.ros2.launch_file.gazebo_packages import make_gazebo_space
from tasks.ros.ros2.ros2_installation import Ros2Installation, joined_paths, ros2_installation

_DEPTH = 6
_INDEX = "share/ament_index/resource_index/packages"
_SCRIPT = re.compile(r"^\s*([\w.-]+)\s*=\s*([\w.]+):(\w+)\s*$")
# Folders of a source package that hold no programs.
_NO_PROGRAMS = frozenset({"launch", "test", "tests", "config", "params", "doc", "docs"})


class AmentPackage(NamedTuple):
    """A package.

    Attributes:
        share: Its folder of launch files, parameters and models.
        prefix: Where it is installed; its own folder if it is a source package.
        programs: Commands by an executable's name.
        python: Folders of Python modules that it brings.
    """

    share: str
    prefix: str
    programs: Mapping[str, list[str]]
    python: list[str]


def ament_packages(bundle: Path, installed: tuple[Path, ...], python: str) -> dict[str, AmentPackage]:
    """Returns the packages that a launch file may name; those of the bundle come before ROS 2's.

    Args:
        bundle: Folder that holds the ROS packages.
        installed: Where ROS 2 is installed.
        python: What runs executables of Python packages that are not built.

    Raises:
        LaunchRefused: A package.xml, setup.py or setup.cfg cannot be read.
    """
    found: dict[str, AmentPackage] = {}
    for prefix in reversed(installed):
        found.update(_installed(prefix))
    for folder in _package_folders(bundle):
        if (folder / _INDEX).is_dir():
            found.update(_installed(folder))
        else:
            name = read_manifest(folder / "package.xml").findtext("name", folder.name).strip()
            found[name] = AmentPackage(str(folder), str(folder), *_source_programs(folder, python))
    return found


def _package_folders(bundle: Path) -> Iterator[Path]:
    """Yields install spaces and folders with a package.xml; none lies inside another one."""
    todo = [(bundle, 0)]
    while todo:
        folder, depth = todo.pop()
        if (folder / _INDEX).is_dir() or (folder / "package.xml").is_file():
            yield folder
        elif depth < _DEPTH:
            todo += [(each, depth + 1) for each in sorted(folder.iterdir()) if each.is_dir() and not each.is_symlink()]


def _installed(prefix: Path) -> dict[str, AmentPackage]:
    """Returns the packages of an install space."""
    python = [str(each) for each in sorted(prefix.glob("lib/python3*/*-packages"))]
    found: dict[str, AmentPackage] = {}
    for name in sorted(each.name for each in (prefix / _INDEX).glob("*")):
        folder = prefix / "lib" / name
        programs = {each.name: [str(each)] for each in sorted(folder.glob("*")) if os.access(each, os.X_OK)}
        found[name] = AmentPackage(str(prefix / "share" / name), str(prefix), programs, python)
    return found


def _source_programs(folder: Path, python: str) -> tuple[dict[str, list[str]], list[str]]:
    """Returns the executables of a source package, and the folders of its Python modules."""
    programs: dict[str, list[str]] = {}
    for root, folders, files in os.walk(folder):
        folders[:] = sorted(each for each in folders if each not in _NO_PROGRAMS and not each.startswith("."))
        for path in (Path(root, each) for each in sorted(files)):
            if os.access(path, os.X_OK):
                programs.setdefault(path.name, [str(path)])
    modules = [each for each in (folder / "src", folder) if any(each.glob("*/__init__.py"))]
    for name, module, function in _console_scripts(folder):
        call = f"import sys; sys.argv[0] = {name!r}; from {module} import {function}; sys.exit({function}())"
        programs[name] = [python, "-c", call]
    return programs, [str(each) for each in modules]


def _console_scripts(folder: Path) -> list[tuple[str, str, str]]:
    """Returns name, module and function of a Python package's executables."""
    lines: list[str] = []
    try:
        if (folder / "setup.py").is_file():
            tree = ast.parse((folder / "setup.py").read_text())
            texts = (each.value for each in ast.walk(tree) if isinstance(each, ast.Constant))
            lines += [each for each in texts if isinstance(each, str)]
        if (folder / "setup.cfg").is_file():
            parser = configparser.ConfigParser(interpolation=None)
            parser.read(folder / "setup.cfg")
            lines += parser.get("options.entry_points", "console_scripts", fallback="").splitlines()
    except (SyntaxError, ValueError, RecursionError, MemoryError, configparser.Error) as exc:
        why = " ".join(str(exc).split())[:300]
        raise LaunchRefused(f"{folder.name}: its setup.py or setup.cfg cannot be read: {why}") from exc
    found = (_SCRIPT.match(each) for each in lines)
    return [(each[1], each[2], each[3]) for each in found if each]


PROGRAM = r"""
import json, logging, os, sys, tempfile
request = json.load(sys.stdin)
tempfile.tempdir = request["folder"]
from launch import LaunchContext
from launch.actions import ExecuteLocal, ExecuteProcess, RegisterEventHandler, Shutdown, TimerAction
from launch.launch_description_sources import AnyLaunchDescriptionSource
import launch_ros.actions

noted, before, absent = [], dict(os.environ), []
refused = (RegisterEventHandler, TimerAction, launch_ros.actions.LifecycleNode, launch_ros.actions.LoadComposableNodes,
           launch_ros.actions.ComposableNodeContainer)

class Absent(logging.Handler):
    # launch_ros warns of a file that is not there, and goes on without.
    def emit(self, record):
        said, mark = record.getMessage(), "Parameter file path is not a file: "
        if said.startswith(mark):
            absent.append(said[len(mark):])

logging.getLogger("launch_ros.actions.node").addHandler(Absent())

def note(self, context):
    self.prepare(context)
    details = self.process_description
    given = dict(details.final_env if details.final_env is not None else context.environment)
    changes = {name: value for name, value in given.items() if before.get(name) != value}
    changes.update({name: "" for name in before if name not in given})
    command = list(details.final_cmd)
    if getattr(self, "_ExecuteLocal__shell", False):
        command = ["/bin/sh", "-c", " ".join(command)]
    ros = isinstance(self, launch_ros.actions.Node)
    name = "/" + os.path.basename(details.final_cmd[0])
    if ros and self.is_node_name_fully_specified():
        name = self.node_name
    noted.append({
        "name": name, "package": str(getattr(self, "node_package", "") or "") if ros else "",
        "kind": os.path.basename(details.final_cmd[0]), "ros": ros, "command": command,
        "environment": sorted(changes.items()), "cwd": details.final_cwd or "",
        "required": isinstance(getattr(self, "_ExecuteLocal__on_exit", None), Shutdown),
        "respawn": bool(getattr(self, "_ExecuteLocal__respawn", False)), "absent": list(absent),
    })
    absent.clear()

ExecuteLocal.execute = note

def visit(entity, context):
    if isinstance(entity, refused):
        raise RuntimeError("%s is not done in lock-step: take it out of the launch file" % type(entity).__name__)
    for each in entity.visit(context) or ():
        visit(each, context)

try:
    context = LaunchContext()
    context.extend_locals({
        "current_launch_file_path": request["file"], "current_launch_file_directory": os.path.dirname(request["file"]),
    })
    visit(AnyLaunchDescriptionSource(request["file"]).get_launch_description(context), context)
    answer = {"processes": noted}
except (Exception, SystemExit) as exc:
    # What launch raises has no common root below Exception.
    answer = {"refused": " ".join(("%s: %s" % (type(exc).__name__, exc)).split())}
sys.stdout.write("\n" + json.dumps(answer) + "\n")
"""


_LIMIT_S = 60.0
_STAND_IN = "tasks.ros.ros2.launch_file.stand_in_program"
# Simulated time, after whatever the launch file says of it.
SIMULATED_TIME = ("-p", "use_sim_time:=true")


def resolve_description(source: LaunchSource, variables: Mapping[str, str], folder: Path) -> LaunchPlan:
    """Returns what a launch file of ROS 2 starts.

    Args:
        source: The launch file.
        variables: The episode's environment variables.
        folder: Where files of parameters are written to, for the nodes to read.

    Raises:
        LaunchRefused: It is not there, it needs what is not done, or it fails; says why.
    """
    installation, where = ros2_installation(), f"{source.package} {source.launch_file}"
    packages = ament_packages(source.bundle, installation.prefixes, installation.python)
    try:
        path = _launch_file(packages, installation, source)
        space = make_gazebo_space(folder, packages)
        read = _Reading(source.bundle, installation, packages, space)
        nodes = _nodes(_answer(read, path, variables, folder))
    except (LaunchRefused, OSError) as exc:
        raise LaunchRefused(f"{where}: {exc}") from exc
    except (ValueError, LookupError, TypeError) as exc:  # the file's own code may print what it likes
        raise LaunchRefused(f"{where}: it answers what is no list of processes") from exc
    if not nodes:
        raise LaunchRefused(f"{where}: it starts no node")
    return LaunchPlan(str(path), _distinct(nodes), _descriptions(nodes))


def _launch_file(packages: Mapping[str, AmentPackage], installation: Ros2Installation, source: LaunchSource) -> Path:
    if source.package not in packages:
        own = (name for name, each in packages.items() if Path(each.prefix) not in installation.prefixes)
        have = ", ".join(sorted(own)) or "no package at all"
        raise LaunchRefused(
            f"there is no ROS 2 package {source.package!r} in the bundle, which has {have}: name it as <name> of its "
            "package.xml does, or put it into the bundle"
        )
    share = Path(packages[source.package].share)
    for path in (share / source.launch_file, share / "launch" / source.launch_file):
        if path.is_file():
            return path
    found = sorted(share.rglob(Path(source.launch_file).name))
    if len(found) != 1:
        have = ", ".join(str(each.relative_to(share)) for each in found) or "none of that name"
        raise LaunchRefused(f"one launch file is meant, and {share} has {have}: name one by its path in the package")
    return found[0]


class _Reading(NamedTuple):
    """What a launch file is read with: the bundle, ROS 2, the packages of both, and what stands in for Gazebo's."""

    bundle: Path
    installation: Ros2Installation
    packages: Mapping[str, AmentPackage]
    space: Path

    def environment(self, folder: Path) -> dict[str, str]:
        """Returns what the launch file finds; the stand-ins come first."""
        spaces = install_spaces(self.packages, self.installation)
        given = self.installation.environment(spaces)
        shares = [str(each / "share") for each in (*spaces, *self.installation.prefixes, self.space)]
        return {
            **given,
            "AMENT_PREFIX_PATH": joined_paths([str(self.space)], given.get("AMENT_PREFIX_PATH", "")),
            "PATH": joined_paths([str(self.space / "bin")], given["PATH"]),
            "ROS_PACKAGE_PATH": joined_paths([str(self.bundle), *shares]),  # where xacro looks
            "LANG": "C.UTF-8",
            "HOME": str(folder),
            "TMPDIR": str(folder),
            "PYTHONDONTWRITEBYTECODE": "1",
        }


def _answer(read: _Reading, path: Path, variables: Mapping[str, str], folder: Path) -> dict[str, Any]:
    """Returns what the launch file starts, or ``refused`` and why."""
    own = {**variables, **read.environment(folder)}
    python_path, installation = own.get("PYTHONPATH", ""), read.installation
    command = [installation.python, "-c", PROGRAM]
    if not installation.here:
        command = [sys.executable, "-m", _STAND_IN]
        own |= {"PYTHONPATH": str(Path(tasks.__file__).parents[1]), "PYTHONSAFEPATH": "1"}
        own.pop("LD_LIBRARY_PATH", None)  # of another Python than this one
    folder.mkdir(parents=True, exist_ok=True)
    request = {
        "file": str(path),
        "folder": str(folder),
        "python_path": python_path,
        "packages": {name: each._asdict() for name, each in {**read.packages, **_installed(read.space)}.items()},
    }
    return json.loads(run_launch_program(command, own, folder, json.dumps(request), _LIMIT_S))


_STATE_PUBLISHER, _DESCRIPTION = "robot_state_publisher", "robot_description"
_MOST_PARAMETER_BYTES = 8 << 20


def _descriptions(nodes: Sequence[NodePlan]) -> dict[str, str]:
    """Returns the description that a launch file gives to a robot, as the parameter and the topic are called."""
    told = [each for node in nodes for each in _texts(node)]
    told += [each for node in nodes if node.package == _STATE_PUBLISHER for each in _urdf_argument(node)]
    return {f"/{_DESCRIPTION}": told[0]} if told else {}


def _texts(node: NodePlan) -> Iterator[str]:
    """Yields what a node's files of parameters call ``robot_description``."""
    for option, word in itertools.pairwise(node.command):
        path = Path(word)
        if option != "--params-file" or not path.is_file() or path.stat().st_size > _MOST_PARAMETER_BYTES:
            continue
        try:
            found = yaml.safe_load(path.read_bytes())
        except (yaml.YAMLError, ValueError, RecursionError):
            continue  # the node itself says what is wrong with its parameters
        for own in found.values() if isinstance(found, dict) else ():
            given = own.get("ros__parameters") if isinstance(own, dict) else None
            text = given.get(_DESCRIPTION) if isinstance(given, dict) else None
            if isinstance(text, str):
                yield text


def _urdf_argument(node: NodePlan) -> Iterator[str]:
    for word in node.command[1:]:
        path = Path(word)
        if path.suffix == ".urdf" and path.is_file() and path.stat().st_size <= _MOST_PARAMETER_BYTES:
            yield path.read_text(errors="replace")


def install_spaces(packages: Mapping[str, AmentPackage], installation: Ros2Installation) -> list[Path]:
    """Returns where a bundle's packages are installed; those that are not built are nowhere."""
    found = dict.fromkeys(Path(each.prefix) for each in packages.values() if each.prefix != each.share)
    return [each for each in found if each not in installation.prefixes]


def make_spaces(bundle: Path, installation: Ros2Installation, folder: Path) -> list[Path]:
    """Returns where nodes find the packages of their bundle, as ``get_package_share_directory`` looks for them.

    Args:
        bundle: Folder that holds the ROS packages.
        installation: ROS 2.
        folder: Where an index of packages that are not built is made.

    Raises:
        LaunchRefused: A package.xml, setup.py or setup.cfg cannot be read.
    """
    packages = ament_packages(bundle, (), installation.python)
    (folder / _INDEX).mkdir(parents=True, exist_ok=True)
    for name, package in packages.items():
        if package.prefix == package.share:
            (folder / _INDEX / name).touch()
            (folder / "share" / name).symlink_to(package.share)
    return [folder, *install_spaces(packages, installation)]


def _nodes(answer: Mapping[str, Any]) -> tuple[NodePlan, ...]:
    if "refused" in answer:
        raise LaunchRefused(str(answer["refused"]))
    return tuple(_node(each) for each in answer["processes"])


def _node(answer: Mapping[str, Any]) -> NodePlan:
    command = [*map(str, answer["command"]), *(SIMULATED_TIME if answer["ros"] else ())]
    return NodePlan(
        name=str(answer["name"]),
        package=str(answer["package"]),
        kind=str(answer["kind"]),
        command=tuple(command),
        environment=tuple((str(name), str(value)) for name, value in answer["environment"]),
        cwd=str(answer["cwd"]),
        required=bool(answer["required"]),
        respawn=bool(answer["respawn"]),
        absent=tuple(map(str, answer.get("absent", ()))),
    )


def _distinct(nodes: tuple[NodePlan, ...]) -> tuple[NodePlan, ...]:
    """Returns nodes of different names: two processes of one name get a number."""
    counts: dict[str, int] = {}
    found: list[NodePlan] = []
    for node in nodes:
        counts[node.name] = counts.get(node.name, 0) + 1
        again = counts[node.name]
        found.append(node if again == 1 else node._replace(name=f"{node.name}_{again}"))
    return tuple(found)
