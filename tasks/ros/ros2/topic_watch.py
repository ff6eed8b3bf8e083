"""Which process told which other one something over DDS: one that two others told something had it in nobody's order.

Lock-step tells one process at a time. What its nodes then say to each other goes from one to the next, and has one
order, until two of them speak to a third one (``tasks.ros.process.contention`` for ROS 1). Of UDP the kernel counts no
bytes, so whoever might be told something by two is found by who reads and writes what; and what they are told the
robot hears too, best effort: that asks nothing of who says it, and nobody waits for it.

Sources: DDS 1.4, section 2.2.2.5, ``publication_handle`` of a sample; ROS 2's "Topic and Service name mapping to DDS".
"""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple
from uuid import UUID

from tasks.ros.ros2.dds_node import DdsNode, Listener
from tasks.ros.ros2.interface_types import request_name, topic_name

# Who asked for an answer waits for it: answers have an order.
_TOLD = (topic_name(""), request_name("").removesuffix("Request"))
# Each node of rclcpp reads what any node says of its parameters, and does nothing about it.
_NOBODY_MINDS = topic_name("/parameter_events")
_FEWEST = 2
# A topic and a type, by DDS's names.
_Said = tuple[str, str]


class Endpoint(NamedTuple):
    """A reader or a writer of a process.

    Attributes:
        participant: The process's.
        topic, kind: DDS's names of its topic and type.
        reliable: Whether it asks that nothing be lost, or offers that.
        latched: Whether it asks for what was sent before it came, or offers that.
    """

    participant: UUID
    topic: str
    kind: str
    reliable: bool
    latched: bool


class TopicWatch:
    """Overhears what processes of one episode tell each other, as far as two of them may tell a third one something.

    Args:
        node: Who listens: each process sees it.
        headers: Whether requests have rmw_cyclonedds's header.
    """

    def __init__(self, node: DdsNode, *, headers: bool) -> None:
        self._node, self._headers = node, headers
        self._listeners: dict[_Said, Listener] = {}
        self._readers: Mapping[_Said, frozenset[UUID]] = {}
        self._writers: Mapping[_Said, int] = {}
        self._told = defaultdict[_Said, set[UUID]](set)

    @property
    def threads(self) -> frozenset[int]:
        """Returns the threads of this process that hear it; none while there is nothing to hear."""
        return self._node.threads if self._listeners else frozenset()

    def follow(self, readers: Sequence[Endpoint], writers: Iterable[Endpoint]) -> None:
        """Notes who reads and who writes what from now on; robots are not among them."""
        says = defaultdict[_Said, list[UUID]](list)
        for each in writers:
            if each.topic.startswith(_TOLD) and each.topic != _NOBODY_MINDS:
                says[each.topic, each.kind].append(each.participant)
        hears, tells = defaultdict[_Said, set[UUID]](set), defaultdict[UUID, set[UUID]](set)
        for each in readers:
            said = each.topic, each.kind
            if others := {*says.get(said, ())} - {each.participant}:
                hears[said].add(each.participant)
                tells[each.participant] |= others
        asked = {process for process, others in tells.items() if len(others) >= _FEWEST}
        self._readers = {said: own for said, all_of in hears.items() if (own := frozenset(all_of & asked))}
        self._writers = {said: len(says[said]) for said in self._readers}
        for said in self._listeners.keys() - self._readers.keys():
            del self._listeners[said]
        for topic, kind in sorted(self._readers.keys() - self._listeners.keys()):
            self._listeners[topic, kind] = self._node.listener(topic, kind, service=self._headers)

    def unheard(self) -> list[str]:
        """Returns topics, by DDS's names, some of whose writers are not heard yet.

        Of a type that is not known, those are heard that say nothing of its fields, which is all of ROS 2's own.
        """
        return [said[0] for said, each in self._listeners.items() if each.known and each.writers < self._writers[said]]

    def look(self) -> None:
        """Takes what was said."""
        for said, each in self._listeners.items():
            self._told[said] |= each.take()

    def contended(self) -> bool:
        """Returns whether two processes told a third one something since the last call."""
        if not self._listeners:
            return False
        self.look()
        told = defaultdict[UUID, set[UUID]](set)
        for said, writers in self._told.items():
            for process in self._readers.get(said, ()):
                told[process] |= writers - {process}
        self._told.clear()
        return any(len(writers) >= _FEWEST for writers in told.values())

    def close(self) -> None:
        """Hears nothing more."""
        self._listeners.clear()
