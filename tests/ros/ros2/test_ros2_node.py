"""A node of ROS 2 among other participants of its domain."""

import json
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import pytest
from cyclonedds.core import Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from hypothesis import example, given
from hypothesis import strategies as st

from tasks.ros.message.ros_messages import REQUEST_BYTES
from tasks.ros.process.lane_limits import NO_ROOM
from tasks.ros.ros2 import dds_domain
from tasks.ros.ros2.dds_domain import EpisodeDomain, episode_domains
from tasks.ros.ros2.dds_node import DEFAULT, MAP, DdsNode, dds_qos, structure
from tasks.ros.ros2.interface_types import ADD_TAGS, CANCEL, type_store
from tasks.ros.ros2.ros2_node import (
    STAMPED,
    JobRequests,
    RobotInterface,
    Ros2Node,
    request_tags,
    stamped_twist_bytes,
    twist_bytes,
)
from tests.repository import ROOT
from tests.servers.eventually import eventually
from tests.servers.open_files import open_files

TWIST = "geometry_msgs/msg/Twist"


@pytest.fixture
def job() -> JobRequests:
    return JobRequests()


@pytest.fixture
def robot(domain: EpisodeDomain, job: JobRequests) -> Iterator[Ros2Node]:
    made = Ros2Node(domain, RobotInterface({"/scan": "sensor_msgs/msg/LaserScan"}, "/cmd_vel"), job)
    yield made
    made.close()


def _threads() -> set[int]:
    return {int(each.name) for each in Path("/proc/self/task").iterdir()}


def _qos() -> Qos:
    return dds_qos(DEFAULT, b"")


def _call(domain: EpisodeDomain, robot: Ros2Node, service: str, kind: str, **values: object) -> object:
    """Returns the reply to a request, as a client of rmw_cyclonedds gets it: with the header of its request."""
    participant = DomainParticipant(domain.number)
    asked, told = structure(f"{kind}_Request", service=True), structure(f"{kind}_Response", service=True)
    writer = DataWriter(participant, Topic(participant, f"rq{service}Request", asked), _qos())
    reader = DataReader(participant, Topic(participant, f"rr{service}Reply", told), _qos())
    eventually(lambda: writer.get_publication_matched_status().current_count)
    writer.write(asked(guid=77, sequence=3, **values))  # type: ignore[call-arg]
    eventually(robot.serve)
    (reply,) = eventually(lambda: reader.take(2))
    assert (reply.guid, reply.sequence) == (77, 3)  # type: ignore[attr-defined]
    return reply


def test_robomakers_service_takes_tags(domain: EpisodeDomain, robot: Ros2Node, job: JobRequests) -> None:
    tag = structure("robomaker_simulation_msgs/msg/Tag")
    tags = [tag(key="room", value="kitchen"), tag(key="a", value="")]  # type: ignore[call-arg]
    reply = _call(domain, robot, "/robomaker/job/add_tags", ADD_TAGS, tags=tags)
    assert reply.success  # type: ignore[attr-defined]
    assert job.tags == {"room": "kitchen", "a": ""}


def test_tags_that_robomaker_does_not_take_are_refused_with_the_reason(
    domain: EpisodeDomain, robot: Ros2Node, job: JobRequests
) -> None:
    tag = structure("robomaker_simulation_msgs/msg/Tag")
    many = [tag(key=str(number), value="") for number in range(51)]  # type: ignore[call-arg]
    reply = _call(domain, robot, "/robomaker/job/add_tags", ADD_TAGS, tags=many)
    assert not reply.success  # type: ignore[attr-defined]
    assert "at most 50" in reply.message  # type: ignore[attr-defined]
    assert job.tags == {}


@given(st.binary(max_size=80).map(lambda data: b"\x00\x01\x00\x00" + data) | st.binary(max_size=80))
@example(b"\x00\x01\x00\x00\xff\xff\xff\xff")
@example(bytes(REQUEST_BYTES + 1))
def test_bytes_that_are_no_request_have_no_tags(request: bytes) -> None:
    try:
        found = request_tags(type_store(), request)
    except ValueError:
        return
    assert all(isinstance(text, str) for pair in found.items() for text in pair)


