"""What a robot did in an episode, sample by sample, and the messages that its node would have sent.

Poses are the true ones, so the frame of odometry is the map's. Headers and clock say simulated time.
"""

import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Shaped

from specs.data.world import OccupancyMap
from specs.ros_robot import RosFrames, RosTopics
from tasks.ros.bag.message_log import FIRST_NS, Channel, LogEntry, MessageLog
from tasks.ros.message.camera_messages import Pinhole, camera_info, image, packed_image
from tasks.ros.message.ros_messages import (
    PlanarTwist,
    clock,
    laser_scan,
    occupancy_grid,
    odometry,
    pose_stamped,
    stamp,
    transforms,
    twist,
)


class TrackLidar(NamedTuple):
    """A lidar.

    Attributes:
        mount: Where it is on the robot: (x m, y m, yaw rad).
        height_m: Of its plane above the floor.
        range_m: What it reports where nothing is nearer.
        first_rad: Direction of its first ray in its own frame.
        step_rad: From a ray to the next, counter-clockwise.
    """

    mount: tuple[float, float, float]
    height_m: float
    range_m: float
    first_rad: float
    step_rad: float


class TrackCamera(NamedTuple):
    """A camera, and what it saw.

    Attributes:
        image, info: Names of its topics; None for one that the robot does not have.
        frame: Its optical one.
        pinhole: How it projects.
        mount: Where its optical frame is on the robot, as ``FrameTransform`` has it.
        pictures: By the number of the sample at which they were taken: depths or colours, or a JPEG of those.
    """

    image: str | None
    info: str | None
    frame: str
    pinhole: Pinhole
    mount: Sequence[float]
    pictures: Mapping[int, Shaped[np.ndarray, "rows columns *channels"] | bytes]


class Track(NamedTuple):
    """An episode, sampled at the beginning of control steps, and in the state in which it ended.

    Attributes:
        t_s: Simulated time since the episode began.
        pose: Of the robot's base in the world: (x m, y m, yaw rad).
        velocity: The same a second, along the world's axes.
        goal_m: The goal to go to, (x m, y m).
        acted: Whether a scan was seen and a control decided.
        control: A number an actuator.
        ranges_m: What the lidar saw.
        impulse_ns: What contacts pushed the robot with until the next sample.
        twist: The controls as a Twist, (m/s ahead, m/s to the left, rad/s); None where it does not follow from them.
        floor: The map of the world; None for none.
        topics, frames: Their names.
        cameras: What the robot's cameras saw.
    """

    t_s: Float[np.ndarray, "samples"]
    pose: Float[np.ndarray, "samples 3"]
    velocity: Float[np.ndarray, "samples 3"]
    goal_m: Float[np.ndarray, "samples 2"]
    acted: Bool[np.ndarray, "samples"]
    control: Float[np.ndarray, "samples actuators"]
    ranges_m: Float[np.ndarray, "samples rays"]
    impulse_ns: Float[np.ndarray, "samples"]
    lidar: TrackLidar
    twist: Float[np.ndarray, "samples 3"] | None = None
    floor: OccupancyMap | None = None
    topics: RosTopics = RosTopics()
    frames: RosFrames = RosFrames()
    cameras: tuple[TrackCamera, ...] = ()


CLOCK, FRAMES, FIXED_FRAMES, TRUE_POSE, FLOOR = "/clock", "/tf", "/tf_static", "/ground_truth/odom", "/map"
CONTROL, IMPULSE = "/simyard/control", "/simyard/contact_impulse"
_FREE, _OCCUPIED = 0, 100
_NUMBER, _NUMBERS = struct.Struct("<f"), struct.Struct("<III")


def track_log(track: Track) -> MessageLog:
    """Returns the log of an episode, with the topics of ``track_channels``."""
    return MessageLog(track_channels(track), _entries(track))


def track_channels(track: Track) -> tuple[Channel, ...]:
    """Returns the topics of an episode's log.

    A topic that the robot's declaration leaves out is none; nor are scans of a blind robot, commands of a drive that is
    not known, the map of a world that has none, and pictures that were not kept.
    """
    topics = track.topics
    found = (
        (CLOCK, "rosgraph_msgs/Clock", False),
        (FIXED_FRAMES, "tf2_msgs/TFMessage", True),
        (FRAMES, "tf2_msgs/TFMessage", False),
        (track.floor and (topics.floor_map or FLOOR), "nav_msgs/OccupancyGrid", True),
        (topics.goal, "geometry_msgs/PoseStamped", True),
        (topics.odometry, "nav_msgs/Odometry", False),
        (TRUE_POSE, "nav_msgs/Odometry", False),
        (topics.scan if _sees(track) else None, "sensor_msgs/LaserScan", False),
        (topics.command if track.twist is not None else None, "geometry_msgs/Twist", False),
        (CONTROL, "std_msgs/Float32MultiArray", False),
        (IMPULSE, "std_msgs/Float32", False),
        *(told for each in track.cameras for told in _camera_channels(each)),
    )
    return tuple(Channel(topic, kind, latched=latched) for topic, kind, latched in found if topic)


def time_ns(t_s: float) -> int:
    """Returns when something happens in a log, by the simulated time since the episode began."""
    return FIRST_NS + round(t_s * 1e6) * 1000


def _camera_channels(camera: TrackCamera) -> tuple[tuple[str | None, str, bool], ...]:
    packed = any(isinstance(picture, bytes) for picture in camera.pictures.values())
    picture = "sensor_msgs/CompressedImage" if packed else "sensor_msgs/Image"
    return (camera.info, "sensor_msgs/CameraInfo", False), (camera.image, picture, False)


