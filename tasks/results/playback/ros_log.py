"""An episode as a log of ROS's messages, whether or not a ROS application drove it. Needs the extra ``ros``."""

from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from specs.data.world import World
from specs.ros_robot import RosRobot
from tasks.results.playback.playback import Playback
from tasks.ros.bag.message_log import MessageLog
from tasks.ros.bag.track_log import Track, TrackLidar, track_log

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
    return track_log(_seen(track, view))


def sample_logs(views: Mapping[int, RosView], samples: Mapping[str, np.ndarray]) -> Iterator[tuple[int, MessageLog]]:
    """Yields each episode's index with its messages, from samples of recordings.

    Args:
        views: Of the episodes' robots and worlds, by index.
        samples: Of one or several episodes, as ``tasks.results.tables.recordings.write_recordings`` takes them, with
            ``goal_m``, where the goal is, and ``lidar``: its mount (x m, y m, yaw rad), height and range (m), first ray
            and the turn to the next (rad).
    """
    for index in dict.fromkeys(samples["index"].tolist()):
        rows = np.flatnonzero(samples["index"] == index)
        own = {name: values[rows[0] : rows[-1] + 1] for name, values in samples.items()}
        yield index, track_log(_seen(_sampled(own), views[index]))


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
