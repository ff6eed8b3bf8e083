"""A log of an episode's messages, as they went over its topics or as they would have gone."""

import heapq
from collections.abc import Iterable
from typing import Literal, NamedTuple

FIRST_NS = 1_000_000_000
"""The time at which logs of episodes begin: in ROS 1 a time of 0 means that it is not known yet."""
SENDER = "/simyard"
"""Name of the node that logs say the messages came from."""

Encoding = Literal["ros1", "cdr"]


class Channel(NamedTuple):
    """A topic of a log.

    Attributes:
        topic: Its name.
        kind: Type of its messages, as ROS 1 writes it: ``sensor_msgs/LaserScan``.
        definition: Text of the type with those of the types in it, as a publisher tells it; empty for one that ROS
            brings along.
        md5sum: ROS 1's digest of the definition, as a publisher tells it; empty likewise.
        latched: Whether who listens later gets the last message, too.
    """

    topic: str
    kind: str
    definition: str = ""
    md5sum: str = ""
    latched: bool = False


class LogEntry(NamedTuple):
    """A message of a log.

    Attributes:
        time_ns: When it was sent, in simulated time since the log's origin.
        topic: Where.
        body: Its bytes, in the log's encoding.
    """

    time_ns: int
    topic: str
    body: bytes


class MessageLog(NamedTuple):
    """Messages in the order in which they were sent.

    Attributes:
        channels: All topics, also those without a message.
        entries: The messages; no time is smaller than the one before.
        encoding: ``ros1`` as in TCPROS, or ``cdr`` as in DDS, with its header of four bytes.
    """

    channels: tuple[Channel, ...]
    entries: Iterable[LogEntry]
    encoding: Encoding = "ros1"


def with_other_topics(log: MessageLog, others: MessageLog) -> MessageLog:
    """Returns a log with the topics of another one that it does not have, in the order of time.

    Args:
        log: What comes first at a time.
        others: In the same encoding.
    """
    own = {channel.topic for channel in log.channels}
    channels = (*log.channels, *(channel for channel in others.channels if channel.topic not in own))
    more = (entry for entry in others.entries if entry.topic not in own)
    entries = heapq.merge(log.entries, more, key=lambda entry: entry.time_ns)
    return MessageLog(channels, tuple(entries), log.encoding)