def test_robomakers_service_cancels(domain: EpisodeDomain, robot: Ros2Node, job: JobRequests) -> None:
    assert not job.cancelled
    assert _call(domain, robot, "/robomaker/job/cancel", CANCEL, structure_needs_at_least_one_member=0)
    assert job.cancelled


def test_the_graph_is_told_of_the_node_with_its_readers_and_writers(domain: EpisodeDomain) -> None:
    node = DdsNode(domain, "robot")
    scan = node.publisher("/scan", "sensor_msgs/msg/LaserScan", DEFAULT)
    commands = node.subscription("/cmd_vel", TWIST, DEFAULT)
    node.announce()
    participant = DomainParticipant(domain.number)
    kind = "rmw_dds_common/msg/ParticipantEntitiesInfo"
    latched = dds_qos(DEFAULT._replace(depth=1, latched=True), b"")
    reader = DataReader(participant, Topic(participant, "ros_discovery_info", structure(kind)), latched)
    (told,) = eventually(lambda: reader.take(2))
    assert bytes(told.gid.data) == node.participant.get_guid().bytes  # type: ignore[attr-defined]
    (own,) = told.node_entities_info_seq  # type: ignore[attr-defined]
    assert (own.node_namespace, own.node_name) == ("/", "robot")
    assert [bytes(each.data) for each in own.writer_gid_seq] == [scan.guid.bytes]
    assert [bytes(each.data) for each in own.reader_gid_seq] == [commands.guid.bytes]
    node.close()


def test_what_is_kept_for_who_comes_later_is_recorded_though_it_was_said_before(
    domain: EpisodeDomain, job: JobRequests
) -> None:
    mapper, said = DdsNode(domain, "mapper"), b"\x00\x01\x00\x00" + bytes(48)
    kept, gone = (mapper.publisher(topic, TWIST, each) for topic, each in (("/kept", MAP), ("/gone", DEFAULT)))
    kept.write(said)
    gone.write(said)
    first_port = 7400 + 250 * domain.number + 10
    recorded = {"/kept": TWIST, "/gone": TWIST}
    robot = Ros2Node(domain.link([f"127.0.0.1:{first_port}"]), RobotInterface({}, "/cmd_vel", recorded=recorded), job)
    assert eventually(robot.heard) == [("/kept", said[4:])]
    eventually(lambda: gone.readers)
    gone.write(said)
    assert eventually(robot.heard) == [("/gone", said[4:])]
    robot.close()
    mapper.close()


def test_a_robot_that_is_closed_leaves_no_thread_and_no_port(domain: EpisodeDomain) -> None:
    threads, files = _threads(), open_files()
    robot = Ros2Node(domain, RobotInterface({"/clock": "rosgraph_msgs/msg/Clock"}, "/cmd_vel"), JobRequests())
    assert robot.threads == _threads() - threads != set()
    robot.close()
    robot.close()
    # The kernel lists a thread that was waited for until it has cleared up; what others held may be gone by now.
    eventually(lambda: _threads() <= threads)
    assert open_files() <= files


def test_twists_of_both_byte_orders_are_read_and_others_are_left_as_they_are() -> None:
    store = type_store()
    vector = store.types["geometry_msgs/msg/Vector3"]
    message = store.types[TWIST](linear=vector(x=0.5, y=0.1, z=0.0), angular=vector(x=0.0, y=0.0, z=-1.0))
    little = bytes(store.serialize_cdr(message, TWIST, little_endian=True))
    big = bytes(store.serialize_cdr(message, TWIST, little_endian=False))
    assert twist_bytes(little) == twist_bytes(big) == little[4:]
    assert twist_bytes(b"\x00\x01\x00\x00short") == b"\x00\x01\x00\x00short"


@given(frame=st.text(st.characters(max_codepoint=127, min_codepoint=1), max_size=20))
@pytest.mark.parametrize("order", ["little", "big"])
def test_a_stamped_twist_is_its_twist_whatever_its_frame_is_called(order: str, frame: str) -> None:
    store = type_store()
    types = store.types
    vector, now = types["geometry_msgs/msg/Vector3"], types["builtin_interfaces/msg/Time"](sec=3, nanosec=4)
    twist = types[TWIST](linear=vector(x=0.5, y=0.1, z=0.0), angular=vector(x=0.0, y=0.0, z=-1.0))
    message = types[STAMPED](header=types["std_msgs/msg/Header"](stamp=now, frame_id=frame), twist=twist)
    stamped = bytes(store.serialize_cdr(message, STAMPED, little_endian=order == "little"))
    assert stamped_twist_bytes(stamped) == bytes(store.serialize_cdr(twist, TWIST))[4:]


