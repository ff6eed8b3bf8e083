"""Messages that the robot sends and reads, as bytes, in ROS 1's form or in CDR (wiki.ros.org/msg).

They tell where the robot is and what it shall do (clock, odometry, transforms, goal, map, command), what it senses
(laser scan, ranges, inertia, joints, bumper), and what RoboMaker's services ask and answer (tags of a job, and its
end). Pictures are in ``camera_messages``.

ROS 1 writes numbers little endian without padding, and the length of a text or list before it as an unsigned 32 bit
number (wiki.ros.org/ROS/Technical%20Overview).
"""

import math
import struct
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from pydantic import TypeAdapter, ValidationError

from specs.field_types import TagMap

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
def text_bytes(value: str) -> bytes:
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
    return _TIMES.pack(sequence & 0xFFFFFFFF, time.seconds, time.nanoseconds) + text_bytes(frame)


def frame_message(data: bytes) -> bytes:
    """Returns a message as TCPROS sends it: its length, and its bytes."""
    return _LENGTH.pack(len(data)) + data


def yaw_quaternion(yaw_rad: float) -> tuple[float, float, float, float]:
    """Returns (x, y, z, w) of a turn about the vertical axis."""
    return 0.0, 0.0, math.sin(yaw_rad / 2.0), math.cos(yaw_rad / 2.0)


TWIST_BYTES = 48
_CLOCK = struct.Struct("<II")
_POSE, _PLACE_NUMBERS = struct.Struct("<7d"), 7
_TWIST = struct.Struct("<6d")
_COUNT = struct.Struct("<I")
_GRID = struct.Struct("<IIfII7dI")
_NO_POSE_COVARIANCE = bytes(36 * 8)


class FrameTransform(NamedTuple):
    """Where a frame is in another.

    Attributes:
        parent, child: Names of the frames.
        pose: Of the child in the parent: (x m, y m, yaw rad), and its height (m) if that is not 0; or place and
            quaternion: (x m, y m, z m, x, y, z, w).
    """

    parent: str
    child: str
    pose: Sequence[float]


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
            text_bytes(child),
            _POSE.pack(x, y, 0.0, *yaw_quaternion(yaw)),
            _NO_POSE_COVARIANCE,
            _TWIST.pack(ahead, left, 0.0, 0.0, 0.0, turn),
            _NO_POSE_COVARIANCE,
        )
    )


def transforms(sequence: int, time: Stamp, each: Sequence[FrameTransform | tuple[str, str, Sequence[float]]]) -> bytes:
    """Returns a ``tf2_msgs/TFMessage``.

    Args:
        sequence: Of the message among those of its topic.
        time: When the transforms were true.
        each: Where the frames are, as ``FrameTransform`` has it.
    """
    parts = [_COUNT.pack(len(each))]
    for parent, child, pose in each:
        parts += [header(sequence, time, parent), text_bytes(child), _POSE.pack(*_place(pose))]
    return b"".join(parts)


def _place(pose: Sequence[float]) -> tuple[float, ...]:
    """Returns the seven numbers of a pose as ``FrameTransform`` has it."""
    numbers = tuple(map(float, pose))
    if len(numbers) == _PLACE_NUMBERS:
        return numbers
    x, y, yaw, *height = numbers
    return x, y, sum(height, 0.0), *yaw_quaternion(yaw)


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


def pose_with_covariance(sequence: int, time: Stamp, frame: str, pose: Float[np.ndarray, "3"]) -> bytes:
    """Returns a ``geometry_msgs/PoseWithCovarianceStamped`` without covariances; arguments as of ``pose_stamped``."""
    return pose_stamped(sequence, time, frame, pose) + _NO_POSE_COVARIANCE


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


_SCAN = struct.Struct("<7fI")
_IMU = struct.Struct("<37d")
_LAYOUT = struct.Struct("<II")
_NONE = _COUNT.pack(0)
_NO_IMU_COVARIANCE = (0.0,) * 9


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


class Inertia(NamedTuple):
    """What an inertial measurement unit tells, in its own frame.

    Attributes:
        turn_rad_s: How fast it turns about each axis.
        force_m_s2: Acceleration minus gravity: at rest 9.81 upward.
        yaw_rad: Where it faces; None if it does not know.
        turn_sigma_rad_s, force_sigma_m_s2: Standard deviations; 0 for unknown.
    """

    turn_rad_s: Sequence[float] | Float[np.ndarray, "3"]
    force_m_s2: Sequence[float] | Float[np.ndarray, "3"]
    yaw_rad: float | None = None
    turn_sigma_rad_s: float = 0.0
    force_sigma_m_s2: float = 0.0


