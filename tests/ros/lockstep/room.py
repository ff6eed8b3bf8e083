"""A small world for nodes: a robot in a square room, which senses walls and goes where it is told."""

import hashlib
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from specs.ros_robot import RosRobot
from tasks.ros.lockstep.exchange import ExchangeTotals, GoalEnd, Launch, RobotBase, Sensed, TwistCommand
from tasks.ros.lockstep.ros1_lockstep import Ros1Lockstep
from tasks.ros.lockstep.step_driver import LockstepPatience
from tasks.ros.process.lane_limits import LaneLimits
from tests.ros.pictures import readings

CONTROL_S = 0.05
RAYS = 40
BASE = RobotBase(RosRobot(), RAYS, -math.pi, 2 * math.pi / RAYS, 8.0)
_HALF_M = 2.0
_ANGLES = -math.pi + 2 * math.pi / RAYS * np.arange(RAYS)


class Room:
    """One robot in its room."""

    def __init__(self, seed: int, robot: RosRobot = BASE.robot) -> None:
        self._robot = robot
        self._x, self._y, self._yaw = 0.0, 0.0, float(np.random.default_rng(seed).uniform(-3.0, 3.0))
        self._command = TwistCommand()

    def sense(self) -> Sensed:
        """Returns what the robot senses now."""
        cos, sin = np.cos(_ANGLES + self._yaw), np.sin(_ANGLES + self._yaw)
        with np.errstate(divide="ignore"):
            x_m, y_m = (_HALF_M * np.sign(cos) - self._x) / cos, (_HALF_M * np.sign(sin) - self._y) / sin
        ranges_m = np.minimum(x_m, y_m).astype(np.float32)
        pose, velocity = np.array([self._x, self._y, self._yaw]), np.array(self._command)
        more = readings(self._robot, ranges_m)
        return Sensed(pose, velocity, np.zeros(2), ranges_m, np.zeros(3, np.bool_), np.array([2.0, 1.0]), None, more)

    def drive(self, command: TwistCommand) -> None:
        """Moves the robot for a control step."""
        self._command = command
        x = self._x + CONTROL_S * command.ahead_m_s * math.cos(self._yaw)
        y = self._y + CONTROL_S * command.ahead_m_s * math.sin(self._yaw)
        self._x, self._y = (min(max(place, -1.8), 1.8) for place in (x, y))
        self._yaw += CONTROL_S * command.turn_rad_s


class Driven(NamedTuple):
    """What became of lanes.

    Attributes:
        digests: Of each lane's commands.
        tallies: Of each lane.
        failures: By lane.
        printed: By each lane's nodes.
        goal_ends: By lane.
    """

    digests: list[str]
    tallies: list[ExchangeTotals]
    failures: Mapping[int, str]
    printed: list[str]
    goal_ends: Mapping[int, GoalEnd]


def drive(
    launch: Launch,
    seeds: Sequence[int],
    steps: int,
    *,
    patience: LockstepPatience | None = None,
    limits: LaneLimits | None = None,
    robot: RosRobot | None = None,
) -> Driven:
    """Returns what became of one lane for each seed; lanes that failed stand still."""
    base = BASE._replace(robot=robot or BASE.robot)
    with Ros1Lockstep(launch, base, CONTROL_S, patience=patience, limits=limits) as lockstep:
        rooms = [Room(seed, base.robot) for seed in seeds]
        traces = [hashlib.sha256() for _ in seeds]
        lockstep.begin([room.sense() for room in rooms], [None] * len(rooms))
        for _ in range(steps):
            over = lockstep.failures.keys() | lockstep.goal_ends.keys()
            sensed = [None if k in over else room.sense() for k, room in enumerate(rooms)]
            for room, trace, command in zip(rooms, traces, lockstep.exchange(sensed), strict=True):
                room.drive(command)
                trace.update(np.array(command).tobytes())
        tallies = [lockstep.tally(k) for k in range(len(seeds))]
        printed = [lockstep.printed(k) for k in range(len(seeds))]
        digests, ends = [trace.hexdigest() for trace in traces], lockstep.goal_ends
        return Driven(digests, tallies, dict(lockstep.failures), printed, ends)


def nothing_left(home: Path) -> bool:
    """Returns whether no process of these lanes is there, and no file."""
    mark = f"ROS_HOME={home}/".encode()
    for folder in Path("/proc").iterdir():
        try:
            if folder.name.isdigit() and mark in (folder / "environ").read_bytes():
                return False
        except OSError:
            continue
    return not home.exists()
