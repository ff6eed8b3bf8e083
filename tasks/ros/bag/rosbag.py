"""Writes a log as a bag of ROS 1: format 2.0 (wiki.ros.org/Bags/Format/2.0), with an index, its chunks in LZ4.

The same log gives the same bytes: neither the machine nor its clock is in the file.
"""

from pathlib import Path
from typing import cast

import lz4.frame
from rosbags.interfaces import Connection
from rosbags.rosbag1 import Writer

from tasks.ros.bag.message_log import SENDER, Channel, MessageLog
from tasks.ros.bag.message_types import long_name, ros1_types, ros2_types, transcoder


def write_rosbag(path: Path, log: MessageLog) -> None:
    """Writes a log as a bag.

    Args:
        path: The file, overwritten.
        log: What it holds.
    """
    path.unlink(missing_ok=True)
    types = ros1_types(log.channels)
    recode = transcoder(ros2_types(log.channels), log.encoding, "ros1")
    kinds = {channel.topic: channel.kind for channel in log.channels}
    bag = Writer(path)
    bag.compression_format, bag.compressor = "lz4", _frame
    with bag:

        def connect(channel: Channel) -> Connection:
            text, digest = channel.definition, channel.md5sum
            if not text or not digest:
                text, digest = types.generate_msgdef(long_name(channel.kind))
            return bag.add_connection(
                channel.topic,
                long_name(channel.kind),
                msgdef=text,
                md5sum=digest,
                callerid=SENDER,
                latching=int(channel.latched),
            )

        connections = {channel.topic: connect(channel) for channel in log.channels}
        for time_ns, topic, body in log.entries:
            bag.write(connections[topic], time_ns, recode(body, kinds[topic]))


def _frame(chunk: bytes) -> bytes:
    """Returns a chunk as ROS 1 compresses it.

    Its reader (roslz4, lz4s.c) refuses frames whose blocks build on one another, that have no checksum at their end or
    that say their size at the beginning, which are those that rosbags writes.
    """
    return cast("bytes", lz4.frame.compress(chunk, block_linked=False, content_checksum=True, store_size=False))
