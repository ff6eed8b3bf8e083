"""The robot among processes with nodes: one participant for each, so that one process at a time is told."""

import itertools
import time
from collections.abc import Callable, Iterator
from uuid import UUID

import pytest

from tasks.ros.lockstep.ros2_lockstep import DdsGraph
from tasks.ros.ros2 import discovery_watch
from tasks.ros.ros2.dds_domain import FAST, EpisodeDomain, LinkPlace
from tasks.ros.ros2.dds_node import DEFAULT, DdsNode, Profile, Reader, Writer, told_nodes
from tasks.ros.ros2.interface_types import type_store
from tasks.ros.ros2.robot_links import RobotLinks
from tasks.ros.ros2.ros2_node import STAMPED, TWIST, RobotInterface
from tests.servers.eventually import eventually

SCAN, KIND = "/scan", "std_msgs/msg/String"
_numbers = itertools.count(5000)


class Process:
    """What a process with one node has: it reads the scan and writes commands."""

    def __init__(self, domain: EpisodeDomain, name: str, kind: str = TWIST, *, reliable: bool = True) -> None:
        own = f"<Discovery><ExternalDomainId>{domain.number}</ExternalDomainId>"
        self.node = DdsNode(LinkPlace(next(_numbers), domain.uri.replace("<Discovery>", own)), name)
        self.scan: Reader = self.node.subscription(SCAN, KIND, DEFAULT)
        self.commands: Writer = self.node.publisher("/cmd_vel", kind, Profile(reliable=reliable))
        self.node.announce()

    def close(self) -> None:
        """Ends it."""
        self.__dict__.pop("scan", None)
        self.__dict__.pop("commands", None)
        self.node.close()


@pytest.fixture
def robot(domain: EpisodeDomain) -> Iterator[RobotLinks]:
    made = RobotLinks(domain, RobotInterface({SCAN: KIND, "/tf_static": KIND}, "/cmd_vel"))
    yield made
    made.close()


@pytest.fixture
def start(domain: EpisodeDomain) -> Iterator[Callable[..., Process]]:
    made: list[Process] = []

    def start(name: str, kind: str = TWIST, *, reliable: bool = True) -> Process:
        made.append(Process(domain, name, kind, reliable=reliable))
        return made[-1]

    yield start
    for each in made:
        each.close()


def _complete(robot: RobotLinks, count: int) -> bool:
    robot.find()
    return len(robot.links) == count and not any(map(robot.missing, robot.links.values()))


def _message(text: str) -> bytes:
    store = type_store()
    return bytes(store.cdr_to_ros1(store.serialize_cdr(store.types[KIND](data=text), KIND), KIND))


def test_one_process_at_a_time_is_told_and_they_are_told_by_their_nodes_names(
    robot: RobotLinks, start: Callable[..., Process]
) -> None:
    second, first = start("b"), start("a")
    eventually(lambda: _complete(robot, 2))
    links = list(robot.links.values())
    assert [each.name for each in links] == ["/a", "/b"]
    for told, other, link in ((first, second, links[0]), (second, first, links[1])):
        link.node.send(SCAN, _message(link.name))
        eventually(robot.acknowledged)
        # Who is connected has taken it when it is acknowledged; who is not never gets it.
        assert (len(told.scan.take()), other.scan.take()) == (1, [])


class Clock:
    """A clock that may be ahead."""

    ahead_s = 0.0

    def perf_counter(self) -> float:
        """Returns its time."""
        return time.perf_counter() + self.ahead_s


