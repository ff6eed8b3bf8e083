"""A bag of ROS 1 holds the log's bytes, is indexed, and is compressed as ROS 1 can read it."""

import struct
from pathlib import Path

import pytest
from rosbags.interfaces import ConnectionExtRosbag1
from rosbags.rosbag1 import Reader

from tasks.ros.bag.bag_file import long_name, ros2_types, write_rosbag
from tasks.ros.bag.message_log import Channel, Entry, MessageLog
from tests.ros.bag.tracks import log

OWN = Channel("/battery", "my_msgs/Battery", "float32 volts\nHeader header\n", "d" * 32)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bag") / "episode.bag"
    write_rosbag(path, log())
    return path


def test_a_bag_holds_the_messages_of_its_log_in_their_order(bag: Path):
    with Reader(bag) as reader:
        found = [(time_ns, each.topic, bytes(body)) for each, time_ns, body in reader.messages()]
    assert sorted(found) == sorted(map(tuple, log().entries))
    assert [time_ns for time_ns, _, _ in found] == [entry.time_ns for entry in log().entries]


def test_types_have_the_digests_that_ros_has(bag: Path):
    with Reader(bag) as reader:
        digests = {each.topic: each.digest for each in reader.connections}
    assert digests["/scan"] == "90c7ef2dc6895d81024acba2ac42f369"
    assert digests["/tf"] == "94810edda583a504dfda3829e70d7eec"
    assert digests["/odom"] == "cd5e73d190d741a2f92e81eda573aca7"


def test_maps_goals_and_fixed_frames_are_latched(bag: Path):
    with Reader(bag) as reader:
        latched = {
            each.topic
            for each in reader.connections
            if isinstance(each.ext, ConnectionExtRosbag1) and each.ext.latching
        }
    assert latched == {"/map", "/tf_static", "/move_base_simple/goal"}


def test_the_same_log_is_the_same_bytes_whatever_was_there(bag: Path, tmp_path: Path):
    again = tmp_path / "again.bag"
    again.write_bytes(b"an older bag" * 10_000)
    write_rosbag(again, log())
    assert again.read_bytes() == bag.read_bytes()


def test_chunks_are_lz4_of_independent_blocks_with_a_checksum_at_the_end(bag: Path):
    """The flags of LZ4's frame format, which ROS 1's reader insists on."""
    body = bag.read_bytes()
    magic = struct.pack("<I", 0x184D2204)
    assert body.count(b"compression=lz4") == body.count(magic) > 0
    flags = body[body.index(magic) + 4]
    assert flags == 0b01_1_0_0_1_0_0  # version, independent blocks, no block checksums, no size, a checksum at the end


def test_a_type_of_ones_own_goes_in_as_its_publisher_tells_it(tmp_path: Path):
    write_rosbag(tmp_path / "own.bag", MessageLog((OWN,), [Entry(1_000_000_000, "/battery", b"\0\0\x80?")]))
    with Reader(tmp_path / "own.bag") as reader:
        (found,) = reader.connections
        assert (found.msgtype, found.digest, found.msgdef.data) == ("my_msgs/msg/Battery", OWN.md5sum, OWN.definition)


def test_what_a_ros_2_application_said_is_written_as_ros_1_has_it(tmp_path: Path):
    twist = Channel("/cmd_vel", "geometry_msgs/Twist")
    types = ros2_types()
    said = types.ros1_to_cdr(struct.pack("<6d", *range(6)), long_name(twist.kind))
    write_rosbag(tmp_path / "two.bag", MessageLog((twist,), [Entry(1_000_000_000, "/cmd_vel", bytes(said))], "cdr"))
    with Reader(tmp_path / "two.bag") as reader:
        assert [bytes(body) for _, _, body in reader.messages()] == [struct.pack("<6d", *range(6))]


def test_a_log_without_messages_is_a_bag(tmp_path: Path):
    write_rosbag(tmp_path / "empty.bag", MessageLog((), ()))
    with Reader(tmp_path / "empty.bag") as reader:
        assert reader.message_count == 0
