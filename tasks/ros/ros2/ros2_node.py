"""The robot among an episode's nodes of ROS 2: publishes what it senses, takes commands, offers services."""

import struct
from collections.abc import Mapping, Set
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import NamedTuple
from uuid import UUID

from rosbags.typesys.store import Typestore

from tasks.ros.message.navigation import Navigation
from tasks.ros.message.ros_messages import REQUEST_BYTES, joined_tags
from tasks.ros.ros2.dds_domain import DomainPlace
from tasks.ros.ros2.dds_node import (
    DEFAULT,
    MAP,
    NO_MESSAGE,
    SENSOR_DATA,
    STATIC_TRANSFORMS,
    TRANSFORMS,
    DdsNode,
    Profile,
    ServiceServer,
    Writer,
)
from tasks.ros.ros2.interface_types import ADD_TAGS, CANCEL, beyond_ros1, type_store
from tasks.ros.ros2.navigation_client import NavigationClient
from tasks.ros.ros2.ros2_installation import ADD_TAGS_SERVICE, CANCEL_SERVICE, DEFAULT_DISTRIBUTION

NODE_NAME = "simyard_robot"
TWIST, STAMPED = "geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"
COMMANDS = (TWIST, STAMPED)
_LITTLE = b"\x00\x01"
_TWIST_CDR = {_LITTLE: struct.Struct("<6d"), b"\x00\x00": struct.Struct(">6d")}
_ENCAPSULATION_BYTES, _FRAME_AT = 4, 12
# All that the robot writes is reliable, so that nothing is lost and its arrival is acknowledged; a reader that asks for
# less, as of sensor data and of the clock, gets the same samples.
_PROFILES = {
    "tf2_msgs/msg/TFMessage": TRANSFORMS,
    "nav_msgs/msg/OccupancyGrid": MAP,
    "geometry_msgs/msg/PoseStamped": Profile(depth=1, latched=True),
    "geometry_msgs/msg/PoseWithCovarianceStamped": Profile(depth=1, latched=True),
    **{
        f"sensor_msgs/msg/{name}": SENSOR_DATA
        for name in ("Image", "CompressedImage", "CameraInfo", "PointCloud2", "Range")
    },
}
_STATIC, _LATCHED = "/tf_static", Profile(latched=True)
_FAULT_CHARACTERS = 500


class Matches(NamedTuple):
    """Who is connected to the robot.

    Attributes:
        readers: How many, by topic.
        commanders: How many write commands.
    """

    readers: Mapping[str, int]
    commanders: int


@dataclass
class JobRequests:
    """What an application asked of its job.

    Attributes:
        tags: What was given to ``/robomaker/job/add_tags``.
        cancelled: Whether ``/robomaker/job/cancel`` was called.
        navigation: How its goals go, where they are sent as actions.
    """

    tags: dict[str, str] = field(default_factory=dict[str, str])
    cancelled: bool = False
    navigation: Navigation = field(default_factory=Navigation)


class RobotInterface(NamedTuple):
    """What the robot publishes and takes.

    Attributes:
        topics: Types such as ``sensor_msgs/msg/LaserScan`` by topic.
        command: The topic that it takes commands from.
        distribution: The release of ROS 2 that is spoken to.
        services: Whether it offers its services: other middlewares than Cyclone DDS mark requests in another way.
        navigates: Whether it sends goals as actions.
        recorded: What it listens to for a recording: types by topic.
    """

    topics: Mapping[str, str]
    command: str
    distribution: str = DEFAULT_DISTRIBUTION
    services: bool = True
    navigates: bool = False
    recorded: Mapping[str, str] = MappingProxyType({})


