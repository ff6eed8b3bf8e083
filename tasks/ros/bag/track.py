"""What a robot did in an episode, sample by sample: what a log of messages is made of where no node ran."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from specs.bundle.ros_robot import RosFrames, RosTopics
from specs.data.world import OccupancyMap


class Lidar(NamedTuple):
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
    """

    t_s: Float[np.ndarray, "samples"]
    pose: Float[np.ndarray, "samples 3"]
    velocity: Float[np.ndarray, "samples 3"]
    goal_m: Float[np.ndarray, "samples 2"]
    acted: Bool[np.ndarray, "samples"]
    control: Float[np.ndarray, "samples actuators"]
    ranges_m: Float[np.ndarray, "samples rays"]
    impulse_ns: Float[np.ndarray, "samples"]
    lidar: Lidar
    twist: Float[np.ndarray, "samples 3"] | None = None
    floor: OccupancyMap | None = None
    topics: RosTopics = RosTopics()
    frames: RosFrames = RosFrames()
