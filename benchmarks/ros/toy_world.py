"""A world that costs nothing: a disc in a room with pillars, so that the exchange alone is timed."""

import math

import numpy as np

from specs.bundle_files import RosRobot
from tasks.ros.lockstep.exchange import RobotBase, Sensed, TwistCommand

CONTROL_S = 0.05
RAYS = 180
RANGE_M = 8.0
BASE = RobotBase(RosRobot(), RAYS, -math.pi, 2 * math.pi / RAYS, RANGE_M)
_PILLARS = np.array([[1.5, 0.8], [-1.0, 1.2], [0.5, -1.6], [-1.8, -1.0]])
_HALF_M, _PILLAR_M, _WALL_M = 3.0, 0.25, 2.7
_ANGLES = -math.pi + 2 * math.pi / RAYS * np.arange(RAYS)


class ToyWorld:
    """One robot in its room.

    Args:
        seed: Where the robot faces at first.
    """

    def __init__(self, seed: int) -> None:
        facing = np.random.default_rng(seed).uniform(-3.0, 3.0)
        self.pose = np.array([0.0, 0.0, facing])
        self._velocity = np.zeros(3)

    def sense(self) -> Sensed:
        """Returns what the robot senses now."""
        angles = _ANGLES + self.pose[2]
        cos, sin = np.cos(angles), np.sin(angles)
        with np.errstate(divide="ignore"):
            across = (_HALF_M * np.sign(cos) - self.pose[0]) / cos
            along_m = (_HALF_M * np.sign(sin) - self.pose[1]) / sin
        ranges = np.minimum(np.minimum(across, along_m), self._pillars(cos, sin))
        return Sensed(
            pose=self.pose.copy(),
            velocity=self._velocity.copy(),
            acceleration=np.zeros(2),
            ranges_m=np.minimum(ranges, RANGE_M).astype(np.float32),
            bumper=np.zeros(3, np.bool_),
            goal=np.array([2.0, 1.0]),
        )

    def drive(self, command: TwistCommand) -> None:
        """Moves the robot for a control step."""
        self._velocity = np.array(command)
        x, y, yaw = self.pose
        x += CONTROL_S * (command.ahead_m_s * np.cos(yaw) - command.left_m_s * np.sin(yaw))
        y += CONTROL_S * (command.ahead_m_s * np.sin(yaw) + command.left_m_s * np.cos(yaw))
        place = np.clip([x, y], -_WALL_M, _WALL_M)
        self.pose = np.array([*place, yaw + CONTROL_S * command.turn_rad_s])

    def _pillars(self, cos: np.ndarray, sin: np.ndarray) -> np.ndarray:
        away = _PILLARS - self.pose[:2]
        along = away[:, :1] * cos + away[:, 1:] * sin
        off2 = (away**2).sum(axis=1)[:, None] - along**2
        near = along - np.sqrt(np.maximum(_PILLAR_M**2 - off2, 0.0))
        return np.where((off2 < _PILLAR_M**2) & (along > 0.0), near, np.inf).min(axis=0)
