"""Processes that tell a third one something at once: nobody fixes what it hears first."""

import itertools
from typing import Any, cast
from uuid import UUID

import pytest

from tasks.ros.ros2.dds_domain import EpisodeDomain, LinkPlace
from tasks.ros.ros2.dds_node import DEFAULT, DdsNode
from tasks.ros.ros2.robot_links import RobotLinks
from tasks.ros.ros2.ros2_node import RobotInterface
from tasks.ros.ros2.topic_watch import Endpoint, TopicWatch
from tests.servers.eventually import eventually

KIND = "std_msgs/msg/String"
_numbers = itertools.count(6000)


class _Listener:
    """What a test says was written."""

    known, writers = True, 0

    def __init__(self) -> None:
        self.said = set[UUID]()

    def take(self) -> set[UUID]:
        """Returns it once."""
        said, self.said = self.said, set()
        return said


class _Node:
    """Makes listeners by topics."""

    threads = frozenset({1})

    def __init__(self) -> None:
        self.listeners: dict[str, _Listener] = {}

    def listener(self, topic: str, kind: str, *, service: bool) -> _Listener:  # noqa: ARG002 - as of a DdsNode
        """Returns a new one."""
        return self.listeners.setdefault(topic, _Listener())


def _process(name: str) -> UUID:
    return UUID(int=ord(name))


def _endpoints(text: str) -> list[Endpoint]:
    """Returns readers or writers: ``a:rt/x`` is one of the process a."""
    pairs = (each.split(":") for each in text.split())
    return [Endpoint(_process(name), topic, "kind", reliable=True, latched=False) for name, topic in pairs]


@pytest.mark.parametrize(
    ("readers", "writers", "said", "counts"),
    [
        ("c:rt/x", "a:rt/x b:rt/x", "a:rt/x b:rt/x", True),
        ("c:rt/x c:rt/y d:rt/y", "a:rt/x b:rt/y", "a:rt/x b:rt/y", True),
        ("c:rq/askRequest", "a:rq/askRequest b:rq/askRequest", "a:rq/askRequest b:rq/askRequest", True),
        ("c:rt/x", "a:rt/x b:rt/x", "a:rt/x", False),
        ("c:rt/x d:rt/y", "a:rt/x b:rt/y", "a:rt/x b:rt/y", False),
        ("b:rt/x", "a:rt/x b:rt/x c:rt/x", "a:rt/x b:rt/x", False),
        ("c:rr/askReply", "a:rr/askReply b:rr/askReply", "a:rr/askReply b:rr/askReply", False),
        ("c:rt/parameter_events", "a:rt/parameter_events b:rt/parameter_events", "a:rt/parameter_events", False),
    ],
    ids=lambda each: str(each).replace(" ", "+").replace("/", "."),
)
def test_two_that_tell_a_third_one_something_are_counted_once(
    readers: str, writers: str, said: str, *, counts: bool
) -> None:
    node = _Node()
    watch = TopicWatch(cast("Any", node), headers=False)
    watch.follow(_endpoints(readers), _endpoints(writers))
    for each in _endpoints(said):
        node.listeners.setdefault(each.topic, _Listener()).said.add(each.participant)
    watch.look()
    assert watch.contended() is counts
    assert not watch.contended()


def test_what_nobody_can_race_for_is_not_listened_to_any_more() -> None:
    node = _Node()
    watch = TopicWatch(cast("Any", node), headers=False)
    watch.follow(_endpoints("c:rt/x"), _endpoints("a:rt/x b:rt/x"))
    assert (watch.threads, watch.unheard()) == ({1}, ["rt/x"])
    watch.follow(_endpoints("c:rt/x"), _endpoints("a:rt/x"))
    assert (watch.threads, watch.unheard()) == (frozenset(), [])


def test_the_robot_hears_who_tells_whom_on_topics_and_in_services(domain: EpisodeDomain) -> None:
    own, asked = f"<Discovery><ExternalDomainId>{domain.number}</ExternalDomainId>", "rq/countRequest"
    robot = RobotLinks(domain, RobotInterface({}, "/cmd_vel"))
    first, second, third = nodes = [
        DdsNode(LinkPlace(next(_numbers), domain.uri.replace("<Discovery>", own)), name) for name in "abc"
    ]
    writers = [first.publisher("/hop", KIND, DEFAULT), second.writer(asked, KIND, DEFAULT, service=True)]
    readers = [third.subscription("/hop", KIND, DEFAULT), third.reader(asked, KIND, DEFAULT, service=True)]
    for node in nodes:
        node.announce()

    def complete() -> bool:
        robot.find()
        # The third one and the robot, whom nobody asks whether it was heard.
        return not robot.overhears() and all(each.readers == 2 for each in writers)

    eventually(complete)
    empty = b"\1\0\0\0\0"
    for each, text in zip(writers, (empty, bytes(16) + empty), strict=True):
        each.write(b"\0\1\0\0" + text)
    eventually(lambda: robot._watch.look() or len(set[UUID]().union(*robot._watch._told.values())) == len(writers))
    assert robot.contended()
    assert not robot.contended()
    writers.clear()
    readers.clear()
    for node in nodes:
        node.close()
    robot.close()
