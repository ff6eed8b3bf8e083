"""MCAP with ROS's messages keeps to its profiles, so that Foxglove and other readers know what is in it."""

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import Channel, Message, Schema
from mcap.well_known import MessageEncoding, SchemaEncoding
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from tasks.ros.bag.bag_file import Profile, write_ros_mcap
from tests.ros.bag.tracks import log, track

Found = list[tuple[Schema, Channel, Message]]


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
