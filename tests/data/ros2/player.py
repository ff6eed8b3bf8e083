"""Plays rclpy: a node on plain Cyclone DDS, with ROS 2's names, its types written out by hand, none of Simyard's code.

What a message must look like is said a second time here, from ROS 2's own .msg files, so that a mistake in Simyard's
types does not hide itself.
"""

import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any
from uuid import UUID

from cyclonedds.core import InstanceState, Policy, Qos, ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.annotations import final
from cyclonedds.idl.types import array, float32, float64, int32, sequence, uint8, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration


@final
@dataclass
class Time(IdlStruct, typename="builtin_interfaces.msg.dds_.Time_"):
    sec: int32 = 0
    nanosec: uint32 = 0


@final
@dataclass
class Header(IdlStruct, typename="std_msgs.msg.dds_.Header_"):
    stamp: Time
    frame_id: str


@final
@dataclass
class Clock(IdlStruct, typename="rosgraph_msgs.msg.dds_.Clock_"):
    clock: Time


@final
@dataclass
class LaserScan(IdlStruct, typename="sensor_msgs.msg.dds_.LaserScan_"):
    header: Header
    angle_min: float32
    angle_max: float32
    angle_increment: float32
    time_increment: float32
    scan_time: float32
    range_min: float32
    range_max: float32
    ranges: sequence[float32]
    intensities: sequence[float32]


@final
@dataclass
class Vector3(IdlStruct, typename="geometry_msgs.msg.dds_.Vector3_"):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@final
@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs.msg.dds_.Quaternion_"):
    x: float64
    y: float64
    z: float64
    w: float64


@final
@dataclass
class Point(IdlStruct, typename="geometry_msgs.msg.dds_.Point_"):
    x: float64
    y: float64
    z: float64


@final
@dataclass
class Pose(IdlStruct, typename="geometry_msgs.msg.dds_.Pose_"):
    position: Point
    orientation: Quaternion


@final
@dataclass
class PoseWithCovariance(IdlStruct, typename="geometry_msgs.msg.dds_.PoseWithCovariance_"):
    pose: Pose
    covariance: array[float64, 36]


@final
@dataclass
class Twist(IdlStruct, typename="geometry_msgs.msg.dds_.Twist_"):
    linear: Vector3
    angular: Vector3


@final
@dataclass
class TwistWithCovariance(IdlStruct, typename="geometry_msgs.msg.dds_.TwistWithCovariance_"):
    twist: Twist
    covariance: array[float64, 36]


@final
@dataclass
class Odometry(IdlStruct, typename="nav_msgs.msg.dds_.Odometry_"):
    header: Header
    child_frame_id: str
    pose: PoseWithCovariance
    twist: TwistWithCovariance


@final
@dataclass
class Gid(IdlStruct, typename="rmw_dds_common.msg.dds_.Gid_"):
    data: array[uint8, 16]


@final
@dataclass
class NodeEntitiesInfo(IdlStruct, typename="rmw_dds_common.msg.dds_.NodeEntitiesInfo_"):
    node_namespace: str
    node_name: str
    reader_gid_seq: sequence[Gid]
    writer_gid_seq: sequence[Gid]


@final
@dataclass
class ParticipantEntitiesInfo(IdlStruct, typename="rmw_dds_common.msg.dds_.ParticipantEntitiesInfo_"):
    gid: Gid
    node_entities_info_seq: sequence[NodeEntitiesInfo]


_PLAIN_CDR = Policy.DataRepresentation(use_cdrv0_representation=True)
_FOREVER = duration(infinite=True)


def quality(depth: int, *, reliable: bool = True) -> Qos:
    """rclpy's QoSProfile."""
    how = Policy.Reliability.Reliable(_FOREVER) if reliable else Policy.Reliability.BestEffort
    return Qos(how, Policy.Durability.Volatile, Policy.History.KeepLast(depth), _PLAIN_CDR)


SENSOR_DATA = quality(5, reliable=False)
CLOCK = quality(1, reliable=False)
ENTITIES = Qos(
    Policy.Reliability.Reliable(_FOREVER),
    Policy.Durability.TransientLocal,
    Policy.History.KeepLast(1),
    _PLAIN_CDR,
)


def _gid(guid: UUID) -> Gid:
    return Gid(list(guid.bytes))  # type: ignore[arg-type]


class Node:
    """rclpy's Node, with use_sim_time."""

    def __init__(self) -> None:
        assert "use_sim_time:=true" in sys.argv, "nodes of an episode live in simulated time"
        self.participant = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]), Qos(Policy.Userdata(b"enclave=/;")))
        self._waits = WaitSet(self.participant)
        self._taken: list[tuple[Any, ReadCondition, Callable[[Any], None]]] = []
        self._timers: list[list[Any]] = []
        self.now_ns = 0
        self._endpoints: tuple[list[Gid], list[Gid]] = [], []
        # What rmw tells the graph: each participant its own nodes, and all listen.
        graph = Topic(self.participant, "ros_discovery_info", ParticipantEntitiesInfo, ENTITIES)
        self._graph = DataWriter(self.participant, graph, ENTITIES), DataReader(self.participant, graph, ENTITIES)
        self._announce()
        self.subscribe("/clock", Clock, self._tick, CLOCK)

    def publisher(self, topic: str, kind: type, qos: Qos | None = None, name: str = "") -> Callable[[object], None]:
        """create_publisher(...).publish"""
        qos = qos or quality(10)
        made = DataWriter(self.participant, Topic(self.participant, name or f"rt{topic}", kind, qos), qos)
        self._announce(writer=made)
        return made.write

    def subscribe(
        self, topic: str, kind: type, callback: Callable[[Any], None], qos: Qos | None = None, name: str = ""
    ) -> None:
        """create_subscription"""
        qos = qos or quality(10)
        reader = DataReader(self.participant, Topic(self.participant, name or f"rt{topic}", kind, qos), qos)
        condition = ReadCondition(reader, SampleState.NotRead | ViewState.Any | InstanceState.Alive)
        self._waits.attach(condition)
        self._taken.append((reader, condition, callback))
        self._announce(reader=reader)

    def _announce(self, reader: DataReader[Any] | None = None, writer: DataWriter[Any] | None = None) -> None:
        for gids, made in zip(self._endpoints, (reader, writer), strict=True):
            gids.extend([_gid(made.get_guid())] if made is not None else [])
        name = next(each[len("__node:=") :] for each in sys.argv if each.startswith("__node:="))
        readers, writers = self._endpoints
        node = NodeEntitiesInfo("/", name, readers, writers)  # type: ignore[arg-type]
        own = _gid(self.participant.get_guid())
        self._graph[0].write(ParticipantEntitiesInfo(own, [node]))  # type: ignore[arg-type]

    def timer(self, period_ns: int, callback: Callable[[], None]) -> None:
        """create_timer, by the clock of the simulation"""
        self._timers.append([None, period_ns, callback])

    def spin(self) -> None:
        """rclpy.spin"""
        while True:
            self._waits.wait(_FOREVER)
            for reader, _, callback in self._taken:
                for sample in reader.take(16):
                    if sample.sample_info.valid_data:
                        callback(sample)

    def _tick(self, message: Clock) -> None:
        self.now_ns = message.clock.sec * 1_000_000_000 + message.clock.nanosec
        for timer in self._timers:
            due_ns, period_ns, callback = timer
            if due_ns is None:
                timer[0] = self.now_ns + period_ns
            elif self.now_ns >= due_ns:
                timer[0] = due_ns + period_ns
                callback()
