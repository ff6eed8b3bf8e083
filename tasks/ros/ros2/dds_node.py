"""A node of ROS 2 on plain DDS: types, qualities of service, readers, writers, services, what it tells of itself.

ROS 2 writes XCDR1 little endian (OMG DDS-XTypes 1.3, section 7.4): a message is written once, for the wire and for
the recording, and goes to DDS as it is.

Sources: ROS 2's documentation, "Quality of Service settings", and defaults of rmw (rmw_qos_profile_*); rmw_dds_common,
messages Gid, NodeEntitiesInfo and ParticipantEntitiesInfo; rmw_cyclonedds, ``cdds_request_header_t`` and
``rmw_init_cs``: other middlewares mark requests in another way.
"""

import functools
import os
import secrets
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import new_class
from typing import Any, NamedTuple, cast
from uuid import UUID

import numpy as np
from cyclonedds.core import DDSException, Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct, annotations, types
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc
from rosbags.serde import SerdeError

from tasks.ros.ros2.datagrams import udp_sockets
from tasks.ros.ros2.dds_domain import DomainPlace
from tasks.ros.ros2.interface_types import (
    dds_type_name,
    is_service,
    reply_name,
    request_name,
    ros_type_name,
    topic_name,
    type_store,
    user_data,
)
from tasks.ros.ros2.ros2_installation import DEFAULT_DISTRIBUTION

_BASE: Mapping[str, Any] = {
    "bool": bool,
    "byte": types.byte,
    "int8": types.int8,
    "uint8": types.uint8,
    "int16": types.int16,
    "uint16": types.uint16,
    "int32": types.int32,
    "uint32": types.uint32,
    "int64": types.int64,
    "uint64": types.uint64,
    "float32": types.float32,
    "float64": types.float64,
    "string": str,
}
# IDL knows no empty structure: rosidl gives one a member of this name.
_NO_FIELDS: list[tuple[str, FieldDesc]] = [("structure_needs_at_least_one_member", (Nodetype.BASE, ("uint8", 0)))]
# What rmw_cyclonedds puts before a request and its reply, to tell whose they are.
_SERVICE_HEADER: Mapping[str, Any] = {"guid": types.uint64, "sequence": types.int64}


class WireBytes(IdlStruct):
    """A sample that is its bytes already: the encapsulation header, then CDR."""

    def __init__(self, cdr: bytes) -> None:
        self.cdr = cdr

    def serialize(self, buffer: object = None, endianness: object = None, use_version_2: object = None) -> bytes:  # noqa: ARG002 - cyclonedds names them
        """Returns the bytes as they are, whatever cyclonedds asks for."""
        return self.cdr

    @classmethod
    def deserialize(cls, data: bytes, has_header: object = True, use_version_2: object = None) -> "WireBytes":  # noqa: ARG003, FBT002
        """Returns a sample that keeps the bytes as they came."""
        return cls(bytes(data))


class _NoBytes(WireBytes):
    """A sample of which only who said it counts."""

    @classmethod
    def deserialize(cls, data: bytes, has_header: object = True, use_version_2: object = None) -> "_NoBytes":  # noqa: ARG003, FBT002
        """Returns a sample without the bytes."""
        return cls(b"")


@functools.cache
def structure(kind: str, distribution: str = DEFAULT_DISTRIBUTION, *, service: bool = False) -> type[IdlStruct]:
    """Returns a type that cyclonedds itself writes and reads.

    Args:
        kind: The type, such as ``sensor_msgs/msg/LaserScan``.
        distribution: The release of ROS 2 whose definition it is.
        service: Put rmw_cyclonedds's header of requests and replies before the fields.
    """
    forms = type_store(distribution).fielddefs[kind][1] or _NO_FIELDS
    annotated = {name: _python_type(form, distribution) for name, form in forms}
    return _structure(dds_type_name(kind), {**_SERVICE_HEADER, **annotated} if service else annotated)


def _structure(dds_kind: str, fields: Mapping[str, Any]) -> type[IdlStruct]:
    typename = dds_kind.replace("::", ".")
    name = typename.rpartition(".")[2]
    body = {"__annotations__": fields, "__module__": __name__, "__qualname__": name}
    # The metaclass takes the type's name on the wire when the class is made.
    made = new_class(name, (IdlStruct,), {"typename": typename}, lambda space: space.update(body))
    return annotations.final(dataclass(cast("type[IdlStruct]", made)))


