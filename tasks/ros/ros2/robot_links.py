"""The robot among an episode's processes: a participant for each of them, and one that only looks who is there.

DDS sends a sample to all readers of a topic at once; nodes that then talk to each other would do so in an order that
nobody fixes. A participant that announces itself to one process alone, from a port that nobody else knows, has that
process's readers alone. So the robot tells one process at a time, as it does with ROS 1.

Two participants know each other when each has taken what the other says of its nodes: the robot tells the graph of
itself, and listens to it, over a reliable topic and last, after it has told of its readers and writers.

Whether two of the processes know each other, nobody tells the robot (``tasks.ros.ros2.discovery_watch``).

Sources: DDS 1.4, section 2.2.5, built-in topics; rmw_dds_common, which announces nodes as ``DdsNode.announce`` does.
"""

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from typing import Any, cast
from uuid import UUID

from cyclonedds.builtin import (
    BuiltinDataReader,
    BuiltinTopicDcpsParticipant,
    BuiltinTopicDcpsPublication,
    BuiltinTopicDcpsSubscription,
)
from cyclonedds.core import Policy

from tasks.ros.ros2.datagrams import UdpSocket
from tasks.ros.ros2.dds_domain import EpisodeDomain, domain_of
from tasks.ros.ros2.dds_node import ENTITIES, KIND, TOPIC, DdsNode, ToldNodes, told_nodes
from tasks.ros.ros2.interface_types import dds_type_name, ros_type_name, topic_name
from tasks.ros.ros2.ros2_node import COMMANDS, JobRequests, Matches, RobotInterface, Ros2Node, robot_profile
from tasks.ros.ros2.topic_watch import Endpoint, TopicWatch

_MANY = 1024
# What participants say of themselves: where they listen, as Cyclone DDS has it, and their process.
_ADDRESSES, _PROCESS = "__NetworkAddresses", ("__Pid", "fastdds.physical_data.process")
_NOBODY = Matches({}, 0)
_OF_TOPICS = topic_name("")


@dataclass
class RobotLink:
    """The robot's participant for one process.

    Attributes:
        participant: The process's.
        process: Its number.
        node: The robot's node that it sees.
        names: Its nodes' full names.
        readers: What they read with.
        matches: Who was connected when it was looked at last.
    """

    participant: UUID
    process: int
    node: Ros2Node
    names: frozenset[str] = frozenset()
    readers: frozenset[UUID] = frozenset()
    matches: Matches = _NOBODY

    @property
    def order(self) -> tuple[list[str], int]:
        """Returns what says when it is told: by its nodes' names, which no repeat changes."""
        return sorted(self.names), self.process

    @property
    def name(self) -> str:
        """Returns the same for a person."""
        return ", ".join(sorted(self.names))


