"""An episode that was driven again: what a picture of it needs besides its row, and how that is sent.

Row and setting are sent from the process that simulates as data, steps as arrays.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Float64, UInt8

from specs.bundle_files import ColorCameraDeclaration, DepthCameraDeclaration
from specs.data.episode import EpisodeResult
from tasks.ros.bag.message_log import MessageLog
from tasks.simulate.lane.recording import Columns
from tasks.simulate.sandbox.protocol import LOG_ARRAYS, Replayed, log_of, log_parts


class Setting(NamedTuple):
    """What does not change while an episode runs.

    Attributes:
        goals_m: Where the robot should go, in order.
        arrived_m: How near counts as reached; None where goals are no destinations.
        radius_m: Of the robot's hull about its yaw axis.
        heights_m: Where the hull begins and ends above the floor.
        mount: Of the lidar on the robot: (x m, y m, yaw rad).
        lidar_height_m: Of the lidar's plane.
        range_m: What the lidar reports where nothing is nearer.
        angles_rad: The rays' directions in the lidar's frame.
        camera: The depth camera; None for a robot without.
        pictured_s, pictures_m: When it took pictures, some of all, and what it saw.
        color_camera, colored_s, colors: The same of the colour camera.
    """

    goals_m: Float64[np.ndarray, "goals 2"]
    arrived_m: float | None
    radius_m: float
    heights_m: tuple[float, float]
    mount: tuple[float, float, float]
    lidar_height_m: float
    range_m: float
    angles_rad: Float32[np.ndarray, "rays"]
    camera: DepthCameraDeclaration | None
    pictured_s: Float64[np.ndarray, "pictures"]
    pictures_m: Float32[np.ndarray, "pictures rows columns"]
    color_camera: ColorCameraDeclaration | None
    colored_s: Float64[np.ndarray, "colors"]
    colors: UInt8[np.ndarray, "colors rows columns 3"]


class ReplayResult(NamedTuple):
    """An episode driven again.

    Attributes:
        row: What came of it.
        setting: None for an episode that could not start.
        steps: A sample for each control step, as ``tasks.simulate.lane.recording`` has them; none without a setting.
        samples: The same at the rate of its batch's recordings.
        traffic: What its robot and its ROS nodes said to each other; None where there were none.
        gl: Which GL drew what its colour camera saw; empty if none did.
    """

    row: EpisodeResult
    setting: Setting | None = None
    steps: Columns | None = None
    samples: Columns | None = None
    traffic: MessageLog | None = None
    gl: str = ""


def replay_message(again: ReplayResult) -> tuple[Replayed, list[np.ndarray]]:
    """Returns what is said of an episode that was driven again, and the arrays that go with it."""
    setting, steps, samples = again.setting, again.steps, again.samples
    if setting is None or steps is None or samples is None:
        return Replayed(row=again.row, started=False), []
    names = tuple(steps)
    topics, log = (None, []) if again.traffic is None else log_parts(again.traffic)
    said = Replayed(
        row=again.row,
        started=True,
        arrived_m=setting.arrived_m,
        radius_m=setting.radius_m,
        heights_m=setting.heights_m,
        mount=setting.mount,
        lidar_height_m=setting.lidar_height_m,
        range_m=setting.range_m,
        camera=setting.camera,
        color_camera=setting.color_camera,
        columns=names,
        topics=topics,
        gl=again.gl,
    )
    columns = [np.asarray(each[name]) for each in (steps, samples) for name in names]
    pictures = [setting.pictured_s, setting.pictures_m, setting.colored_s, setting.colors]
    return said, [setting.goals_m, setting.angles_rad, *pictures, *columns, *log]


def received_replay(again: Replayed, arrays: tuple[np.ndarray, ...], steps: int) -> ReplayResult:
    """Returns the episode whose parts came, of so many control steps at most: the inverse of ``replay_message``."""
    if not again.started:
        return ReplayResult(again.row)
    traffic = None
    if again.topics is not None:
        arrays, log = arrays[:-LOG_ARRAYS], arrays[-LOG_ARRAYS:]
        traffic = log_of(again.topics, log, steps)
    goals_m, angles_rad, pictured_s, pictures_m, colored_s, colors, *columns = arrays
    count = len(again.columns)
    setting = Setting(
        goals_m=goals_m,
        arrived_m=again.arrived_m,
        radius_m=again.radius_m,
        heights_m=again.heights_m,
        mount=again.mount,
        lidar_height_m=again.lidar_height_m,
        range_m=again.range_m,
        angles_rad=angles_rad,
        camera=again.camera,
        pictured_s=pictured_s,
        pictures_m=pictures_m,
        color_camera=again.color_camera,
        colored_s=colored_s,
        colors=colors,
    )
    each_step, samples = (dict(zip(again.columns, each, strict=True)) for each in (columns[:count], columns[count:]))
    return ReplayResult(again.row, setting, each_step, samples, traffic, again.gl)
