"""Bags of ROS 1, bags of ROS 2 and MCAP hold a log's messages, and other readers read them."""

import struct
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import Channel as McapChannel
from mcap.records import Message, Schema
from mcap.well_known import MessageEncoding, SchemaEncoding
from rosbags.highlevel import AnyReader
from rosbags.interfaces import ConnectionExtRosbag1, ConnectionExtRosbag2, QosDurability
from rosbags.rosbag1 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from specs.field_types import BAG_ENDINGS
from tasks.ros.bag.bag_file import Profile, long_name, ros2_types, write_bags, write_ros_mcap, write_rosbag
from tasks.ros.bag.message_log import Channel, LogEntry, MessageLog
from tests.ros.bag.tracks import SAMPLES, log, track

Found = list[tuple[Schema, McapChannel, Message]]


def read(path: Path) -> Found:
    with path.open("rb") as file:
        messages = make_reader(file, validate_crcs=True).iter_messages()
        return [(schema, channel, message) for schema, channel, message in messages if schema]


@pytest.fixture(scope="module", params=["ros1", "ros2"])
def profile(request: pytest.FixtureRequest) -> Profile:
    return request.param


@pytest.fixture(scope="module")
def file(profile: Profile, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("mcap") / f"{profile}.mcap"
    write_ros_mcap(path, log(), profile)
    return path


def test_schemas_and_channels_are_named_and_encoded_as_the_profile_asks(file: Path, profile: Profile):
    with file.open("rb") as opened:
        assert make_reader(opened).get_header().profile == profile
    names = {channel.topic: schema.name for schema, channel, _ in read(file)}
    one = profile == "ros1"
    assert names["/scan"] == ("sensor_msgs/LaserScan" if one else "sensor_msgs/msg/LaserScan")
    assert names["/tf"] == ("tf2_msgs/TFMessage" if one else "tf2_msgs/msg/TFMessage")
    encodings = {(schema.encoding, channel.message_encoding) for schema, channel, _ in read(file)}
    expected = (SchemaEncoding.ROS1, MessageEncoding.ROS1) if one else (SchemaEncoding.ROS2, MessageEncoding.CDR)
    assert encodings == {expected}


def test_there_are_as_many_messages_as_in_the_log_at_their_times(file: Path):
    found = [(message.log_time, channel.topic) for _, channel, message in read(file)]
    assert found == [(entry.time_ns, entry.topic) for entry in log().entries]
    with file.open("rb") as opened:
        summary = make_reader(opened).get_summary()
    assert summary
    assert summary.statistics
    assert summary.statistics.message_count == len(found)


def test_a_reader_needs_nothing_but_the_schemas_in_the_file(file: Path, profile: Profile):
    store = get_typestore(Stores.EMPTY)
    scans = [(schema, message) for schema, channel, message in read(file) if channel.topic == "/scan"]
    store.register(get_types_from_msg(scans[0][0].data.decode(), "sensor_msgs/msg/LaserScan"))
    parse = store.deserialize_ros1 if profile == "ros1" else store.deserialize_cdr
    ranges = [getattr(parse(message.data, "sensor_msgs/msg/LaserScan"), "ranges") for _, message in scans]  # noqa: B009
    assert np.array_equal(ranges, track().ranges_m[:-1])


def test_channels_say_what_the_profile_lets_them_say(file: Path, profile: Profile):
    about = {channel.topic: channel.metadata for _, channel, _ in read(file)}
    if profile == "ros1":
        assert about["/map"]["latching"] == "1"
        assert about["/scan"]["md5sum"] == "90c7ef2dc6895d81024acba2ac42f369"
    else:
        assert "durability: 1" in about["/map"]["offered_qos_profiles"]
        assert "durability: 2" in about["/scan"]["offered_qos_profiles"]


def test_the_same_log_is_the_same_bytes(file: Path, profile: Profile, tmp_path: Path):
    write_ros_mcap(tmp_path / "again.mcap", log(), profile)
    assert (tmp_path / "again.mcap").read_bytes() == file.read_bytes()


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
    write_rosbag(tmp_path / "own.bag", MessageLog((OWN,), [LogEntry(1_000_000_000, "/battery", b"\0\0\x80?")]))
    with Reader(tmp_path / "own.bag") as reader:
        (found,) = reader.connections
        assert (found.msgtype, found.digest, found.msgdef.data) == ("my_msgs/msg/Battery", OWN.md5sum, OWN.definition)


def test_what_a_ros_2_application_said_is_written_as_ros_1_has_it(tmp_path: Path):
    twist = Channel("/cmd_vel", "geometry_msgs/Twist")
    types = ros2_types()
    said = types.ros1_to_cdr(struct.pack("<6d", *range(6)), long_name(twist.kind))
    write_rosbag(tmp_path / "two.bag", MessageLog((twist,), [LogEntry(1_000_000_000, "/cmd_vel", bytes(said))], "cdr"))
    with Reader(tmp_path / "two.bag") as reader:
        assert [bytes(body) for _, _, body in reader.messages()] == [struct.pack("<6d", *range(6))]


def test_a_log_without_messages_is_a_bag(tmp_path: Path):
    write_rosbag(tmp_path / "empty.bag", MessageLog((), ()))
    with Reader(tmp_path / "empty.bag") as reader:
        assert reader.message_count == 0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("rosbag2")
    files = write_bags(place, "000007", log(), ["rosbag2"])
    assert [path.relative_to(place).as_posix() for path in files] == [
        "000007-rosbag2/000007-rosbag2_0.mcap",
        "000007-rosbag2/metadata.yaml",
    ]
    return files[0].parent


def test_its_metadata_say_what_is_in_it(folder: Path):
    with AnyReader([folder]) as reader:
        assert reader.message_count == len(list(log().entries))
        assert reader.start_time == 1_000_000_000
        assert reader.topics["/odom"].msgcount == SAMPLES


def test_whoever_listens_later_still_gets_the_map(folder: Path):
    with AnyReader([folder]) as reader:
        offered = {
            each.topic: each.ext.offered_qos_profiles[0].durability
            for each in reader.connections
            if isinstance(each.ext, ConnectionExtRosbag2)
        }
    assert offered["/map"] == offered["/tf_static"] == QosDurability.TRANSIENT_LOCAL
    assert offered["/scan"] == QosDurability.VOLATILE


def test_its_scans_are_those_of_the_log(folder: Path):
    with AnyReader([folder]) as reader:
        scans = [reader.deserialize(body, each.msgtype) for each, _, body in reader.messages() if each.topic == "/scan"]
    assert np.array_equal([getattr(scan, "ranges") for scan in scans], track().ranges_m[:-1])  # noqa: B009


def test_all_formats_are_written_of_one_log(tmp_path: Path):
    files = write_bags(tmp_path, "x", log(), list(BAG_ENDINGS))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["x-ros1.mcap", "x-rosbag2", "x.bag"]
    assert all(path.stat().st_size for path in files)
