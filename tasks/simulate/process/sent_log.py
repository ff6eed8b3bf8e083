"""A log of messages on its way from the process that simulates: its topics as data, its messages as arrays."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from specs.base import Spec
from specs.bundle.ros_robot import Topic
from tasks.ros.bag.message_log import Channel, Entry, MessageLog
from tasks.simulate.process.wire import MessageRefused

LOG_ARRAYS = 4


class SentTopic(Spec):
    """A topic of a log, as ``Channel`` has it; its type is one that ROS brings along."""

    topic: Topic
    kind: str
    latched: bool


def log_parts(log: MessageLog) -> tuple[tuple[SentTopic, ...], list[np.ndarray]]:
    """Returns a log's topics, and its messages as ``LOG_ARRAYS`` arrays: times, topics' numbers, lengths, bytes."""
    numbers = {channel.topic: number for number, channel in enumerate(log.channels)}
    topics = tuple(SentTopic(topic=each.topic, kind=each.kind, latched=each.latched) for each in log.channels)
    entries = tuple(log.entries)
    arrays = [
        np.array([entry.time_ns for entry in entries], np.int64),
        np.array([numbers[entry.topic] for entry in entries], np.int32),
        np.array([len(entry.body) for entry in entries], np.int64),
        np.frombuffer(b"".join(entry.body for entry in entries), np.uint8),
    ]
    return topics, arrays


def log_of(topics: Sequence[SentTopic], arrays: Sequence[np.ndarray]) -> MessageLog:
    """Returns the log whose parts came.

    Raises:
        MessageRefused: They are not those of a log.
    """
    times, numbers, lengths, body = arrays
    ends = np.concatenate([[0], np.cumsum(lengths)])
    sound = len(times) == len(numbers) == len(lengths) and not np.any(lengths < 0) and ends[-1] == len(body)
    if not sound or np.any((numbers < 0) | (numbers >= len(topics))):
        raise MessageRefused(f"a log of {len(times)} messages and {len(body)} bytes, whose parts do not fit together")
    whole, spans = body.tobytes(), pairwise(ends.tolist())
    entries = (
        Entry(int(time_ns), topics[number].topic, whole[begin:end])
        for time_ns, number, (begin, end) in zip(times, numbers, spans, strict=True)
    )
    return MessageLog(tuple(Channel(each.topic, each.kind, latched=each.latched) for each in topics), tuple(entries))
