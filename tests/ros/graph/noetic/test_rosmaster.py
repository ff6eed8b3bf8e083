"""The graph answers as ROS's own master does, call by call."""

import subprocess
import time
import xmlrpc.client
from collections.abc import Generator
from pathlib import Path
from random import Random
from typing import Any

import pytest

from tests.ros.graph.episode import PUBLISHES, SUBSCRIBES, Episode
from tests.ros.graph.noetic.ros_episode import RosEpisode
from tests.servers.ports import free_port

pytestmark = [pytest.mark.long, pytest.mark.integration]
NAMES = ["/a", "/b", "~c", "d", "/e/f", "e/f/", "/e"]
PLAIN_NAMES = ["/a", "/b", "d", "/e/f", "e/f", "e"]
CALLERS = ["/one", "/two", "/space/three"]
TYPES = ["a/B", "*", "c/D"]
SERVICES = ["rosrpc://h:9", "rosrpc://g:9"]
VALUES = [1, "x", True, 0.5, [1, [2]], {"f": 1, "g": {"h": 2}}, {}, ""]
METHODS: dict[str, tuple[list[Any], ...]] = {
    "registerPublisher": (NAMES, TYPES, []),
    "unregisterPublisher": (NAMES, []),
    "registerSubscriber": (NAMES, TYPES, []),
    "unregisterSubscriber": (NAMES, []),
    "registerService": (NAMES, SERVICES, []),
    "unregisterService": (NAMES, SERVICES),
    "lookupService": (NAMES,),
    "lookupNode": ([*CALLERS, *NAMES],),
    "setParam": ([*NAMES, "/"], VALUES),
    "getParam": ([*NAMES, "/"],),
    "deleteParam": ([*NAMES, "/"],),
    "searchParam": (PLAIN_NAMES,),
    "subscribeParam": ([], NAMES),
    "unsubscribeParam": ([], NAMES),
    "hasParam": (NAMES,),
    "getPublishedTopics": (["", "/", "/e"],),
    "getSystemState": (),
    "getParamNames": (),
}
OWN = {topic.name for topic in (*PUBLISHES, *SUBSCRIBES)}


@pytest.fixture
def rosmaster(noetic: RosEpisode, tmp_path: Path) -> Generator[xmlrpc.client.ServerProxy]:
    """ROS's own master."""
    port = free_port()
    command = ["rosmaster", "--core", "-p", str(port)]
    with subprocess.Popen(
        command, env=noetic.environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=tmp_path
    ) as process:
        with xmlrpc.client.ServerProxy(f"http://127.0.0.1:{port}/") as master:
            while True:
                try:
                    master.getPid("/test")
                    break
                except ConnectionRefusedError:
                    assert process.poll() is None
                    time.sleep(0.05)
            yield master
        process.terminate()


def test_random_calls_have_the_answers_of_rosmaster(episode: Episode, rosmaster: xmlrpc.client.ServerProxy):
    chance = Random(7)  # noqa: S311 - which calls
    episode.call("deleteParam", "/use_sim_time")
    for _ in range(800):
        method, caller = chance.choice(sorted(METHODS)), chance.choice(CALLERS)
        # An empty list stands for the node's own address, where nobody listens.
        uri = f"http://127.0.0.1:{9 + CALLERS.index(caller)}/"
        arguments = [chance.choice(each or [uri]) for each in METHODS[method]]
        own, theirs = episode.call(method, *arguments, caller=caller), _call(rosmaster, method, caller, arguments)
        assert own[0] == theirs[0], (method, caller, arguments)
        if own[0] == 1:
            assert _plain(method, own[2]) == _plain(method, theirs[2]), (method, caller, arguments)


def _call(master: xmlrpc.client.ServerProxy, method: str, caller: str, arguments: list[Any]) -> list[Any]:
    found: Any = getattr(master, method)(caller, *arguments)
    return found


def _plain(method: str, value: Any) -> object:  # noqa: ANN401 - whatever a method answers
    """Returns an answer without its order, and without the robot."""
    if method == "getSystemState":
        return [sorted((key, sorted(nodes)) for key, nodes in each if nodes != ["/simyard"]) for each in value]
    if method == "getPublishedTopics":
        # Types differ where a topic had one before it had nobody: rosmaster never forgets it.
        return sorted(topic for topic, _ in value if topic not in OWN)
    return sorted(value) if method == "getParamNames" else value
