"""A node of ROS 2 on plain DDS: a participant, readers and writers by ROS 2's names, what it tells of itself."""

import os
from collections.abc import Callable, Sequence
from typing import cast
from uuid import UUID

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsParticipant
from cyclonedds.core import DDSException, Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from tasks.ros.ros2 import entities_info
from tasks.ros.ros2.domain import EpisodeDomain
from tasks.ros.ros2.entities_info import NodeEntities, entities_cdr
from tasks.ros.ros2.interface_types import DEFAULT_DISTRIBUTION, topic_name, user_data
from tasks.ros.ros2.qos_profiles import ENTITIES, Profile, dds_qos
from tasks.ros.ros2.wire_types import WireBytes, wire_type

_MANY = 1024


class _AckWriter(DataWriter[WireBytes]):
    def acknowledged(self) -> bool:
        """Returns whether all reliable readers have all samples; if not, cyclonedds 11 itself would raise."""
        wait = cast("Callable[[int, int], int]", self._wait_for_acks)
        return wait(self._ref, 0) == DDSException.DDS_RETCODE_OK


class Writer:
    """A publisher: takes messages as CDR."""

    def __init__(
        self, node: "DdsNode", dds_topic: str, kind: str, profile: Profile, own: str, *, service: bool
    ) -> None:
        self._type = wire_type(kind, node.distribution, service=service)
        qos = dds_qos(profile, user_data(kind, node.distribution, own))
        self._dds = _AckWriter(node.participant, Topic(node.participant, dds_topic, self._type), qos)

    @property
    def guid(self) -> UUID:
        """Returns the writer's GUID."""
        return self._dds.get_guid()

    @property
    def readers(self) -> int:
        """Returns how many readers it has."""
        return self._dds.get_publication_matched_status().current_count

    def write(self, cdr: bytes) -> None:
        """Sends a message to all readers; returns once the operating system has it."""
        self._dds.write(self._type(cdr))

    def acknowledged(self) -> bool:
        """Returns whether all reliable readers have all messages; best-effort ones say nothing."""
        return self._dds.acknowledged()


class Reader:
    """A subscription: gives messages as CDR."""

    def __init__(
        self, node: "DdsNode", dds_topic: str, kind: str, profile: Profile, own: str, *, service: bool
    ) -> None:
        qos = dds_qos(profile, user_data(kind, node.distribution, own))
        made = wire_type(kind, node.distribution, service=service)
        self._dds = DataReader(node.participant, Topic(node.participant, dds_topic, made), qos)

    @property
    def guid(self) -> UUID:
        """Returns the reader's GUID."""
        return self._dds.get_guid()

    @property
    def writers(self) -> int:
        """Returns how many writers it has."""
        return self._dds.get_subscription_matched_status().current_count

    @property
    def refused(self) -> int:
        """Returns how many writers offer less than the reader asks for, such as best effort, and are not heard."""
        return self._dds.get_requested_incompatible_qos_status().total_count

    def take(self) -> list[bytes]:
        """Returns the messages that have come since the last call, in the order that they came in."""
        # What a writer's end leaves in the queue is no message.
        taken = cast("Sequence[object]", self._dds.take(_MANY))
        return [each.cdr for each in taken if isinstance(each, WireBytes)]


class DdsNode:
    """A node, alone in its participant, as a process with one node of rclcpp or rclpy has it.

    Args:
        domain: Where it lives; this process has no other node there.
        name: The node's name.
        distribution: The release of ROS 2 that is spoken to.

    Attributes:
        participant: DDS's.
        threads: Those of this process that receive and send for the domain.
    """

    def __init__(self, domain: EpisodeDomain, name: str, distribution: str = DEFAULT_DISTRIBUTION) -> None:
        self.name, self.distribution = name, distribution
        before = _threads()
        self._domain = Domain(domain.number, domain.uri)
        self.participant = DomainParticipant(domain.number, Qos(Policy.Userdata(b"enclave=/;")))
        self.threads = _threads() - before
        self._others = BuiltinDataReader(self.participant, BuiltinTopicDcpsParticipant)
        self._known: set[UUID] = set()
        self._writers: list[Writer] = []
        self._readers: list[Reader] = []
        self._told = Writer(self, entities_info.TOPIC, entities_info.KIND, ENTITIES, "", service=False)

    def publisher(self, topic: str, kind: str, profile: Profile) -> Writer:
        """Returns a publisher of a ROS topic such as ``/scan``."""
        return self.writer(topic_name(topic), kind, profile)

    def subscription(self, topic: str, kind: str, profile: Profile) -> Reader:
        """Returns a subscription to a ROS topic such as ``/cmd_vel``."""
        return self.reader(topic_name(topic), kind, profile)

    def writer(self, dds_topic: str, kind: str, profile: Profile, own: str = "", *, service: bool = False) -> Writer:
        """Returns a writer of a DDS topic; ``own`` comes first in its USER_DATA."""
        self._writers.append(Writer(self, dds_topic, kind, profile, own, service=service))
        return self._writers[-1]

    def reader(self, dds_topic: str, kind: str, profile: Profile, own: str = "", *, service: bool = False) -> Reader:
        """Returns a reader of a DDS topic; ``own`` comes first in its USER_DATA."""
        self._readers.append(Reader(self, dds_topic, kind, profile, own, service=service))
        return self._readers[-1]

    def others(self) -> int:
        """Returns how many other participants have been seen in the domain: one for each process with ROS 2's nodes."""
        self._known.update(each.key for each in self._others.take(_MANY) if each.sample_info.valid_data)
        return len(self._known - {self.participant.get_guid()})

    def announce(self) -> None:
        """Tells the graph of the node, its readers and its writers; to be called once they are made."""
        readers, writers = [each.guid for each in self._readers], [each.guid for each in self._writers]
        self._told.write(entities_cdr(self.participant.get_guid(), self._entities(readers, writers), self.distribution))

    def _entities(self, readers: Sequence[UUID], writers: Sequence[UUID]) -> list[NodeEntities]:
        return [NodeEntities("/", self.name, readers, writers)]

    def close(self) -> None:
        """Takes the node out of its domain; its threads and its ports go with it."""
        for each in ("_writers", "_readers", "_told", "_others", "participant", "_domain"):
            self.__dict__.pop(each, None)


def _threads() -> frozenset[int]:
    return frozenset(int(each) for each in os.listdir("/proc/self/task"))  # noqa: PTH208 - numbers, not paths
