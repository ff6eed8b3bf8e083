"""Launch files of ROS 2, resolved in a process of their own: a launch file in Python is the application's code."""

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tasks
from specs.errors import LaunchRefused
from tasks.ros.launch.launch_plan import LaunchPlan, NodePlan
from tasks.ros.launch.launch_reader import read_apart
from tasks.ros.launch.resolve import LaunchSource
from tasks.ros.ros2.launch_file.ament_packages import AmentPackage, ament_packages
from tasks.ros.ros2.launch_file.ros2_installation import Ros2Installation, ros2_installation
from tasks.ros.ros2.launch_file.ros2_launch_program import PROGRAM

_LIMIT_S = 60.0
_STAND_IN = "tasks.ros.ros2.launch_file.stand_in.program"
_LAUNCH_FILES = (".launch.py", ".launch.xml", ".launch.yaml", ".launch.yml", "_launch.py", ".py")
# Simulated time, after whatever the launch file says of it.
_SIMULATED_TIME = ("-p", "use_sim_time:=true")


def is_ros2_launch_file(name: str) -> bool:
    """Returns whether a launch file's name is one of ROS 2: ROS 1 has ``.launch`` alone."""
    return name.endswith(_LAUNCH_FILES)


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
        path = _launch_file(packages, source)
        nodes = _nodes(_answer(installation, packages, path, variables, folder))
    except (LaunchRefused, OSError) as exc:
        raise LaunchRefused(f"{where}: {exc}") from exc
    except (ValueError, LookupError, TypeError) as exc:  # the file's own code may print what it likes
        raise LaunchRefused(f"{where}: it answers what is no list of processes") from exc
    if not nodes:
        raise LaunchRefused(f"{where}: it starts no node")
    return LaunchPlan(str(path), _distinct(nodes), {})


def _launch_file(packages: Mapping[str, AmentPackage], source: LaunchSource) -> Path:
    if source.package not in packages:
        have = ", ".join(sorted(packages)) or "no package at all"
        raise LaunchRefused(f"there is no ROS 2 package {source.package!r} in the bundle, which has {have}")
    share = Path(packages[source.package].share)
    for path in (share / source.launch_file, share / "launch" / source.launch_file):
        if path.is_file():
            return path
    found = sorted(share.rglob(Path(source.launch_file).name))
    if len(found) != 1:
        raise LaunchRefused(
            f"the package has {'more than one' if found else 'no'} launch file of that name below {share}"
        )
    return found[0]


def _answer(
    installation: Ros2Installation,
    packages: Mapping[str, AmentPackage],
    path: Path,
    variables: Mapping[str, str],
    folder: Path,
) -> dict[str, Any]:
    """Returns what the launch file starts, or ``refused`` and why."""
    own = {**variables, **installation.environment(), "LANG": "C.UTF-8", "HOME": str(folder), "TMPDIR": str(folder)}
    own["PYTHONDONTWRITEBYTECODE"] = "1"
    command = [installation.python, "-c", PROGRAM]
    if not installation.here:
        command = [sys.executable, "-m", _STAND_IN]
        own |= {"PYTHONPATH": str(Path(tasks.__file__).parents[1]), "PYTHONSAFEPATH": "1"}
    own["AMENT_PREFIX_PATH"] = ":".join(dict.fromkeys([*_prefixes(packages), *map(str, installation.prefixes)]))
    folder.mkdir(parents=True, exist_ok=True)
    request = {
        "file": str(path),
        "folder": str(folder),
        "packages": {name: each._asdict() for name, each in packages.items()},
    }
    return json.loads(read_apart(command, own, folder, json.dumps(request), _LIMIT_S))


def _prefixes(packages: Mapping[str, AmentPackage]) -> list[str]:
    return [each.prefix for each in packages.values() if each.prefix != each.share]


def _nodes(answer: Mapping[str, Any]) -> tuple[NodePlan, ...]:
    if "refused" in answer:
        raise LaunchRefused(str(answer["refused"]))
    return tuple(_node(each) for each in answer["processes"])


def _node(answer: Mapping[str, Any]) -> NodePlan:
    command = [*map(str, answer["command"]), *(_SIMULATED_TIME if answer["ros"] else ())]
    return NodePlan(
        name=str(answer["name"]),
        package=str(answer["package"]),
        kind=str(answer["kind"]),
        command=tuple(command),
        environment=tuple((str(name), str(value)) for name, value in answer["environment"]),
        cwd=str(answer["cwd"]),
        required=bool(answer["required"]),
        respawn=bool(answer["respawn"]),
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
