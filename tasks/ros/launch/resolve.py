"""Launch files, resolved by roslaunch itself: once for each bundle, launch file and environment."""

import base64
import json
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from xmlrpc.client import Binary

from specs.errors import LaunchRefused
from tasks.ros.launch.installation import RosInstallation, ros_installation
from tasks.ros.launch.launch_plan import LaunchPlan, NodePlan
from tasks.ros.launch.launch_reader import read_apart
from tasks.ros.launch.node_environment import make_home, node_environment
from tasks.ros.launch.roslaunch_program import PROGRAM

_LIMIT_S = 60.0


class LaunchSource(NamedTuple):
    """What decides what a launch file starts, besides the environment.

    Attributes:
        bundle: Folder that holds the ROS packages.
        package: The launch configuration's packageName.
        launch_file: Its launchFile.
    """

    bundle: Path
    package: str
    launch_file: str


def resolve(source: LaunchSource, environments: Sequence[Mapping[str, str]]) -> list[LaunchPlan | LaunchRefused]:
    """Returns for each environment what a launch file starts, or why roslaunch refuses it.

    Args:
        source: The launch file.
        environments: Episodes' environment variables, which ``$(env)`` and ``$(optenv)`` read.

    Raises:
        LaunchRefused: ROS is not here, or roslaunch does not answer.
    """
    installation = ros_installation()
    if installation.missing:
        raise LaunchRefused(installation.missing)
    keys = [tuple(sorted(each.items())) for each in environments]
    distinct = list(dict.fromkeys(keys))
    with tempfile.TemporaryDirectory(prefix="simyard-launch-") as folder:
        home = make_home(Path(folder), installation)
        uri = "http://127.0.0.1:11311/"
        asked = [node_environment(installation, source.bundle, uri, home, dict(key)) for key in distinct]
        answers = _answers(installation, source, home, asked)
    found = {key: _plan(source, answer) for key, answer in zip(distinct, answers, strict=True)}
    return [found[key] for key in keys]


def _answers(
    installation: RosInstallation, source: LaunchSource, home: Path, environments: list[dict[str, str]]
) -> list[str]:
    """Returns what roslaunch answers: imported once, it is asked for all environments."""
    command, where = [str(installation.python), "-c", PROGRAM, source.package, source.launch_file], _name(source)
    own = node_environment(installation, source.bundle, "", home, {})
    try:
        answer = read_apart(command, own, home, json.dumps(environments), _LIMIT_S + len(environments))
        return json.loads(answer)
    except LaunchRefused as exc:
        raise LaunchRefused(f"{where}: roslaunch: {exc}") from exc
    except ValueError as exc:
        raise LaunchRefused(f"{where}: roslaunch answers what is no list of nodes") from exc


def _plan(source: LaunchSource, text: str) -> LaunchPlan | LaunchRefused:
    answer = json.loads(text)
    if "refused" in answer:
        return LaunchRefused(f"{_name(source)}: {answer['refused']}")
    nodes = tuple(_node(each) for each in answer["nodes"])
    if not nodes:
        return LaunchRefused(f"{_name(source)}: it starts no node")
    return LaunchPlan(answer["file"], nodes, {key: _value(value) for key, value in answer["parameters"].items()})


def _name(source: LaunchSource) -> str:
    return f"{source.package} {source.launch_file}"


def _node(answer: dict[str, Any]) -> NodePlan:
    answer["command"] = tuple(answer["command"])
    answer["environment"] = tuple((name, value) for name, value in answer["environment"])
    return NodePlan(**answer)


def _value(value: Any) -> Any:  # noqa: ANN401 - what XML-RPC takes
    """Returns a parameter as XML-RPC takes it: bytes of a file are Binary again."""
    if isinstance(value, dict) and set(value) == {"binary"}:
        return Binary(base64.b64decode(value["binary"]))
    return value