class Ros2Node:
    """The robot's node.

    Args:
        place: Where it lives.
        interface: What it publishes and takes.
        job: What its services write to.
    """

    def __init__(self, place: DomainPlace, interface: RobotInterface, job: JobRequests) -> None:
        self._job, self._topics = job, dict(interface.topics)
        self._store = type_store(interface.distribution)
        self._beyond = {topic: beyond_ros1(kind, interface.distribution) for topic, kind in interface.topics.items()}
        self._node = DdsNode(place, NODE_NAME, interface.distribution)
        self._writers = {topic: self._publisher(topic, kind) for topic, kind in interface.topics.items()}
        self._commands = [self._node.subscription(interface.command, kind, DEFAULT) for kind in COMMANDS]
        self._services = self._offered() if interface.services else []
        self._recorded = {
            topic: (kind, [self._node.subscription(topic, kind, profile) for profile in (DEFAULT, _LATCHED)])
            for topic, kind in interface.recorded.items()
        }
        self.navigation: NavigationClient | None = None
        if interface.navigates:
            self.navigation = NavigationClient(self._node, self._store, job.navigation, headers=interface.services)
        self._sent: set[str] = set()
        self._node.announce()

    def _offered(self) -> list[ServiceServer]:
        return [
            ServiceServer(self._node, ADD_TAGS_SERVICE, ADD_TAGS, self._add_tags),
            ServiceServer(self._node, CANCEL_SERVICE, CANCEL, self._cancel),
        ]

    def _publisher(self, topic: str, kind: str) -> Writer:
        return self._node.publisher(topic, kind, robot_profile(topic, kind))

    def send(self, topic: str, ros1: bytes) -> None:
        """Publishes a message, given in ROS 1's form; nothing once it is closed, as of a process that is gone."""
        if topic not in self._writers:
            return
        self._writers[topic].write(bytes(self._store.ros1_to_cdr(ros1 + self._beyond[topic], self._topics[topic])))
        self._sent.add(topic)

    def acknowledged(self) -> bool:
        """Returns whether all reliable readers have what was sent."""
        self._sent = {topic for topic in self._sent if not self._writers[topic].acknowledged()}
        return not self._sent and (self.navigation is None or self.navigation.acknowledged())

    def take_commands(self) -> list[bytes]:
        """Returns the Twists that have come since the last call, stamped or not, in ROS 1's form."""
        plain, stamped = self._commands
        return [*map(twist_bytes, plain.take()), *map(stamped_twist_bytes, stamped.take())]

    def heard(self) -> list[tuple[str, bytes]]:
        """Returns what nodes said on recorded topics since the last call, in ROS 1's form."""
        found: list[tuple[str, bytes]] = []
        for topic, (kind, (plain, latched)) in self._recorded.items():
            # The second one hears what was said before it came, but nobody who keeps nothing.
            late, anew = latched.take(), plain.take()
            heard = late if latched.writers == plain.writers else anew
            found += [(topic, bytes(self._store.cdr_to_ros1(each, kind))) for each in heard]
        return found

    def serve(self) -> int:
        """Answers calls of services, and takes answers of the action; returns how many there were."""
        served = sum(each.serve() for each in self._services)
        return served + (0 if self.navigation is None else self.navigation.serve())

    def matches(self) -> Matches:
        """Returns who is connected now."""
        readers = {topic: each.readers for topic, each in self._writers.items()}
        return Matches(readers, sum(each.writers for each in self._commands))

    def known(self) -> bool:
        """Returns whether another participant knows all that this node publishes."""
        return self._node.known()

    @property
    def guid(self) -> UUID:
        """Returns the GUID of the robot's participant."""
        return self._node.participant.get_guid()

    @property
    def threads(self) -> frozenset[int]:
        """Returns the threads of this process that receive and send for the robot."""
        return self._node.threads

    @property
    def sockets(self) -> Set[int]:
        """Returns inodes of what it receives with, and maybe of others that were made at the same time."""
        return self._node.sockets

    def close(self) -> None:
        """Takes the robot out of its domain."""
        self._writers.clear()
        self._services.clear()
        self._commands.clear()
        self._recorded.clear()
        self.navigation = None
        if "_node" in self.__dict__:
            self.__dict__.pop("_node").close()

    def _add_tags(self, request: bytes) -> bytes:
        try:
            self._job.tags = joined_tags(self._job.tags, request_tags(self._store, request))
        except ValueError as exc:
            return self._outcome(f"{ADD_TAGS}_Response", fault=str(exc)[:_FAULT_CHARACTERS])
        return self._outcome(f"{ADD_TAGS}_Response")

    def _cancel(self, request: bytes) -> bytes:  # noqa: ARG002 - it says nothing
        self._job.cancelled = True
        return self._outcome(f"{CANCEL}_Response")

    def _outcome(self, kind: str, fault: str = "") -> bytes:
        return bytes(self._store.serialize_cdr(self._store.types[kind](success=not fault, message=fault), kind))


def robot_profile(topic: str, kind: str) -> Profile:
    """Returns how the robot publishes a topic."""
    return STATIC_TRANSFORMS if topic == _STATIC else _PROFILES.get(kind, DEFAULT)


def stamped_twist_bytes(cdr: bytes) -> bytes:
    """Returns the Twist of a ``TwistStamped`` in ROS 1's form; its time and its frame mean nothing here."""
    little = cdr[:2] == _LITTLE
    (length,) = struct.unpack_from("<I" if little else ">I", cdr, _FRAME_AT) if len(cdr) >= _FRAME_AT + 4 else (0,)
    # Eight bytes of time and the frame's name; numbers of eight bytes begin at multiples of eight.
    at = _FRAME_AT + 4 + length - _ENCAPSULATION_BYTES
    return twist_bytes(cdr[:_ENCAPSULATION_BYTES] + cdr[_ENCAPSULATION_BYTES + at + -at % 8 :])


def twist_bytes(cdr: bytes) -> bytes:
    """Returns a ``geometry_msgs/msg/Twist`` in ROS 1's form, whose reader says what is wrong with another message."""
    form = _TWIST_CDR.get(cdr[:2])
    if form is None or len(cdr) != _ENCAPSULATION_BYTES + form.size:
        return cdr
    return _TWIST_CDR[_LITTLE].pack(*form.unpack_from(cdr, _ENCAPSULATION_BYTES))


def request_tags(store: Typestore, request: bytes) -> dict[str, str]:
    """Returns the tags of an ``AddTags`` request.

    Args:
        store: Has its type.
        request: Its CDR.

    Raises:
        ValueError: It is none, or larger than any.
    """
    if len(request) > REQUEST_BYTES:
        raise ValueError(f"a request of {len(request)} bytes, {REQUEST_BYTES} are taken")
    try:
        message = store.deserialize_cdr(request, f"{ADD_TAGS}_Request")
    except NO_MESSAGE as exc:
        raise ValueError(f"no request: {exc}") from exc
    return {each.key: each.value for each in message.tags}  # type: ignore[attr-defined]