def test_processes_on_fast_dds_are_waited_for_until_they_know_each_other_and_one_alone_is_not(
    domain: EpisodeDomain, start: Callable[..., Process], monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = Clock()
    monkeypatch.setattr(discovery_watch, "time", clock)
    graph = DdsGraph(domain._replace(middleware=FAST), RobotInterface({SCAN: KIND}, "/cmd_vel"), (1, frozenset()))
    start("a")
    eventually(lambda: graph.changes and not graph.unconnected())
    start("b")
    eventually(lambda: graph.changes and graph.unconnected() == ["its processes look for each other"])
    clock.ahead_s = 60.0
    eventually(lambda: not graph.unconnected())
    assert not graph.guessed
    graph.close()


def test_an_episode_does_not_begin_where_nobody_offers_the_action(
    domain: EpisodeDomain, start: Callable[..., Process]
) -> None:
    graph = DdsGraph(domain, RobotInterface({SCAN: KIND}, "/cmd_vel", navigates=True), (1, frozenset()))
    start("a")
    missing = ["no node offers the action /navigate_to_pose (goals in ros.yaml)"]
    eventually(lambda: graph.changes and graph.unconnected() == missing)
    graph.close()


def test_what_nodes_say_and_wait_for_in_vain_is_told_with_types_and_qualities(
    robot: RobotLinks, start: Callable[..., Process]
) -> None:
    first, second = start("a", KIND), start("b")
    asked = [("/lost", KIND, DEFAULT), (SCAN, TWIST, DEFAULT), (SCAN, KIND, Profile(latched=True))]
    readers = [first.node.subscription(*each) for each in asked]
    writers = [
        second.node.publisher("/vel", TWIST, DEFAULT),
        second.node.publisher("/weak", KIND, Profile(reliable=False)),
    ]
    readers.append(first.node.subscription("/weak", KIND, DEFAULT))
    told = [
        "/a publishes std_msgs/msg/String on /cmd_vel, where the robot takes geometry_msgs/msg/Twist and "
        "geometry_msgs/msg/TwistStamped",
        "/a subscribes to /lost, which nobody publishes",
        "/a subscribes to /scan as geometry_msgs/msg/Twist, which is published as std_msgs/msg/String",
        "/a subscribes to /scan with durability transient local, which is published volatile",
        "/a subscribes to /weak reliably, which is published best effort",
        "/b publishes geometry_msgs/msg/Twist on /vel, to which nobody subscribes",
    ]
    eventually(lambda: _complete(robot, 2) and len(robot.gaps()) == len(told))
    assert robot.gaps() == told
    readers.clear()
    writers.clear()


@pytest.mark.parametrize("kind", [TWIST, STAMPED])
def test_a_process_is_complete_once_its_commands_are_heard_stamped_or_not(
    robot: RobotLinks, start: Callable[..., Process], kind: str
) -> None:
    process = start("a", kind)
    eventually(lambda: _complete(robot, 1))
    store = type_store()
    make = {name: store.types[f"geometry_msgs/msg/{name}"] for name in ("Twist", "TwistStamped", "Vector3")}
    twist = make["Twist"](linear=make["Vector3"](x=0.5, y=0, z=0), angular=make["Vector3"](x=0, y=0, z=0.25))
    header = store.types["std_msgs/msg/Header"](
        stamp=store.types["builtin_interfaces/msg/Time"](sec=0, nanosec=0), frame_id="base_link"
    )
    message = twist if kind == TWIST else make["TwistStamped"](header=header, twist=twist)
    process.commands.write(bytes(store.serialize_cdr(message, kind)))
    heard: list[bytes] = []
    eventually(lambda: bool(heard.extend(robot.take_commands()) or heard))
    assert heard == [bytes(store.serialize_cdr(twist, TWIST))[4:]]


def test_a_best_effort_commander_is_known_as_one_that_is_not_heard(
    robot: RobotLinks, start: Callable[..., Process]
) -> None:
    start("a", reliable=False)
    eventually(lambda: _complete(robot, 1))
    (link,) = robot.links.values()
    assert [each.reliable for each in robot.commanders(link)] == [False]
    assert link.matches.commanders == 0


def test_what_is_latched_reaches_a_process_that_comes_later(robot: RobotLinks, start: Callable[..., Process]) -> None:
    robot.publish("/tf_static", _message("wall"))
    process = start("late")
    latched = process.node.subscription("/tf_static", KIND, Profile(depth=1, latched=True))
    came: list[bytes] = []

    def found() -> bool:
        robot.find()
        came.extend(latched.take())
        return bool(came)

    eventually(found)
    assert type_store().deserialize_cdr(came[0], KIND).data == "wall"  # type: ignore[attr-defined]


def test_a_process_that_ends_is_forgotten(robot: RobotLinks, start: Callable[..., Process]) -> None:
    process = start("a")
    eventually(lambda: _complete(robot, 1))
    process.close()
    eventually(lambda: _complete(robot, 0))


@pytest.mark.parametrize("data", [b"", b"\0\1\0\0", b"\0\1\0\0" + b"\xff" * 40])
def test_bytes_that_say_nothing_of_nodes_are_passed_over(data: bytes) -> None:
    found = told_nodes(data)
    assert found is None or isinstance(found.participant, UUID)
