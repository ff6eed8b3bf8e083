"""An episode as a log of ROS's messages, whether or not a ROS application drove it. Needs the extra ``ros``."""

import logging
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import UInt16

from specs.bundle_files import CameraDeclaration
from specs.data.world import World
from specs.ros_robot import RosRobot
from tasks.results.playback.playback import CameraFilm, Playback
from tasks.results.tables.recordings import COLOR_JPEG, DEPTH_PNG
from tasks.ros.bag.message_log import MessageLog
from tasks.ros.bag.track_log import Track, TrackCamera, TrackLidar, track_log
from tasks.ros.message.camera_messages import (
    Pinhole,
    depths_in_mm,
    depths_of_png,
    jpeg_bytes,
    jpegs_apart,
    optical_turn,
)

logger = logging.getLogger(__name__)
Twists = Callable[[np.ndarray, np.ndarray], np.ndarray]


class RosView(NamedTuple):
    """How ROS sees the robot of an episode, and its world.

    Attributes:
        robot: Names of its topics and frames.
        twists: Returns the Twists of controls, given the robot's headings; None where its drive is not known.
    """

    world: World
    robot: RosRobot = RosRobot()
    twists: Twists | None = None


def playback_log(view: RosView, playback: Playback) -> MessageLog:
    """Returns the messages that a ROS robot would have sent in an episode.

    Args:
        view: Of its robot and world.
        playback: What the robot did.
    """
    sight, goals_m = playback.sight, playback.goals_m
    angles = sight.angles_rad.astype(np.float64)
    first_rad = float(angles[0]) if len(angles) else 0.0
    step_rad = float(angles[-1] - angles[0]) / (len(angles) - 1) if len(angles) > 1 else 0.0
    track = Track(
        t_s=playback.t_s,
        pose=playback.pose,
        velocity=playback.velocity,
        goal_m=goals_m[np.minimum(playback.goal_index, len(goals_m) - 1)],
        acted=playback.acted,
        control=playback.control,
        ranges_m=playback.ranges_m,
        impulse_ns=playback.impulse_ns,
        lidar=TrackLidar(sight.mount, sight.height_m, sight.range_m, first_rad, step_rad),
    )
    return track_log(_seen(track, view)._replace(cameras=tuple(_filmed(view.robot, playback))))


def _filmed(robot: RosRobot, playback: Playback) -> Iterator[TrackCamera]:
    """Yields cameras with what a playback has of them."""
    for film in playback.depth.apart if playback.depth else ():
        depths_mm = (depths_in_mm(each, film.camera.range_m) for each in film.pictures)
        yield _depth_camera(robot, film.camera, dict(zip(_taken(playback, film), depths_mm, strict=True)))
    for film in playback.color.apart if playback.color else ():
        jpegs = map(jpeg_bytes, film.pictures)
        yield _color_camera(robot, film.camera, dict(zip(_taken(playback, film), jpegs, strict=True)))


def _taken(playback: Playback, film: CameraFilm) -> list[int]:
    """Returns the samples at which pictures were taken."""
    return np.searchsorted(playback.t_s, film.t_s - 1e-6).tolist()


def _depth_camera(
    robot: RosRobot, camera: CameraDeclaration, depths_mm: Mapping[int, UInt16[np.ndarray, "rows columns"]]
) -> TrackCamera:
    """Returns what a depth camera saw, as the robot's own pictures have it; in millimetres if it has none."""
    pictures: Mapping[int, np.ndarray] = depths_mm
    if robot.depth_camera and robot.depth_camera.encoding == "32FC1":
        pictures = {each: np.where(mm, mm / np.float32(1000.0), np.float32(np.inf)) for each, mm in depths_mm.items()}
    named = robot.topics.depth_image, robot.topics.depth_info
    image, info = (each and camera.own(each) for each in named)
    return TrackCamera(image, info, camera.own(robot.frames.depth_camera), *_optics(camera), pictures)


def _color_camera(robot: RosRobot, camera: CameraDeclaration, jpegs: Mapping[int, bytes]) -> TrackCamera:
    named = robot.topics.color_image and f"{robot.topics.color_image}/compressed", robot.topics.color_info
    image, info = (each and camera.own(each) for each in named)
    return TrackCamera(image, info, camera.own(robot.frames.color_camera), *_optics(camera), jpegs)


