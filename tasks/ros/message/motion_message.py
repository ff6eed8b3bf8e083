"""Writers of where a robot is and what it shall do: clock, odometry, transforms, goal, map; reader of its command."""

import struct
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from tasks.ros.message.stamp import Stamp, header, text, yaw_quaternion

TWIST_BYTES = 48
_CLOCK = struct.Struct("<II")
_POSE = struct.Struct("<7d")
_TWIST = struct.Struct("<6d")
_COUNT = struct.Struct("<I")
_GRID = struct.Struct("<IIfII7dI")
_NO_COVARIANCE = bytes(36 * 8)


class FrameTransform(NamedTuple):
    """Where a frame is in another.

    Attributes:
        parent, child: Names of the frames.
        pose: Of the child in the parent: (x m, y m, yaw rad).
    """

    parent: str
    child: str
    pose: tuple[float, float, float]


class PlanarTwist(NamedTuple):
    """The parts of a Twist that a planar base can follow: m/s ahead and to the left, rad/s counter-clockwise."""

    ahead_m_s: float
    left_m_s: float
    turn_rad_s: float


def clock(time: Stamp) -> bytes:
    """Returns a ``rosgraph_msgs/Clock``."""
    return _CLOCK.pack(*time)


def odometry(
    sequence: int,
    time: Stamp,
    pose: Float[np.ndarray, "3"],
    velocity: Float[np.ndarray, "3"],
    *,
    frame: str = "odom",
    child: str = "base_link",
) -> bytes:
    """Returns a ``nav_msgs/Odometry`` without covariances.

    Args:
        sequence: Of the message among those of its topic.
        time: When the data were true.
        pose: Of the child in the frame: (x m, y m, yaw rad).
        velocity: In the child's own frame: (m/s ahead, m/s to the left, rad/s).
        frame: Where odometry counts from.
        child: The robot's base.
    """
    x, y, yaw = map(float, pose)
    ahead, left, turn = map(float, velocity)
    return b"".join(
        (
            header(sequence, time, frame),
            text(child),
            _POSE.pack(x, y, 0.0, *yaw_quaternion(yaw)),
            _NO_COVARIANCE,
            _TWIST.pack(ahead, left, 0.0, 0.0, 0.0, turn),
            _NO_COVARIANCE,
        )
    )


def transforms(sequence: int, time: Stamp, each: Sequence[FrameTransform | tuple[str, str, Sequence[float]]]) -> bytes:
    """Returns a ``tf2_msgs/TFMessage``.

    Args:
        sequence: Of the message among those of its topic.
        time: When the transforms were true.
        each: Where the frames are; behind a pose may stand its height (m).
    """
    parts = [_COUNT.pack(len(each))]
    for parent, child, (x, y, yaw, *height) in each:
        pose = _POSE.pack(float(x), float(y), float(sum(height)), *yaw_quaternion(float(yaw)))
        parts += [header(sequence, time, parent), text(child), pose]
    return b"".join(parts)


def pose_stamped(sequence: int, time: Stamp, frame: str, pose: Sequence[float] | Float[np.ndarray, "3"]) -> bytes:
    """Returns a ``geometry_msgs/PoseStamped``.

    Args:
        sequence: Of the message among those of its topic.
        time: When the pose was given.
        frame: The frame that it is in.
        pose: (x m, y m, yaw rad).
    """
    x, y, yaw = map(float, pose)
    return header(sequence, time, frame) + _POSE.pack(x, y, 0.0, *yaw_quaternion(yaw))


def occupancy_grid(
    sequence: int, time: Stamp, frame: str, cells: np.ndarray, *, origin_m: tuple[float, float], cell_m: float
) -> bytes:
    """Returns a ``nav_msgs/OccupancyGrid``.

    Args:
        sequence: Of the message among those of its topic.
        time: When the map was made.
        frame: The frame that its origin is in.
        cells: Rows along y from the origin: 0 free, 100 not free, -1 not known.
        origin_m: The outer corner of the first cell.
        cell_m: Side of a cell.
    """
    rows, columns = cells.shape
    origin = (*map(float, origin_m), 0.0, *yaw_quaternion(0.0))
    numbers = _GRID.pack(*time, cell_m, columns, rows, *origin, rows * columns)
    return header(sequence, time, frame) + numbers + np.ascontiguousarray(cells, np.int8).tobytes()


def twist(command: PlanarTwist) -> bytes:
    """Returns a ``geometry_msgs/Twist``."""
    return _TWIST.pack(command.ahead_m_s, command.left_m_s, 0.0, 0.0, 0.0, command.turn_rad_s)


def read_twist(data: bytes) -> PlanarTwist:
    """Returns what a ``geometry_msgs/Twist`` asks of a planar base.

    Raises:
        ValueError: If the bytes are not a Twist.
    """
    if len(data) != TWIST_BYTES:
        raise ValueError(f"a message of {len(data)} bytes: a geometry_msgs/Twist has {TWIST_BYTES}")
    ahead, left, _, _, _, turn = _TWIST.unpack(data)
    return PlanarTwist(ahead, left, turn)
