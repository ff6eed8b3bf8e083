"""What is kept of an episode that is driven again, for pictures of it."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Float64

from specs.data.episode import EpisodeResult
from tasks.ros.bag.message_log import MessageLog
from tasks.simulate.lane.recording import Columns


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
    """

    goals_m: Float64[np.ndarray, "goals 2"]
    arrived_m: float | None
    radius_m: float
    heights_m: tuple[float, float]
    mount: tuple[float, float, float]
    lidar_height_m: float
    range_m: float
    angles_rad: Float32[np.ndarray, "rays"]


class DrivenAgain(NamedTuple):
    """An episode driven again.

    Attributes:
        row: What came of it.
        setting: None for an episode that could not start.
        steps: A sample for each control step, as ``tasks.simulate.lane.recording`` has them; none without a setting.
        samples: The same at the rate of its batch's recordings.
        traffic: What its robot and its ROS nodes said to each other; None where there were none.
    """

    row: EpisodeResult
    setting: Setting | None = None
    steps: Columns | None = None
    samples: Columns | None = None
    traffic: MessageLog | None = None