def imu(sequence: int, time: Stamp, frame: str, felt: Inertia) -> bytes:
    """Returns a ``sensor_msgs/Imu``; one that knows no orientation says so by its first covariance, -1.

    Args:
        sequence: Of the message among those of its topic.
        time: When the data were true.
        frame: The sensor's.
        felt: What it tells.
    """
    unknown = felt.yaw_rad is None
    facing = (*yaw_quaternion(felt.yaw_rad or 0.0), -1.0 if unknown else 0.0, *_NO_IMU_COVARIANCE[1:])
    turning = (*map(float, felt.turn_rad_s), *_alike(felt.turn_sigma_rad_s))
    pushed = (*map(float, felt.force_m_s2), *_alike(felt.force_sigma_m_s2))
    return header(sequence, time, frame) + _IMU.pack(*facing, *turning, *pushed)


def _alike(sigma: float) -> tuple[float, ...]:
    """Returns the covariance of three numbers that err alike and apart."""
    each = sigma**2
    return each, 0.0, 0.0, 0.0, each, 0.0, 0.0, 0.0, each


_RANGE = struct.Struct("<B4f")
ULTRASOUND, INFRARED = 0, 1


def range_reading(
    sequence: int, time: Stamp, frame: str, range_m: float, *, radiation: int, cone_rad: float, range_max: float
) -> bytes:
    """Returns a ``sensor_msgs/Range``; one that hears nothing reads +inf, as REP 117 has it.

    Args:
        sequence: Of the message among those of its topic.
        time: When the data were true.
        frame: The sensor's: it looks along x.
        range_m: How near the nearest thing is; ``range_max`` or more for nothing.
        radiation: ``ULTRASOUND`` or ``INFRARED``.
        cone_rad: From one edge of what it sees to the other.
        range_max: How far it reaches (m).
    """
    told = math.inf if np.float32(range_m) >= np.float32(range_max) else range_m
    return header(sequence, time, frame) + _RANGE.pack(radiation, cone_rad, 0.0, range_max, told)


_VECTOR_ERRS, _FIX = struct.Struct("<12d"), struct.Struct("<bH12dB")
_UT_A_TESLA = 1e6


def magnetic_field(
    sequence: int, time: Stamp, frame: str, field_ut: Sequence[float] | Float[np.ndarray, "3"], sigma_ut: float
) -> bytes:
    """Returns a ``sensor_msgs/MagneticField``, in tesla.

    Args:
        sequence: Of the message among those of its topic.
        time: When the data were true.
        frame: The frame that the field is in.
        field_ut: Along its axes, microtesla.
        sigma_ut: Standard deviation of each; 0 for unknown.
    """
    field = (float(each) / _UT_A_TESLA for each in field_ut)
    return header(sequence, time, frame) + _VECTOR_ERRS.pack(*field, *_alike(sigma_ut / _UT_A_TESLA))


