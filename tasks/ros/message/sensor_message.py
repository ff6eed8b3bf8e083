"""Writers of what a robot senses: laser scan, inertia, joints, bumper."""

import struct
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from tasks.ros.message.stamp import Stamp, header, text, yaw_quaternion

_SCAN = struct.Struct("<7fI")
_IMU = struct.Struct("<37d")
_COUNT = struct.Struct("<I")
_LAYOUT = struct.Struct("<II")
_NONE = _COUNT.pack(0)
_NO_COVARIANCE = (0.0,) * 9


def laser_scan(
    sequence: int,
    time: Stamp,
    frame: str,
    ranges_m: Float[np.ndarray, "rays"],
    *,
    angle_min: float,
    angle_increment: float,
    range_max: float,
    scan_s: float,
) -> bytes:
    """Returns a ``sensor_msgs/LaserScan``; a ray that meets nothing reads +inf, as REP 117 has it.

    Args:
        sequence: Of the message among those of its topic.
        time: When the scan was taken: all rays at once.
        frame: The lidar's.
        ranges_m: Counter-clockwise; ``range_max`` or more where nothing is seen, NaN where a ray failed.
        angle_min: Direction of the first ray (rad).
        angle_increment: From one ray to the next (rad).
        range_max: How far the lidar sees (m).
        scan_s: From one scan to the next.
    """
    count = len(ranges_m)
    angle_max = angle_min + angle_increment * max(count - 1, 0)
    ranges = np.array(ranges_m, "<f4")
    # Compared as the message holds them, so that no finite range ever equals ``range_max``.
    ranges[ranges >= np.float32(range_max)] = np.inf
    numbers = _SCAN.pack(angle_min, angle_max, angle_increment, 0.0, scan_s, 0.0, range_max, count)
    return b"".join((header(sequence, time, frame), numbers, ranges.tobytes(), _NONE))


def imu(
    sequence: int,
    time: Stamp,
    frame: str,
    *,
    yaw_rad: float,
    turn_rad_s: float,
    acceleration: Sequence[float] | Float[np.ndarray, "2"],
    gravity_m_s2: float = 9.81,
) -> bytes:
    """Returns a ``sensor_msgs/Imu`` of a robot on a level floor, without covariances.

    Args:
        sequence: Of the message among those of its topic.
        time: When the data were true.
        frame: The sensor's.
        yaw_rad: Where it faces.
        turn_rad_s: How fast it turns.
        acceleration: In its own frame: (m/s2 ahead, m/s2 to the left).
        gravity_m_s2: What a sensor at rest feels upward.
    """
    ahead, left = map(float, acceleration)
    turning = (0.0, 0.0, float(turn_rad_s), *_NO_COVARIANCE)
    pushed = (ahead, left, gravity_m_s2, *_NO_COVARIANCE)
    return header(sequence, time, frame) + _IMU.pack(
        *yaw_quaternion(float(yaw_rad)), *_NO_COVARIANCE, *turning, *pushed
    )


def joint_state(
    sequence: int,
    time: Stamp,
    names: Sequence[str],
    position: Float[np.ndarray, "joints"],
    speed: Float[np.ndarray, "joints"],
    *,
    frame: str = "",
) -> bytes:
    """Returns a ``sensor_msgs/JointState`` without efforts.

    Args:
        sequence: Of the message among those of its topic.
        time: When the data were true.
        names: Of the joints.
        position: Of each (rad or m).
        speed: Of each (rad/s or m/s).
        frame: Joints have none.
    """
    parts = [header(sequence, time, frame), _COUNT.pack(len(names)), *map(text, names)]
    for values in (position, speed):
        parts += [_COUNT.pack(len(values)), np.asarray(values, "<f8").tobytes()]
    return b"".join((*parts, _NONE))


def bumper(sectors: Bool[np.ndarray, "sectors"]) -> bytes:
    """Returns a ``std_msgs/UInt8MultiArray`` of one dimension: 1 for each sector that touches."""
    count = len(sectors)
    layout = _COUNT.pack(1) + text("sectors") + _LAYOUT.pack(count, count) + _NONE
    return layout + _COUNT.pack(count) + np.asarray(sectors, np.uint8).tobytes()
