"""Reads bags with rosbags, which other programs read them with."""

from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader


def read_bag(path: Path, topic: str) -> list[Any]:
    """Returns the messages of a topic, in their order."""
    with AnyReader([path]) as reader:
        chosen = [each for each in reader.connections if each.topic == topic]
        return [reader.deserialize(body, each.msgtype) for each, _, body in reader.messages(chosen)]