@given(st.binary(max_size=120))
def test_bytes_that_are_no_stamped_twist_are_left_for_the_reader_to_refuse(data: bytes) -> None:
    assert isinstance(stamped_twist_bytes(data), bytes)


def test_each_episode_has_a_domain_and_a_tag_of_its_own() -> None:
    found = episode_domains(30)
    try:
        assert len({each.number for each in found}) == len({each.tag for each in found}) == 30
        with pytest.raises(OSError, match="simulate fewer lanes") as told:
            episode_domains(103)
        assert told.value.errno in NO_ROOM, "a chunk of fewer lanes is tried"
    finally:
        for each in found:
            each.close()


def test_who_finds_too_few_domains_waits_for_another_run_and_holds_none_meanwhile(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(dds_domain, "DOMAINS", range(20))
    others = episode_domains(12)
    files, while_it_waits = len(os.listdir("/proc/self/fd")), list[int]()  # noqa: PTH208 - numbers, not paths

    def the_other_run_ends(_: float) -> None:
        while_it_waits.append(len(os.listdir("/proc/self/fd")))  # noqa: PTH208 - numbers, not paths
        for each in others:
            each.close()

    monkeypatch.setattr(dds_domain.time, "sleep", the_other_run_ends)
    for each in episode_domains(10):
        each.close()
    assert while_it_waits[0] <= files


def test_two_processes_never_have_the_same_domain() -> None:
    asked = "from tasks.ros.ros2.dds_domain import *; found = episode_domains(30); "
    asked += "print([each.number for each in found]); input()"
    command = [sys.executable, "-W", "ignore", "-c", asked]
    with subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        theirs = json.loads(other.stdout.readline())
        # Whatever numbers a process begins with, it leaves out those.
        with_theirs = [number for number in theirs if (held := _hold(number)) and held.close() is None]
        other.communicate("\n")
    assert (len(theirs), with_theirs) == (30, [])


def _hold(number: int) -> socket.socket | None:
    return dds_domain._held(number)


def test_nodes_are_told_of_the_loopback_alone(domain: EpisodeDomain, tmp_path: Path) -> None:
    environment = domain.environment(tmp_path)
    assert environment["RMW_IMPLEMENTATION"] == "rmw_cyclonedds_cpp"
    assert environment["ROS_DOMAIN_ID"] == str(domain.number)
    assert "address='127.0.0.1'" in environment["CYCLONEDDS_URI"]
    assert "<AllowMulticast>false" in environment["CYCLONEDDS_URI"]
    assert domain.tag in environment["CYCLONEDDS_URI"]


@pytest.mark.parametrize("version", [2, 3])
def test_fast_dds_is_told_of_the_loopback_alone_too_and_has_no_shared_memory(version: int, tmp_path: Path) -> None:
    environment = EpisodeDomain(7, "", "rmw_fastrtps_cpp").environment(tmp_path, version)
    root = ElementTree.fromstring(Path(environment["FASTDDS_DEFAULT_PROFILES_FILE"]).read_text())  # noqa: S314 - our own
    texts = {each.tag.rpartition("}")[2]: each.text for each in root.iter()}
    assert (texts["useBuiltinTransports"], texts["type"]) == ("false", "UDPv4")
    assert {each.text for each in root.iter() if each.tag.endswith("address")} == {"127.0.0.1"}
    assert ("fastdds.type_propagation" in texts.values()) == (version == 3)
    assert environment["FASTRTPS_DEFAULT_PROFILES_FILE"] == environment["FASTDDS_DEFAULT_PROFILES_FILE"]
    # Writers ask soon what has come, 3 s by default; readers that nobody answers yet do not ask without a pause.
    beat = next(each for each in root.iter() if each.tag.endswith(("heartbeatPeriod", "heartbeat_period")))
    first = next(each for each in root.iter() if each.tag.endswith(("initialAcknackDelay", "initial_acknack_delay")))
    assert 0 < int(beat[0].text or "") < 100_000_000
    assert int(first[0].text or "") > 0
