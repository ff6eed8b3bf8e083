"""A node of ROS 2 among other participants of its domain."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

import pytest
from cyclonedds.core import Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from hypothesis import example, given
from hypothesis import strategies as st

from tasks.ros.message.ros_messages import REQUEST_BYTES
from tasks.ros.ros2.dds_domain import EpisodeDomain, episode_domains
from tasks.ros.ros2.dds_node import DEFAULT, DdsNode, Profile, dds_qos, structure
from tasks.ros.ros2.interface_types import ADD_TAGS, CANCEL, type_store
from tasks.ros.ros2.ros2_node import Ros2Node, request_tags, twist_bytes

TWIST = "geometry_msgs/msg/Twist"
_WAIT_S = 10.0
T = TypeVar("T")


@pytest.fixture
def domain() -> EpisodeDomain:
    (found,) = episode_domains(1)
    return found


@pytest.fixture
def robot(domain: EpisodeDomain) -> Iterator[Ros2Node]:
    made = Ros2Node(domain, {"/scan": "sensor_msgs/msg/LaserScan"}, "/cmd_vel")
    yield made
    made.close()


def _until(found: Callable[[], T]) -> T:
    ends_s = time.monotonic() + _WAIT_S
    while not (value := found()):
        assert time.monotonic() < ends_s, "nothing came"
        time.sleep(0.001)
    return value


def _count(what: str) -> int:
    return len(list(Path("/proc/self", what).iterdir()))


def _qos() -> Qos:
    return dds_qos(DEFAULT, b"")


def _call(domain: EpisodeDomain, robot: Ros2Node, service: str, kind: str, **values: object) -> object:
    """Returns the reply to a request, as a client of rmw_cyclonedds gets it: with the header of its request."""
    participant = DomainParticipant(domain.number)
    asked, told = structure(f"{kind}_Request", service=True), structure(f"{kind}_Response", service=True)
    writer = DataWriter(participant, Topic(participant, f"rq{service}Request", asked), _qos())
    reader = DataReader(participant, Topic(participant, f"rr{service}Reply", told), _qos())
    _until(lambda: writer.get_publication_matched_status().current_count)
    writer.write(asked(guid=77, sequence=3, **values))  # type: ignore[call-arg]
    _until(robot.serve)
    (reply,) = _until(lambda: reader.take(2))
    assert (reply.guid, reply.sequence) == (77, 3)  # type: ignore[attr-defined]
    return reply


def test_robomakers_service_takes_tags(domain: EpisodeDomain, robot: Ros2Node) -> None:
    tag = structure("robomaker_simulation_msgs/msg/Tag")
    tags = [tag(key="room", value="kitchen"), tag(key="a", value="")]  # type: ignore[call-arg]
    reply = _call(domain, robot, "/robomaker/job/add_tags", ADD_TAGS, tags=tags)
    assert reply.success  # type: ignore[attr-defined]
    assert robot.tags == {"room": "kitchen", "a": ""}


def test_tags_that_robomaker_does_not_take_are_refused_with_the_reason(domain: EpisodeDomain, robot: Ros2Node) -> None:
    tag = structure("robomaker_simulation_msgs/msg/Tag")
    many = [tag(key=str(number), value="") for number in range(51)]  # type: ignore[call-arg]
    reply = _call(domain, robot, "/robomaker/job/add_tags", ADD_TAGS, tags=many)
    assert not reply.success  # type: ignore[attr-defined]
    assert "at most 50" in reply.message  # type: ignore[attr-defined]
    assert robot.tags == {}


@given(st.binary(max_size=80).map(lambda data: b"\x00\x01\x00\x00" + data) | st.binary(max_size=80))
@example(b"\x00\x01\x00\x00\xff\xff\xff\xff")
@example(bytes(REQUEST_BYTES + 1))
def test_bytes_that_are_no_request_have_no_tags(request: bytes) -> None:
    try:
        found = request_tags(type_store(), request)
    except ValueError:
        return
    assert all(isinstance(text, str) for pair in found.items() for text in pair)


def test_robomakers_service_cancels(domain: EpisodeDomain, robot: Ros2Node) -> None:
    assert not robot.cancelled
    assert _call(domain, robot, "/robomaker/job/cancel", CANCEL, structure_needs_at_least_one_member=0)
    assert robot.cancelled


def test_the_graph_is_told_of_the_node_with_its_readers_and_writers(domain: EpisodeDomain) -> None:
    node = DdsNode(domain, "robot")
    scan = node.publisher("/scan", "sensor_msgs/msg/LaserScan", DEFAULT)
    commands = node.subscription("/cmd_vel", TWIST, DEFAULT)
    node.announce()
    participant = DomainParticipant(domain.number)
    kind = "rmw_dds_common/msg/ParticipantEntitiesInfo"
    latched = dds_qos(DEFAULT._replace(depth=1, latched=True), b"")
    reader = DataReader(participant, Topic(participant, "ros_discovery_info", structure(kind)), latched)
    (told,) = _until(lambda: reader.take(2))
    assert bytes(told.gid.data) == node.participant.get_guid().bytes  # type: ignore[attr-defined]
    (own,) = told.node_entities_info_seq  # type: ignore[attr-defined]
    assert (own.node_namespace, own.node_name) == ("/", "robot")
    assert [bytes(each.data) for each in own.writer_gid_seq] == [scan.guid.bytes]
    assert [bytes(each.data) for each in own.reader_gid_seq] == [commands.guid.bytes]
    node.close()


def test_a_best_effort_commander_is_counted_as_one_that_is_not_heard(domain: EpisodeDomain, robot: Ros2Node) -> None:
    participant = DomainParticipant(domain.number)
    topic = Topic(participant, "rt/cmd_vel", structure(TWIST))
    writer = DataWriter(participant, topic, dds_qos(Profile(depth=5, reliable=False), b""))
    _until(lambda: robot.matches().refused)
    assert robot.matches().commanders == 0
    assert writer.get_publication_matched_status().current_count == 0


def test_a_robot_that_is_closed_leaves_no_thread_and_no_port(domain: EpisodeDomain) -> None:
    before = _count("task"), _count("fd")
    robot = Ros2Node(domain, {"/clock": "rosgraph_msgs/msg/Clock"}, "/cmd_vel")
    assert len(robot.threads) == _count("task") - before[0] > 0
    robot.close()
    robot.close()
    assert (_count("task"), _count("fd")) == before


def test_twists_of_both_byte_orders_are_read_and_others_are_left_as_they_are() -> None:
    store = type_store()
    vector = store.types["geometry_msgs/msg/Vector3"]
    message = store.types[TWIST](linear=vector(x=0.5, y=0.1, z=0.0), angular=vector(x=0.0, y=0.0, z=-1.0))
    little = bytes(store.serialize_cdr(message, TWIST, little_endian=True))
    big = bytes(store.serialize_cdr(message, TWIST, little_endian=False))
    assert twist_bytes(little) == twist_bytes(big) == little[4:]
    assert twist_bytes(b"\x00\x01\x00\x00short") == b"\x00\x01\x00\x00short"


def test_each_episode_has_a_domain_and_a_tag_of_its_own() -> None:
    found = episode_domains(102)
    assert {each.number for each in found} == set(range(102))
    assert len({each.tag for each in found}) == 102
    assert all(each.environment["ROS_DOMAIN_ID"] == str(each.number) for each in found)
    with pytest.raises(ValueError, match="simulate fewer lanes"):
        episode_domains(103)


def test_nodes_are_told_of_the_loopback_alone() -> None:
    (domain,) = episode_domains(1)
    environment = domain.environment
    assert environment["RMW_IMPLEMENTATION"] == "rmw_cyclonedds_cpp"
    assert "address='127.0.0.1'" in environment["CYCLONEDDS_URI"]
    assert "<AllowMulticast>false" in environment["CYCLONEDDS_URI"]
    assert domain.tag in environment["CYCLONEDDS_URI"]
