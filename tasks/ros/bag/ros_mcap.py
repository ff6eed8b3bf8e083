"""Writes a log as MCAP with ROS's messages, as the profiles ``ros1`` and ``ros2`` ask for (mcap.dev/spec/registry)."""

from collections.abc import Mapping
from pathlib import Path
from typing import Literal, NamedTuple

import yaml
from mcap.writer import CompressionType, Writer

from tasks.ros.bag.message_log import SENDER, Channel, Encoding, MessageLog
from tasks.ros.bag.message_types import long_name, ros1_types, ros2_types, transcoder

Profile = Literal["ros1", "ros2"]
_LIBRARY = "simyard"
# Qualities of service by the numbers of rmw/types.h: rosbag2 knows words for them only since Jazzy.
_KEEP_LAST, _RELIABLE, _TRANSIENT_LOCAL, _VOLATILE, _AUTOMATIC = 1, 1, 1, 2, 1
_FOR_EVER = {"sec": 9_223_372_036, "nsec": 854_775_807}
_QUEUE = 10


class WrittenMcap(NamedTuple):
    """What a file holds.

    Attributes:
        counts: How many messages of each topic.
        first_ns, last_ns: Times of the first and of the last message; 0 if there is none.
    """

    counts: Mapping[str, int]
    first_ns: int
    last_ns: int


def write_ros_mcap(path: Path, log: MessageLog, profile: Profile) -> WrittenMcap:
    """Writes a log as MCAP, and returns what the file holds.

    Args:
        path: The file, overwritten.
        log: What it holds.
        profile: Whose messages: those of ROS 1, or those of ROS 2.
    """
    encoding: Encoding = "ros1" if profile == "ros1" else "cdr"
    recode = transcoder(ros2_types(log.channels), log.encoding, encoding)
    kinds = {channel.topic: channel.kind for channel in log.channels}
    counts, first_ns, last_ns = dict.fromkeys(kinds, 0), 0, 0
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(profile=profile, library=_LIBRARY)
        channels = _ros1_channels(writer, log) if profile == "ros1" else _ros2_channels(writer, log)
        for number, (time_ns, topic, body) in enumerate(log.entries):
            recoded = recode(body, kinds[topic])
            writer.add_message(channels[topic], time_ns, recoded, time_ns, sequence=number)
            counts[topic] += 1
            first_ns, last_ns = first_ns or time_ns, time_ns
        writer.finish()
    return WrittenMcap(counts, first_ns, last_ns)


def offered_qos(channel: Channel) -> str:
    """Returns the quality of service that a channel's publisher offers, as rosbag2 keeps it: a text in YAML."""
    qos = {
        "history": _KEEP_LAST,
        "depth": 1 if channel.latched else _QUEUE,
        "reliability": _RELIABLE,
        "durability": _TRANSIENT_LOCAL if channel.latched else _VOLATILE,
        "deadline": _FOR_EVER,
        "lifespan": _FOR_EVER,
        "liveliness": _AUTOMATIC,
        "liveliness_lease_duration": _FOR_EVER,
        "avoid_ros_namespace_conventions": False,
    }
    return plain_yaml([qos]).strip()


def plain_yaml(document: object) -> str:
    """Returns a document as YAML in which each value is written out wherever it stands."""
    return yaml.dump(document, Dumper=_Plain, sort_keys=False)


class _Plain(yaml.SafeDumper):
    """Writes values out wherever they stand, since not every reader follows YAML's anchors."""

    def ignore_aliases(self, data: object) -> bool:  # noqa: ARG002 - PyYAML asks so
        return True


def _ros1_channels(writer: Writer, log: MessageLog) -> dict[str, int]:
    types, schemas = ros1_types(log.channels), dict[str, int]()
    channels: dict[str, int] = {}
    for channel in log.channels:
        text, md5sum = channel.definition, channel.md5sum
        if not text or not md5sum:
            text, md5sum = types.generate_msgdef(long_name(channel.kind))
        if channel.kind not in schemas:
            schemas[channel.kind] = writer.register_schema(channel.kind, "ros1msg", text.encode())
        about = {"callerid": SENDER, "md5sum": md5sum, "topic": channel.topic, "latching": str(int(channel.latched))}
        channels[channel.topic] = writer.register_channel(channel.topic, "ros1", schemas[channel.kind], about)
    return channels


def _ros2_channels(writer: Writer, log: MessageLog) -> dict[str, int]:
    types, schemas = ros2_types(log.channels), dict[str, int]()
    channels: dict[str, int] = {}
    for channel in log.channels:
        name = long_name(channel.kind)
        if name not in schemas:
            text, _ = types.generate_msgdef(name, ros_version=2)
            schemas[name] = writer.register_schema(name, "ros2msg", text.encode())
        about = {"offered_qos_profiles": offered_qos(channel)}
        channels[channel.topic] = writer.register_channel(channel.topic, "cdr", schemas[name], about)
    return channels
