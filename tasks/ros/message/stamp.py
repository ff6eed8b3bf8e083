"""Simulated time, and the parts that ROS 1 messages share: headers, texts and orientations.

ROS 1 writes numbers little endian without padding, and the length of a text or list before it as an unsigned 32 bit
number (wiki.ros.org/ROS/Technical%20Overview).
"""

import math
import struct
from functools import lru_cache
from typing import NamedTuple

_LENGTH = struct.Struct("<I")
_TIMES = struct.Struct("<III")


class Stamp(NamedTuple):
    """Simulated time."""

    seconds: int
    nanoseconds: int


def stamp(time_ns: int) -> Stamp:
    """Returns the time of whole nanoseconds; sums of floats would drift."""
    return Stamp(*divmod(time_ns, 1_000_000_000))


@lru_cache(maxsize=1024)
def text(value: str) -> bytes:
    """Returns a text with its length before it. The robot's texts are few: names of frames and joints."""
    data = value.encode()
    return _LENGTH.pack(len(data)) + data


def header(sequence: int, time: Stamp, frame: str) -> bytes:
    """Returns a ``std_msgs/Header``.

    Args:
        sequence: Of the message among those of its topic.
        time: When the data were true.
        frame: The frame that they are in.
    """
    return _TIMES.pack(sequence & 0xFFFFFFFF, time.seconds, time.nanoseconds) + text(frame)


def frame_message(data: bytes) -> bytes:
    """Returns a message as TCPROS sends it: its length, and its bytes."""
    return _LENGTH.pack(len(data)) + data


def yaw_quaternion(yaw_rad: float) -> tuple[float, float, float, float]:
    """Returns (x, y, z, w) of a turn about the vertical axis."""
    return 0.0, 0.0, math.sin(yaw_rad / 2.0), math.cos(yaw_rad / 2.0)