def _sees(track: Track) -> bool:
    return track.ranges_m.shape[1] > 0


def _entries(track: Track) -> Iterator[LogEntry]:
    yield LogEntry(FIRST_NS, CLOCK, clock(stamp(FIRST_NS)))
    yield LogEntry(FIRST_NS, FIXED_FRAMES, _fixed_frames(track))
    if track.floor is not None:
        yield LogEntry(FIRST_NS, track.topics.floor_map or FLOOR, _floor(track.floor, track.frames.floor_map))
    goals = _goal_numbers(track)
    cameras = [(each, {at: number for number, at in enumerate(sorted(each.pictures))}) for each in track.cameras]
    times = [time_ns(t_s) for t_s in track.t_s.tolist()]
    for sample, at_ns in enumerate(times):
        if sample:
            yield LogEntry(at_ns, CLOCK, clock(stamp(at_ns)))
        yield from _moved(track, sample, at_ns)
        if track.topics.goal and sample in goals:
            goal = (*track.goal_m[sample].tolist(), 0.0)
            body = pose_stamped(goals[sample], stamp(at_ns), track.frames.odometry, goal)
            yield LogEntry(at_ns, track.topics.goal, body)
        if track.acted[sample]:
            yield from _acted(track, sample, at_ns)
        for camera, numbers in cameras:
            if sample in numbers:
                yield from _pictured(camera, sample, numbers[sample], at_ns)
        yield LogEntry(at_ns, IMPULSE, _NUMBER.pack(track.impulse_ns[sample]))


def _fixed_frames(track: Track) -> bytes:
    """Returns the frames that never move: odometry's on the map, and those of lidar and cameras on the base."""
    frames, (x_m, y_m, yaw_rad) = track.frames, track.lidar.mount
    fixed: list[tuple[str, str, Sequence[float]]] = [(frames.floor_map, frames.odometry, (0.0, 0.0, 0.0))]
    if _sees(track):
        fixed.append((frames.base, frames.laser, (x_m, y_m, yaw_rad, track.lidar.height_m)))
    fixed += [(frames.base, each.frame, each.mount) for each in track.cameras]
    return transforms(0, stamp(FIRST_NS), fixed)


def _floor(floor: OccupancyMap, frame: str) -> bytes:
    """Returns the map of the world, row by row from its lowest y."""
    runs = np.where(np.arange(len(floor.runs)) % 2 == 1, _OCCUPIED, _FREE)
    cells = np.repeat(runs, floor.runs).reshape(floor.rows, floor.columns)
    return occupancy_grid(0, stamp(FIRST_NS), frame, cells, origin_m=floor.origin_m, cell_m=floor.resolution_m)


def _goal_numbers(track: Track) -> dict[int, int]:
    """Returns the samples at which there is another goal than before, and which goal it is."""
    changes = [0, *(after for before, after in pairwise(range(len(track.t_s))) if _changes(track, before, after))]
    return {sample: number for number, sample in enumerate(changes)}


def _changes(track: Track, before: int, after: int) -> bool:
    return bool(np.any(track.goal_m[before] != track.goal_m[after]))


def _moved(track: Track, sample: int, at_ns: int) -> Iterator[LogEntry]:
    """Yields where the robot is, and how it moves: along its own axes, as odometry has it."""
    frames, time = track.frames, stamp(at_ns)
    pose = track.pose[sample].astype(np.float64)
    vx, vy, turn_rad_s = track.velocity[sample].tolist()
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    velocity = np.array([cos * vx + sin * vy, cos * vy - sin * vx, turn_rad_s])
    yield LogEntry(at_ns, FRAMES, transforms(sample, time, [(frames.odometry, frames.base, pose.tolist())]))
    for topic, frame in ((track.topics.odometry, frames.odometry), (TRUE_POSE, frames.floor_map)):
        if topic:
            body = odometry(sample, time, pose, velocity, frame=frame, child=frames.base)
            yield LogEntry(at_ns, topic, body)


def _acted(track: Track, sample: int, at_ns: int) -> Iterator[LogEntry]:
    """Yields what the robot saw, and what was decided on it."""
    if track.topics.scan and _sees(track):
        yield LogEntry(at_ns, track.topics.scan, _scan(track, sample, at_ns))
    if track.twist is not None:
        yield LogEntry(at_ns, track.topics.command, twist(PlanarTwist(*track.twist[sample].tolist())))
    control = np.asarray(track.control[sample], "<f4")
    yield LogEntry(at_ns, CONTROL, _NUMBERS.pack(0, 0, len(control)) + control.tobytes())


def _pictured(camera: TrackCamera, sample: int, number: int, at_ns: int) -> Iterator[LogEntry]:
    """Yields what a camera saw at a sample, and how it projects."""
    head, picture = (number, stamp(at_ns), camera.frame), camera.pictures[sample]
    if camera.info:
        yield LogEntry(at_ns, camera.info, camera_info(*head, camera.pinhole))
    if camera.image:
        body = packed_image(*head, picture) if isinstance(picture, bytes) else image(*head, picture)
        yield LogEntry(at_ns, camera.image, body)


def _scan(track: Track, sample: int, at_ns: int) -> bytes:
    return laser_scan(
        sample,
        stamp(at_ns),
        track.frames.laser,
        track.ranges_m[sample],
        angle_min=track.lidar.first_rad,
        angle_increment=track.lidar.step_rad,
        range_max=track.lidar.range_m,
        scan_s=float(track.t_s[1] - track.t_s[0]) if len(track.t_s) > 1 else 0.0,
    )