@functools.cache
def wire_type(kind: str, distribution: str = DEFAULT_DISTRIBUTION, *, service: bool = False) -> type[WireBytes]:
    """Returns the same type, its samples as bytes."""
    whole = structure(kind, distribution, service=service)
    made = new_class(whole.__name__, (WireBytes,), {"typename": whole.__idl_typename__})
    made.__idl__ = whole.__idl__
    return cast("type[WireBytes]", made)


@functools.cache
def listened_type(dds_kind: str, distribution: str = DEFAULT_DISTRIBUTION, *, service: bool = False) -> type[WireBytes]:
    """Returns a type by DDS's name of it, whether it is known or not; what its samples say is thrown away.

    ROS 2's middlewares match types that say nothing of their fields by their names.
    """
    kind = ros_type_name(dds_kind)
    known = kind in type_store(distribution).fielddefs
    whole = structure(kind, distribution, service=service) if known else _structure(dds_kind, {"unknown": types.uint8})
    made = new_class(whole.__name__, (_NoBytes,), {"typename": whole.__idl_typename__})
    made.__idl__ = whole.__idl__
    return cast("type[WireBytes]", made)


def _python_type(form: FieldDesc, distribution: str) -> Any:  # noqa: ANN401 - whatever cyclonedds takes for a field
    node, detail = form
    if node == Nodetype.BASE:
        return _BASE[cast("tuple[str, int]", detail)[0]]
    if node == Nodetype.NAME:
        return structure(cast("str", detail), distribution)
    element, count = cast("tuple[FieldDesc, int]", detail)
    inner = _python_type(element, distribution)
    return types.array[inner, count] if node == Nodetype.ARRAY else types.sequence[inner]


class Profile(NamedTuple):
    """A profile of ROS 2.

    Attributes:
        depth: How many samples are kept.
        reliable: Lost samples are sent again.
        latched: Who comes late gets what was sent before (transient local).
        others: A reader does not hear its own participant.
    """

    depth: int = 10
    reliable: bool = True
    latched: bool = False
    others: bool = False


DEFAULT = Profile()
CLOCK = Profile(depth=1, reliable=False)
TRANSFORMS = Profile(depth=100)
STATIC_TRANSFORMS = Profile(depth=1, latched=True)
MAP = Profile(depth=1, latched=True)
# As many samples as of ROS 2's sensor data, but none is lost.
SENSOR_DATA = Profile(depth=5)
SERVICES = Profile()
ENTITIES = Profile(depth=1, latched=True, others=True)


def dds_qos(profile: Profile, user_data: bytes) -> Qos:
    """Returns a profile as DDS has it; samples in XCDR1, which is all that ROS 2 writes.

    Args:
        profile: The profile.
        user_data: What the reader or writer says of itself.
    """
    forever, policies = duration(infinite=True), Policy.Durability
    own = [
        Policy.Reliability.Reliable(forever) if profile.reliable else Policy.Reliability.BestEffort,
        policies.TransientLocal if profile.latched else policies.Volatile,
        Policy.History.KeepLast(profile.depth),
        Policy.DataRepresentation(use_cdrv0_representation=True),
        Policy.WriterDataLifecycle(autodispose=False),
        Policy.Liveliness.Automatic(forever),
        Policy.Userdata(user_data),
    ]
    if profile.others:
        own.append(Policy.IgnoreLocal.Participant)
    if profile.latched:
        kept = Policy.History.KeepLast(profile.depth)
        own.append(Policy.DurabilityService(0, kept, -1, -1, -1))
    return Qos(*own)


TOPIC = "ros_discovery_info"
KIND = "rmw_dds_common/msg/ParticipantEntitiesInfo"
_GUID_BYTES = 16
# What rosbags raises of bytes that are no message.
NO_MESSAGE = (SerdeError, struct.error, ValueError, LookupError, AssertionError, TypeError)
_GID, _NODE = "rmw_dds_common/msg/Gid", "rmw_dds_common/msg/NodeEntitiesInfo"


