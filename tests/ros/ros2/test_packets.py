"""The robot's wire, read from packets: names, types, what endpoints say of themselves, samples byte by byte."""

import os
import subprocess
import sys
import time
from typing import NamedTuple

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from tasks.ros.message import ros_messages
from tasks.ros.message.ros_messages import stamp
from tasks.ros.ros2.dds_domain import episode_domains
from tasks.ros.ros2.interface_types import dds_type_name, type_hash, type_store
from tasks.ros.ros2.ros2_node import JobRequests, RobotInterface, Ros2Node
from tests.data.ros2.avoidance import steer
from tests.ros.ros2.packets import Capture, Endpoint, Sample, endpoints
from tests.ros.ros2.players import make_bundle

SCAN = "sensor_msgs/msg/LaserScan"
TOPICS = {
    "/clock": "rosgraph_msgs/msg/Clock",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/odom": "nav_msgs/msg/Odometry",
    "/scan": SCAN,
    "/map": "nav_msgs/msg/OccupancyGrid",
}
RELIABLE = bytes.fromhex("02000000 ffffff7f ffffffff")
LATCHED = (1).to_bytes(4, "little")
_RANGES = np.linspace(0.7, 3.0, 24).astype(np.float32)
_ROS1_SCAN = ros_messages.laser_scan(
    0, stamp(1_050_000_000), "laser", _RANGES, angle_min=-1.5, angle_increment=0.125, range_max=8.0, scan_s=0.05
)


class Wire(NamedTuple):
    """What was seen: descriptions of the robot and of its node, samples, and the command that came."""

    robot: list[Endpoint]
    node: list[Endpoint]
    samples: list[Sample]
    command: bytes

    def writer(self, topic: str) -> Endpoint:
        """Returns the robot's writer of a DDS topic."""
        return next(each for each in self.robot if each.what == "writer" and each.text("topic") == topic)


@pytest.fixture(scope="module")
def wire(tmp_path_factory: pytest.TempPathFactory) -> Wire:
    """A robot and a node, from the first packet to the answer to a scan."""
    try:
        capture = Capture()
    except PermissionError:
        pytest.skip("packets are read with CAP_NET_RAW, which this process does not have")
    program = make_bundle(tmp_path_factory.mktemp("bundle")) / "play/scripts/avoider"
    (domain,) = episode_domains(1)
    with capture:
        robot = Ros2Node(domain, RobotInterface(TOPICS, "/cmd_vel"), JobRequests())
        environment = {**domain.environment(tmp_path_factory.mktemp("lane")), "PATH": os.environ["PATH"]}
        command = [sys.executable, str(program), "--ros-args", "-r", "__node:=player", "-p", "use_sim_time:=true"]
        node = subprocess.Popen(command, env=environment)
        try:
            came = _answer(robot)
        finally:
            node.kill()
            node.wait()
            own = robot.guid.bytes[:12]
            robot.close()
            domain.close()
        samples = capture.samples()
    mine = [each for each in samples if each.guid[:12] == own]
    others = [each for each in samples if each.guid[:12] != own]
    return Wire(endpoints(mine), endpoints(others), samples, came)


def _answer(robot: Ros2Node) -> bytes:
    while not (robot.matches().commanders and robot.matches().readers["/scan"]):
        time.sleep(0.01)
    while True:
        robot.send("/scan", _ROS1_SCAN)
        time.sleep(0.01)
        if commands := robot.take_commands():
            return commands[0]


def test_the_robots_topics_have_ros_2s_names_and_types(wire: Wire) -> None:
    seen = {each.text("topic"): each.text("type") for each in wire.robot if each.what == "writer"}
    assert {f"rt{topic}": dds_type_name(kind) for topic, kind in TOPICS.items()}.items() <= seen.items()
    assert seen["ros_discovery_info"] == "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_"
    assert seen["rr/robomaker/job/cancelReply"] == "robomaker_simulation_msgs::srv::dds_::Cancel_Response_"
    heard = {each.text("topic"): each.text("type") for each in wire.robot if each.what == "reader"}
    commands = {
        each.text("type") for each in wire.robot if each.what == "reader" and each.text("topic") == "rt/cmd_vel"
    }
    assert commands == {"geometry_msgs::msg::dds_::Twist_", "geometry_msgs::msg::dds_::TwistStamped_"}
    assert heard["rq/robomaker/job/add_tagsRequest"] == "robomaker_simulation_msgs::srv::dds_::AddTags_Request_"


def test_writers_tell_the_hash_of_their_type(wire: Wire) -> None:
    for topic, kind in TOPICS.items():
        assert wire.writer(f"rt{topic}").text("user_data") == f"typehash={type_hash(kind)};"


def test_a_service_says_which_reader_and_writer_belong_together(wire: Wire) -> None:
    said = {
        each.text("user_data").partition(";")[0]
        for each in wire.robot
        if each.what != "participant" and "cancel" in each.text("topic")
    }
    assert len(said) == 1
    assert said.pop().startswith("serviceid=")


def test_a_participant_tells_its_enclave(wire: Wire) -> None:
    assert {each.text("user_data") for each in wire.robot if each.what == "participant"} == {"enclave=/;"}


def test_all_is_reliable_and_what_holds_for_ever_is_latched(wire: Wire) -> None:
    writers = {each.text("topic"): each.parameters for each in wire.robot if each.what == "writer"}
    assert {each["reliability"] for each in writers.values()} == {RELIABLE}
    latched = {topic for topic, each in writers.items() if each.get("durability") == LATCHED}
    assert latched == {"rt/tf_static", "rt/map", "ros_discovery_info"}


def test_depths_are_ros_2s_defaults(wire: Wire) -> None:
    keep_last = {
        topic: int.from_bytes(wire.writer(topic).parameters["history"][4:], "little")
        for topic in ("rt/scan", "rt/odom", "rt/tf")
    }
    assert keep_last == {"rt/scan": 10, "rt/odom": 10, "rt/tf": 100}
    assert "history" not in wire.writer("rt/tf_static").parameters, "a depth of 1 is DDS's default, and is not said"


def test_samples_are_plain_cdr_which_is_the_default_and_is_not_said(wire: Wire) -> None:
    assert all("representation" not in each.parameters for each in wire.robot)


def test_a_best_effort_reader_is_sent_the_scan_byte_by_byte(wire: Wire) -> None:
    guid = wire.writer("rt/scan").parameters["guid"]
    sent = {each.payload for each in wire.samples if each.guid == guid}
    cdr = bytes(type_store().ros1_to_cdr(_ROS1_SCAN, SCAN))
    assert sent == {cdr.ljust(-(-len(cdr) // 4) * 4, b"\0")}


def test_the_nodes_command_is_what_its_steering_says_of_the_scan(wire: Wire) -> None:
    scan = get_typestore(Stores.ROS1_NOETIC).deserialize_ros1(_ROS1_SCAN, SCAN)
    ahead, turn = steer(scan.angle_min, scan.angle_increment, list(map(float, scan.ranges)))  # type: ignore[attr-defined]
    assert wire.command == ros_messages.twist(ros_messages.PlanarTwist(ahead, 0.0, turn))
    # Nodes of tests beside this one are on the same wire.
    writers = [each for each in wire.node if each.what == "writer" and each.text("topic") == "rt/cmd_vel"]
    guids = {each.parameters["guid"] for each in writers}
    seen = [each.payload for each in wire.samples if each.guid in guids]
    assert b"\x00\x01\x00\x00" + wire.command in seen
