"""A track made by hand: two seconds in a curve, a goal that changes, a touch, a map of six cells."""

import numpy as np

from specs.data.world import OccupancyMap
from specs.ros_robot import RosFrames, RosTopics
from tasks.ros.bag.message_log import LogEntry, MessageLog
from tasks.ros.bag.track_log import Track, TrackCamera, TrackLidar, track_log
from tasks.ros.message.camera_messages import Pinhole, optical_turn

SAMPLES, RAYS = 41, 5
FLOOR = OccupancyMap(resolution_m=0.5, origin_m=(-1.0, -2.0), columns=3, rows=2, runs=(1, 2, 3))


def track(rays: int = RAYS, samples: int = SAMPLES) -> Track:
    """Returns an episode at 20 Hz that reaches its first goal in the middle."""
    number = np.arange(samples)
    rng = np.random.default_rng(3)
    return Track(
        t_s=np.round(number / 20, 6),
        pose=np.stack([number / 30, np.sin(number / 9), number / 11], 1).astype(np.float32),
        velocity=rng.normal(size=(samples, 3)).astype(np.float32),
        goal_m=np.where((number > samples // 2)[:, None], [[3.0, 1.0]], [[0.5, 0.25]]),
        acted=number < samples - 1,
        control=rng.normal(size=(samples, 2)).astype(np.float32),
        ranges_m=rng.uniform(0.1, 5.9, (samples, rays)).astype(np.float32),
        impulse_ns=np.where(number == 7, 0.25, 0.0).astype(np.float32),
        lidar=TrackLidar((0.1, 0.0, 0.5), 0.2, 6.0, -0.5, 0.25),
        floor=FLOOR,
    )


def with_twist() -> Track:
    """Returns the same of a robot whose controls are Twists."""
    return track()._replace(twist=np.tile([[0.5, 0.25, -1.0]], (SAMPLES, 1)))


def cameras() -> tuple[TrackCamera, ...]:
    """Returns a depth camera and a colour camera that took a picture each."""
    named, frames, lens = RosTopics(), RosFrames(), Pinhole(4, 2, 1.2)
    mount, colors = (0.1, 0.0, 0.3, *optical_turn(0.0, 0.0)), f"{named.color_image}/compressed"
    depth = TrackCamera(
        named.depth_image, named.depth_info, frames.depth_camera, lens, mount, {3: np.ones((2, 4), np.uint16)}
    )
    return depth, TrackCamera(colors, named.color_info, frames.color_camera, lens, mount, {3: b"\xff\xd8\xff"})


def log(made: Track | None = None) -> MessageLog:
    """Returns the log of a track, which can be read several times."""
    found = track_log(made or track())
    return found._replace(entries=tuple(found.entries))


def of_topic(logged: MessageLog, topic: str) -> list[LogEntry]:
    """Returns the messages of a topic."""
    return [entry for entry in logged.entries if entry.topic == topic]