class NodeEntities(NamedTuple):
    """A node: its name, its namespace, and its readers and writers.

    Attributes:
        readers, writers: DDS's GUIDs, as 16 bytes of a UUID.
    """

    namespace: str
    name: str
    readers: Sequence[UUID]
    writers: Sequence[UUID]


def entities_cdr(participant: UUID, nodes: Sequence[NodeEntities], distribution: str = DEFAULT_DISTRIBUTION) -> bytes:
    """Returns the message of a participant's nodes, as CDR.

    Args:
        participant: The participant's GUID.
        nodes: Its nodes.
        distribution: The release of ROS 2 that is spoken to; a Gid of Humble has 24 bytes, later ones have 16.
    """
    store = type_store(distribution)
    message = store.types[KIND](
        gid=_gid(participant, distribution),
        node_entities_info_seq=[_node(each, distribution) for each in nodes],
    )
    return bytes(store.serialize_cdr(message, KIND))


class ToldNodes(NamedTuple):
    """What a participant says of its nodes.

    Attributes:
        participant: Its GUID.
        names: The nodes' full names.
        readers: GUIDs of what they read with.
    """

    participant: UUID
    names: frozenset[str]
    readers: frozenset[UUID]


def told_nodes(cdr: bytes, distribution: str = DEFAULT_DISTRIBUTION) -> ToldNodes | None:
    """Returns what a participant says of its nodes; None for bytes that are no such message."""
    try:
        message: Any = type_store(distribution).deserialize_cdr(cdr, KIND)
    except NO_MESSAGE:
        return None
    nodes = message.node_entities_info_seq
    return ToldNodes(
        _uuid(message.gid),
        frozenset(f"{each.node_namespace.rstrip('/')}/{each.node_name}" for each in nodes),
        frozenset(_uuid(gid) for each in nodes for gid in each.reader_gid_seq),
    )


def _uuid(gid: Any) -> UUID:  # noqa: ANN401 - a class that rosbags makes
    return UUID(bytes=bytes(gid.data)[:_GUID_BYTES])


def _node(node: NodeEntities, distribution: str) -> Any:  # noqa: ANN401 - a class that rosbags makes
    return type_store(distribution).types[_NODE](
        node_namespace=node.namespace,
        node_name=node.name,
        reader_gid_seq=[_gid(each, distribution) for each in node.readers],
        writer_gid_seq=[_gid(each, distribution) for each in node.writers],
    )


def _gid(guid: UUID, distribution: str) -> Any:  # noqa: ANN401 - a class that rosbags makes
    store = type_store(distribution)
    (_, (_, (_, count))) = store.fielddefs[_GID][1][0]
    return store.types[_GID](data=np.frombuffer(guid.bytes.ljust(int(count), b"\0"), np.uint8))


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

    def take(self) -> list[bytes]:
        """Returns the messages that have come since the last call, in the order that they came in."""
        # What a writer's end leaves in the queue is no message.
        taken = cast("Sequence[object]", self._dds.take(_MANY))
        return [each.cdr for each in taken if isinstance(each, WireBytes)]


class Listener:
    """A best-effort reader that tells who writes, and not what.

    Attributes:
        known: Whether the type is known.
    """

    def __init__(self, node: "DdsNode", dds_topic: str, dds_kind: str, *, service: bool) -> None:
        self.known = ros_type_name(dds_kind) in type_store(node.distribution).fielddefs
        made = listened_type(dds_kind, node.distribution, service=service)
        qos = dds_qos(Profile(depth=_MANY, reliable=False), b"")
        self._dds = DataReader(node.participant, Topic(node.participant, dds_topic, made), qos)
        self._processes: dict[int, UUID] = {}

    @property
    def writers(self) -> int:
        """Returns how many writers it has."""
        return self._dds.get_subscription_matched_status().current_count

    def take(self) -> set[UUID]:
        """Returns the participants that have written since the last call."""
        taken = cast("Sequence[Any]", self._dds.take(_MANY))
        handles = {each.sample_info.publication_handle for each in taken if each.sample_info.valid_data}
        return {self._process(each) for each in handles}

    def _process(self, handle: int) -> UUID:
        """Returns whose writer it is; one that has gone before it was looked at is somebody's own."""
        if handle not in self._processes:
            found: Any = self._dds.get_matched_publication_data(handle)
            self._processes[handle] = UUID(int=handle % (1 << 128)) if found is None else found.participant_key
        return self._processes[handle]


