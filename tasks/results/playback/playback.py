"""An episode to be played back: what the robot did in each step, and where it should go."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int


@dataclass(frozen=True)
class Sight:
    """A lidar.

    Attributes:
        mount: Where it is on the robot: (x m, y m, yaw rad).
        height_m: Of its plane above the floor.
        range_m: What it reports where nothing is nearer.
        angles_rad: The rays' directions in its own frame.
    """

    mount: tuple[float, float, float]
    height_m: float
    range_m: float
    angles_rad: Float[np.ndarray, "rays"]


@dataclass(frozen=True)
class Playback:
    """An episode, sampled at the beginning of each control step, and in the state in which it ended.

    Attributes:
        job: ``<batch>/<index>``.
        ending: How it ended, in a word or two.
        goals_m: Where the robot should go, in order.
        arrived_m: How near counts as reached; None where goals are no destinations.
        radius_m: Of the robot's hull.
        heights_m: Where its hull begins and ends above the floor.
        t_s: Simulated time since the episode began.
        pose: Of the robot's base: (x m, y m, yaw rad).
        velocity: The same a second.
        goal_index: How many goals were reached.
        acted: Whether a scan was seen and a control decided: not where the episode ended.
        impulse_ns: What contacts pushed the robot with until the next sample.
    """

    job: str
    ending: str
    goals_m: Float[np.ndarray, "goals 2"]
    arrived_m: float | None
    radius_m: float
    heights_m: tuple[float, float]
    sight: Sight
    t_s: Float[np.ndarray, "samples"]
    pose: Float[np.ndarray, "samples 3"]
    velocity: Float[np.ndarray, "samples 3"]
    goal_index: Int[np.ndarray, "samples"]
    acted: Bool[np.ndarray, "samples"]
    control: Float[np.ndarray, "samples actuators"]
    ranges_m: Float[np.ndarray, "samples rays"]
    impulse_ns: Float[np.ndarray, "samples"]

    @property
    def duration_s(self) -> float:
        """Returns how long it took."""
        return float(self.t_s[-1])

    def touches(self) -> Int[np.ndarray, "touches"]:
        """Returns the samples in which a contact began."""
        pushed = self.impulse_ns > 0.0
        return np.flatnonzero(pushed & ~np.concatenate([[False], pushed[:-1]]))

    def every(self, stride: int) -> Int[np.ndarray, "shown"]:
        """Returns every so many samples, and the last."""
        last = len(self.t_s) - 1
        return np.unique(np.append(np.arange(0, last, stride), last))

    def seen_m(self, sample: int) -> Float[np.ndarray, "rays 2"]:
        """Returns where the rays of a sample ended, in the world."""
        x, y, yaw = (float(each) for each in self.pose[sample])
        along, across, turn = self.sight.mount
        cos, sin = np.cos(yaw), np.sin(yaw)
        at = np.array([x + cos * along - sin * across, y + sin * along + cos * across])
        angles = self.sight.angles_rad + yaw + turn
        return at + self.ranges_m[sample][:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