class RobotLinks:
    """All participants of an episode's robot.

    Args:
        domain: The episode's.
        interface: What the robot publishes and takes.

    Attributes:
        job: What the application asked of its job.
        links: By the other participant: those with nodes, in the order that they are told in.
        news_s: When a participant, a reader or a writer came or went last, by ``time.perf_counter``.
    """

    def __init__(self, domain: EpisodeDomain, interface: RobotInterface) -> None:
        self.job = JobRequests()
        self.links: dict[UUID, RobotLink] = {}
        self._domain, self._interface = domain, interface
        self._wanted = {topic_name(topic): topic for topic in interface.topics}
        self._latched: dict[str, bytes] = {}
        self.news_s = time.perf_counter()
        self._seen: dict[UUID, RobotLink] = {}
        self._gone: set[UUID] = set()
        self._nodes_told: dict[UUID, ToldNodes] = {}
        self._subscriptions: dict[UUID, Endpoint] = {}
        self._publications: dict[UUID, Endpoint] = {}
        self._observer = DdsNode(domain, "", interface.distribution)
        participant = self._observer.participant
        self._builtin = [
            BuiltinDataReader(participant, topic)
            for topic in (BuiltinTopicDcpsParticipant, BuiltinTopicDcpsSubscription, BuiltinTopicDcpsPublication)
        ]
        # Without a key: what one participant says must not take the place of what another one has said.
        self._told = self._observer.reader(TOPIC, KIND, ENTITIES._replace(depth=_MANY))
        self._watch = TopicWatch(self._observer, headers=interface.services)

    @property
    def threads(self) -> frozenset[int]:
        """Returns the threads of this process that receive and send for the robot."""
        return self._watch.threads.union(*(node.threads for node in self._nodes()))

    def dropped(self, lost: Mapping[int, UdpSocket]) -> int:
        """Returns how many of some datagrams that sockets dropped, by inode, were meant for this episode.

        Its nodes' sockets have its domain's ports, its robot's have any.
        """
        own = frozenset[int]().union(*(node.sockets for node in self._nodes()))
        whose = ((inode in own, domain_of(each.port), each.dropped) for inode, each in lost.items())
        return sum(count for ours, domain, count in whose if domain == self._domain.number or (ours and domain is None))

    def find(self) -> None:
        """Looks who has come and gone, links who has nodes, and notes who is connected."""
        participants, subscriptions, publications = self._builtin
        own = self._observer.participant.get_guid()
        came = _taken(participants)
        for each in came:
            if not each.sample_info.valid_data:
                self._forget(each.key)
            elif each.key != own and each.key not in self._seen and each.key not in self._gone:
                self._link(each.key, {policy.key: policy.value for policy in each.qos if hasattr(policy, "key")})
        counts = [_update(self._subscriptions, subscriptions), _update(self._publications, publications)]
        if came or any(counts):
            self.news_s = time.perf_counter()
            self._watch.follow(*map(self._seen_of, (self._subscriptions, self._publications)))
        self._watch.look()
        # What a participant says of its nodes may come before what says that it is there.
        for told in filter(None, (told_nodes(each, self._interface.distribution) for each in self._told.take())):
            self._nodes_told[told.participant] = told
        for participant in self._seen.keys() & self._nodes_told.keys():
            told = self._nodes_told.pop(participant)
            self._seen[participant].names, self._seen[participant].readers = told.names, told.readers
        with_nodes = (item for item in self._seen.items() if item[1].names)
        self.links = dict(sorted(with_nodes, key=lambda item: item[1].order))
        for link in self.links.values():
            link.matches = link.node.matches()

    def _link(self, participant: UUID, told: Mapping[str, str]) -> None:
        process = next((int(told[name]) for name in _PROCESS if told.get(name, "").isdecimal()), 0)
        addresses = [each.removeprefix("udp/").partition("@")[0] for each in told.get(_ADDRESSES, "").split(",")]
        node = Ros2Node(self._domain.link(addresses), self._interface, self.job)
        self._seen[participant] = RobotLink(participant, process, node)
        for topic, data in self._latched.items():
            node.send(topic, data)

    def _forget(self, participant: UUID) -> None:
        link = self._seen.pop(participant, None)
        if link is not None:
            link.node.close()

    def forget(self, processes: AbstractSet[int]) -> None:
        """Takes these processes for gone, whatever they still said of themselves."""
        gone = {each for each, link in self._seen.items() if link.process in processes}
        self._gone |= gone
        for participant in gone:
            self._forget(participant)
        if gone:
            self.links = {each: link for each, link in self.links.items() if each not in gone}

    def keep(self, topic: str, data: bytes) -> None:
        """Keeps a message for processes that come, and for those that do not read the topic yet."""
        self._latched[topic] = data
        for node in self._nodes():
            if not node.matches().readers[topic]:
                node.send(topic, data)

    def publish(self, topic: str, data: bytes) -> None:
        """Publishes a message to all processes; one that is latched also to those that come."""
        if robot_profile(topic, self._interface.topics[topic]).latched:
            self._latched[topic] = data
        for node in self._nodes():
            node.send(topic, data)

    def acknowledged(self) -> bool:
        """Returns whether all reliable readers have what was sent."""
        return all(node.acknowledged() for node in self._nodes())

    def take_commands(self) -> list[bytes]:
        """Returns the Twists that have come since the last call: of one process in their order, then of the next."""
        return [each for link in self.links.values() for each in link.node.take_commands()]

    def navigator(self) -> Ros2Node | None:
        """Returns the robot's node for the process that offers the action, the first by name; None if none does."""
        nodes = (link.node for link in self.links.values())
        return next((node for node in nodes if node.navigation is not None and node.navigation.ready), None)

    def heard(self) -> list[tuple[str, bytes]]:
        """Returns what nodes said on recorded topics since the last call: of one process, then of the next."""
        return [each for link in self.links.values() for each in link.node.heard()]

    def serve(self) -> int:
        """Answers calls of services, and takes answers of the action; returns how many there were."""
        return sum(node.serve() for node in self._nodes())

    def missing(self, link: RobotLink) -> str:
        """Returns what a process and the robot do not know of each other yet; empty if they know all."""
        if not link.node.known():
            return "has not found the robot"
        if unseen := link.readers - self._subscriptions.keys():
            return f"says nothing of {len(unseen)} of its subscriptions"
        asked = Counter(each.topic for each in self._subscriptions.values() if self._heard(link, each))
        for topic, name in self._wanted.items():
            if link.matches.readers.get(name, 0) < asked[topic]:
                return f"is not connected to {name}"
        writers = [each for each in self.commanders(link) if each.reliable]
        return f"is not connected to {self._interface.command}" if link.matches.commanders < len(writers) else ""

    def _heard(self, link: RobotLink, reader: Endpoint) -> bool:
        """Returns whether the robot can be heard by a reader of a process."""
        name = self._wanted.get(reader.topic)
        kind = self._interface.topics.get(name or "", "")
        fits = bool(name) and reader.participant == link.participant and reader.kind == dds_type_name(kind)
        return fits and (not reader.latched or robot_profile(name or "", kind).latched)

    def commanders(self, link: RobotLink) -> list[Endpoint]:
        """Returns who writes commands in a process, whether the robot hears it or not."""
        topic, kinds = topic_name(self._interface.command), {dds_type_name(kind) for kind in COMMANDS}
        own = (each for each in self._publications.values() if each.participant == link.participant)
        return [each for each in own if each.topic == topic and each.kind in kinds]

    def gaps(self) -> list[str]:
        """Returns what nodes say or wait for in vain, for a person: no other side, another type, less than is asked."""
        wants, gives = self._seen_of(self._subscriptions), self._seen_of(self._publications)
        found = [self._unheard(each, gives) for each in wants] + [self._untaken(each, wants) for each in gives]
        return sorted({each for each in found if each})

    def _seen_of(self, endpoints: Mapping[UUID, Endpoint]) -> list[Endpoint]:
        return [each for each in endpoints.values() if each.participant in self._seen]

    def contended(self) -> bool:
        """Returns whether two processes told a third one something since the last call."""
        return self._watch.contended()

    def overhears(self) -> str:
        """Returns a topic on which processes tell each other something that is not overheard yet; empty for none."""
        return "".join(self._watch.unheard()[:1])

    def _unheard(self, reader: Endpoint, gives: Sequence[Endpoint]) -> str:
        """Returns why a reader of a topic hears nothing; empty if it may."""
        if not reader.topic.startswith(_OF_TOPICS):
            return ""
        writers = [each for each in gives if each.topic == reader.topic]
        if name := self._wanted.get(reader.topic):
            kind, latched = self._interface.topics[name], robot_profile(name, self._interface.topics[name]).latched
            writers.append(reader._replace(kind=dds_type_name(kind), reliable=True, latched=latched))
        alike = [each for each in writers if each.kind == reader.kind]
        begin = f"{self._whose(reader)} subscribes to {reader.topic.removeprefix(_OF_TOPICS)}"
        if not writers:
            return f"{begin}, which nobody publishes"
        if not alike:
            return f"{begin} as {ros_type_name(reader.kind)}, which is published as {ros_type_name(writers[0].kind)}"
        if reader.reliable and not any(each.reliable for each in alike):
            return f"{begin} reliably, which is published best effort"
        if reader.latched and not any(each.latched for each in alike):
            return f"{begin} with durability transient local, which is published volatile"
        return ""

    def _untaken(self, writer: Endpoint, wants: Sequence[Endpoint]) -> str:
        """Returns why commands that a node writes drive nothing; empty of other topics, and if they may."""
        command, kinds = topic_name(self._interface.command), {dds_type_name(kind) for kind in COMMANDS}
        begin = (
            f"{self._whose(writer)} publishes {ros_type_name(writer.kind)} on {writer.topic.removeprefix(_OF_TOPICS)}"
        )
        if writer.topic == command:
            return "" if writer.kind in kinds else f"{begin}, where the robot takes {' and '.join(COMMANDS)}"
        heard = any(each.topic == writer.topic for each in wants)
        return "" if heard or writer.kind not in kinds else f"{begin}, to which nobody subscribes"

    def _whose(self, endpoint: Endpoint) -> str:
        return self._seen[endpoint.participant].name or "a process"

    def _nodes(self) -> Sequence[Ros2Node]:
        return [link.node for link in self._seen.values()]

    def close(self) -> None:
        """Takes the robot out of its domain."""
        for participant in list(self._seen):
            self._forget(participant)
        self.links = {}
        self._watch.close()
        self._builtin.clear()
        self.__dict__.pop("_told", None)
        if "_observer" in self.__dict__:
            self.__dict__.pop("_observer").close()


def _taken(reader: BuiltinDataReader) -> Sequence[Any]:
    return cast("Sequence[Any]", reader.take(_MANY))


def _update(endpoints: dict[UUID, Endpoint], reader: BuiltinDataReader) -> int:
    """Notes which readers or writers have come, and which are gone; returns how many."""
    taken = _taken(reader)
    for each in taken:
        if each.sample_info.valid_data:
            reliable, latched = (
                Policy.Reliability.BestEffort not in each.qos,
                Policy.Durability.Volatile not in each.qos,
            )
            endpoints[each.key] = Endpoint(each.participant_key, each.topic_name, each.type_name, reliable, latched)
        else:
            endpoints.pop(each.key, None)
    return len(taken)