class DdsNode:
    """A node, alone in its participant, as a process with one node of rclcpp or rclpy has it.

    Args:
        place: Where it lives; this process has no other node of that number.
        name: The node's name.
        distribution: The release of ROS 2 that is spoken to.

    Attributes:
        participant: DDS's.
        threads: Those of this process that receive and send for the domain.
        sockets: Inodes of what it receives with; other processes' that were made at the same time may be among them.
    """

    def __init__(self, place: DomainPlace, name: str, distribution: str = DEFAULT_DISTRIBUTION) -> None:
        self.name, self.distribution = name, distribution
        before, sockets = _threads(), udp_sockets().keys()
        self._domain = Domain(place.number, place.uri)
        self.participant = DomainParticipant(place.number, Qos(Policy.Userdata(b"enclave=/;")))
        self.threads, self.sockets = _threads() - before, udp_sockets().keys() - sockets
        self._writers: list[Writer] = []
        self._readers: list[Reader] = []
        self._told: Writer | None = None
        self._hears: Reader | None = None
        self._heard = False

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

    def listener(self, dds_topic: str, dds_kind: str, *, service: bool) -> Listener:
        """Returns what tells who writes a DDS topic; ``service`` counts for a service's alone."""
        return Listener(self, dds_topic, dds_kind, service=service and is_service(dds_topic))

    def announce(self) -> None:
        """Tells the graph of the node, its readers and its writers; to be called once, when they are made."""
        readers, writers = [each.guid for each in self._readers], [each.guid for each in self._writers]
        # Others hear of writers and of readers in the order that these are made in: who takes what this writer says,
        # and whom this reader hears, knows those before.
        self._hears = Reader(self, TOPIC, KIND, ENTITIES, "", service=False)
        self._told = Writer(self, TOPIC, KIND, ENTITIES, "", service=False)
        self._told.write(entities_cdr(self.participant.get_guid(), self._entities(readers, writers), self.distribution))

    def known(self) -> bool:
        """Returns whether another participant knows all that was announced: it has heard of the node, and was heard."""
        if self._told is None or self._hears is None:
            return False
        self._heard = self._heard or bool(self._hears.take())
        return self._heard and self._told.readers > 0 and self._told.acknowledged()

    def _entities(self, readers: Sequence[UUID], writers: Sequence[UUID]) -> list[NodeEntities]:
        return [NodeEntities("/", self.name, readers, writers)]

    def close(self) -> None:
        """Takes the node out of its domain; its threads and its ports go with it."""
        for each in ("_writers", "_readers", "_told", "_hears", "participant", "_domain"):
            self.__dict__.pop(each, None)


def _threads() -> frozenset[int]:
    return frozenset(int(each) for each in os.listdir("/proc/self/task"))  # noqa: PTH208 - numbers, not paths


ENCAPSULATION_BYTES = 4
# The client's identity, 8 bytes, and the number of its request, 8 bytes.
HEADER_BYTES = 16
_IDENTITY_BYTES = 16


class ServiceServer:
    """Answers requests.

    Args:
        node: Whose service it is.
        service: Its name, such as ``/robomaker/job/cancel``.
        kind: Its type, such as ``robomaker_simulation_msgs/srv/Cancel``.
        answer: From a request's CDR to its reply's, each with an encapsulation header.
    """

    def __init__(self, node: DdsNode, service: str, kind: str, answer: Callable[[bytes], bytes]) -> None:
        identity = ".".join(f"{each:x}" for each in secrets.token_bytes(_IDENTITY_BYTES))
        own, self._answer = f"serviceid={identity};", answer
        self._requests = node.reader(request_name(service), f"{kind}_Request", SERVICES, own, service=True)
        self._replies = node.writer(reply_name(service), f"{kind}_Response", SERVICES, own, service=True)

    def serve(self) -> int:
        """Answers what has come; returns how many requests that were."""
        requests = self._requests.take()
        for each in requests:
            begin, end = ENCAPSULATION_BYTES, ENCAPSULATION_BYTES + HEADER_BYTES
            # The header's 16 bytes leave the alignment of what follows as it is.
            reply = self._answer(each[:begin] + each[end:])
            self._replies.write(reply[:begin] + each[begin:end] + reply[begin:])
        return len(requests)