class EarthPlace(NamedTuple):
    """A place on the earth, of WGS 84."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float


_RADIUS_M, _FLATNESS = 6_378_137.0, 1 / 298.257223563
_SQUARED = _FLATNESS * (2 - _FLATNESS)


def place_beside(origin: EarthPlace, way_m: Sequence[float] | Float[np.ndarray, "3"]) -> EarthPlace:
    """Returns where one is that is some metres east, north and up of a place.

    B. Bowring, "Transformation from spatial to geographical coordinates", 1976: exact to less than a micrometre.
    """
    east, north, up = map(float, way_m)
    latitude, longitude = math.radians(origin.latitude_deg), math.radians(origin.longitude_deg)
    sin, cos = math.sin(latitude), math.cos(latitude)
    across_m = _RADIUS_M / math.sqrt(1 - _SQUARED * sin**2)
    # Along the meridian's plane, to the east of it, and along the earth's axis.
    out_m = (across_m + origin.altitude_m + up) * cos - north * sin
    axis_m = ((1 - _SQUARED) * across_m + origin.altitude_m + up) * sin + north * cos
    far_m = math.hypot(out_m, east)
    turned = math.atan2(axis_m, (1 - _FLATNESS) * far_m)
    bent = _SQUARED / (1 - _FLATNESS) * _RADIUS_M * math.sin(turned) ** 3
    found = math.atan2(axis_m + bent, far_m - _SQUARED * _RADIUS_M * math.cos(turned) ** 3)
    level_m = _RADIUS_M * math.sqrt(1 - _SQUARED * math.sin(found) ** 2)
    altitude_m = far_m * math.cos(found) + axis_m * math.sin(found) - level_m
    turn_deg = math.degrees(longitude + math.atan2(east, out_m))
    return EarthPlace(math.degrees(found), (turn_deg + 180) % 360 - 180, altitude_m)


def satellite_fix(sequence: int, time: Stamp, frame: str, place: EarthPlace, sigma_m: float) -> bytes:
    """Returns a ``sensor_msgs/NavSatFix``, by GPS.

    Args:
        sequence: Of the message among those of its topic.
        time: When the data were true.
        frame: The antenna's.
        place: Where it is.
        sigma_m: Standard deviation to the east and to the north, of which upwards it is twice; 0 for unknown.
    """
    level, up = sigma_m**2, (2 * sigma_m) ** 2
    errs = (level, 0.0, 0.0, 0.0, level, 0.0, 0.0, 0.0, up)
    return header(sequence, time, frame) + _FIX.pack(0, 1, *place, *errs, 2 if sigma_m else 0)


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
    parts = [header(sequence, time, frame), _COUNT.pack(len(names)), *map(text_bytes, names)]
    for values in (position, speed):
        parts += [_COUNT.pack(len(values)), np.asarray(values, "<f8").tobytes()]
    return b"".join((*parts, _NONE))


def bumper(sectors: Bool[np.ndarray, "sectors"]) -> bytes:
    """Returns a ``std_msgs/UInt8MultiArray`` of one dimension: 1 for each sector that touches."""
    count = len(sectors)
    layout = _COUNT.pack(1) + text_bytes("sectors") + _LAYOUT.pack(count, count) + _NONE
    return layout + _COUNT.pack(count) + np.asarray(sectors, np.uint8).tobytes()


REQUEST_BYTES = 64 * 1024
"""A request to one of the robot's services."""
_TAGS: TypeAdapter[dict[str, str]] = TypeAdapter(TagMap)


def read_tags(data: bytes) -> dict[str, str]:
    """Returns the tags of an ``AddTags`` request; of two with one key, the last.

    Raises:
        ValueError: If the bytes are not such a request.
    """
    texts = _read_texts(data, 2)
    return dict(zip(texts[::2], texts[1::2], strict=True))


def read_tag_keys(data: bytes) -> list[str]:
    """Returns the keys of a ``RemoveTags`` request.

    Raises:
        ValueError: If the bytes are not such a request.
    """
    return _read_texts(data, 1)


def write_tags(tags: Mapping[str, str]) -> bytes:
    """Returns a list of tags."""
    parts = [text_bytes(key) + text_bytes(value) for key, value in tags.items()]
    return b"".join((_LENGTH.pack(len(tags)), *parts))


def joined_tags(tags: Mapping[str, str], more: Mapping[str, str]) -> dict[str, str]:
    """Returns the tags of a job after an application gave it more.

    Raises:
        ValueError: RoboMaker takes no such tags, or not so many; says why.
    """
    try:
        return _TAGS.validate_python({**tags, **more})
    except ValidationError as exc:
        faults = (f"{'.'.join(map(str, each['loc']))}: {each['msg']}" for each in exc.errors()[:5])
        raise ValueError("; ".join(faults)) from exc


def write_outcome(*, success: bool, message: str) -> bytes:
    """Returns what the response of each service begins with, and all of that of ``AddTags`` and ``Cancel``."""
    return struct.pack("<?", success) + text_bytes(message)


def read_text(data: bytes) -> tuple[str, bytes]:
    """Returns the text that some bytes begin with, and those after it.

    Raises:
        ValueError: They do not begin with a whole text.
    """
    if len(data) < 4:
        raise ValueError(f"a text within {len(data)} bytes")
    (length,) = _LENGTH.unpack_from(data)
    part = data[4 : 4 + length]
    if len(part) != length:
        raise ValueError(f"a text of {length} bytes where {len(part)} are left")
    return part.decode(), data[4 + length :]


def _read_texts(data: bytes, each: int) -> list[str]:
    """Returns the texts of a list whose items have so many texts each."""
    if len(data) < 4:
        raise ValueError(f"a list within {len(data)} bytes")
    (count,) = _LENGTH.unpack_from(data)
    texts: list[str] = []
    at = 4
    for _ in range(each * count):
        if at + 4 > len(data):
            raise ValueError(f"a list of {count} that ends after {len(texts) // each}")
        (length,) = _LENGTH.unpack_from(data, at)
        part = data[at + 4 : at + 4 + length]
        if len(part) != length:
            raise ValueError(f"a text of {length} bytes where {len(part)} are left")
        texts.append(part.decode())
        at += 4 + length
    if at != len(data):
        raise ValueError(f"{len(data) - at} bytes after a list of {count}")
    return texts