def _optics(camera: CameraDeclaration) -> tuple[Pinhole, tuple[float, ...]]:
    """Returns how a camera projects, and where its optical frame is on the base."""
    turn = optical_turn(camera.yaw_rad, camera.pitch_rad)
    return Pinhole(camera.columns, camera.rows, camera.fov_rad), (camera.x_m, camera.y_m, camera.z_m, *turn)


def sample_logs(views: Mapping[int, RosView], samples: Mapping[str, np.ndarray]) -> Iterator[tuple[int, MessageLog]]:
    """Yields each episode's index with its messages, from samples of recordings.

    Args:
        views: Of the episodes' robots and worlds, by index.
        samples: Of one or several episodes, as ``tasks.results.tables.recordings.write_recordings`` takes them, with
            ``goal_m``, where the goal is, and ``lidar``: its mount (x m, y m, yaw rad), height and range (m), first ray
            and the turn to the next (rad). With pictures, ``depth_camera`` and ``color_camera`` say what took them.
    """
    for index in dict.fromkeys(samples["index"].tolist()):
        rows = np.flatnonzero(samples["index"] == index)
        own = {name: values[rows[0] : rows[-1] + 1] for name, values in samples.items()}
        cameras = tuple(_recorded(views[index].robot, own))
        yield index, track_log(_seen(_sampled(own), views[index])._replace(cameras=cameras))


def _recorded(robot: RosRobot, own: Mapping[str, np.ndarray]) -> Iterator[TrackCamera]:
    """Yields cameras with what an episode's samples have of them, without what is no picture: the log names it."""
    camera, pngs = _camera_samples(own, "depth_camera", DEPTH_PNG)
    if camera:
        depths_mm: dict[int, UInt16[np.ndarray, "rows columns"]] = {}
        for at, png in pngs.items():
            try:
                depths_mm[at] = depths_of_png(png, camera.columns, len(camera.every) * camera.rows)
            except (OSError, ValueError) as exc:
                logger.warning("no picture of depths in a bag, at %.2f s: %s", own["t_s"][at], exc)
        for number, one in enumerate(camera.every):
            own_mm = {at: mm[number * one.rows : (number + 1) * one.rows] for at, mm in depths_mm.items()}
            yield _depth_camera(robot, one, own_mm)
    camera, jpegs = _camera_samples(own, "color_camera", COLOR_JPEG)
    if camera and not camera.others:
        yield _color_camera(robot, camera, jpegs)
    elif camera:
        parts: dict[int, list[bytes]] = {}
        for at, jpeg in jpegs.items():
            try:
                parts[at] = jpegs_apart(jpeg, camera.columns, camera.rows, len(camera.every))
            except (OSError, ValueError) as exc:
                logger.warning("no picture of colours in a bag, at %.2f s: %s", own["t_s"][at], exc)
        for number, one in enumerate(camera.every):
            yield _color_camera(robot, one, {at: each[number] for at, each in parts.items()})


def _camera_samples(
    own: Mapping[str, np.ndarray], name: str, column: str
) -> tuple[CameraDeclaration | None, dict[int, bytes]]:
    """Returns the declaration of an episode's camera, and its packed pictures by the sample."""
    camera = own[name][0] if name in own else None
    return camera, {at: each for at, each in enumerate(own[column]) if each is not None} if camera else {}


def _sampled(own: Mapping[str, np.ndarray]) -> Track:
    x_m, y_m, yaw_rad, height_m, range_m, first_rad, step_rad = own["lidar"][0].tolist()
    return Track(
        t_s=own["t_s"],
        pose=own["pose"],
        velocity=own["velocity"],
        goal_m=own["goal_m"],
        acted=np.asarray(own["acted"], bool),
        control=own["control"],
        ranges_m=own["ranges_m"],
        impulse_ns=own["impulse_ns"],
        lidar=TrackLidar((x_m, y_m, yaw_rad), height_m, range_m, first_rad, step_rad),
    )


def _seen(track: Track, view: RosView) -> Track:
    twist = view.twists(track.control, track.pose[:, 2]) if view.twists else None
    return track._replace(floor=view.world.map, topics=view.robot.topics, frames=view.robot.frames, twist=twist)
