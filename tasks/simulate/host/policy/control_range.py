"""How the numbers that a policy answers with become controls: an action means here what it means to trainers.

Actuators without a ``ctrlrange`` are no part of an action: they are given 0.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Int

from tasks.simulate.application.robot_mjcf import base_of, compile_robot, read_robot_mjcf
from tasks.simulate.host.policy.policy_check import RobotNumbers


class ControlRange(NamedTuple):
    """A robot's actuators.

    Attributes:
        numbers: How many there are, and how many coordinates the robot has.
        places: Of those that have a ``ctrlrange``.
        low, high: Their ranges.
    """

    numbers: RobotNumbers
    places: Int[np.ndarray, "ranged"]
    low: Float32[np.ndarray, "ranged"]
    high: Float32[np.ndarray, "ranged"]


def control_range(robot: Path) -> ControlRange:
    """Returns the actuators of a ``robot.xml``.

    Raises:
        RobotRefused: It does not load.
    """
    model = compile_robot(read_robot_mjcf(robot))
    places = np.flatnonzero(model.actuator_ctrllimited)
    low, high = model.actuator_ctrlrange[places].astype(np.float32).T
    articulated = base_of(model).articulated
    numbers = RobotNumbers(
        int(model.nu), len(places), int(model.nq) if articulated else 0, int(model.nv) if articulated else 0
    )
    return ControlRange(numbers, places, np.ascontiguousarray(low), np.ascontiguousarray(high))


def action_controls(
    ranges: ControlRange, actions: Float32[np.ndarray, "lanes ranged"]
) -> Float32[np.ndarray, "lanes actuators"]:
    """Returns the controls of actions from -1 to 1: ``middle + half * action``, clipped before."""
    middle, half = (ranges.high + ranges.low) / 2, (ranges.high - ranges.low) / 2
    return placed_controls(ranges, middle + half * np.clip(actions, np.float32(-1.0), np.float32(1.0)))


def placed_controls(
    ranges: ControlRange, values: Float32[np.ndarray, "lanes values"]
) -> Float32[np.ndarray, "lanes actuators"]:
    """Returns controls of one number for each actuator, or for each that has a ``ctrlrange``; the others are 0."""
    if values.shape[1] == ranges.numbers.actuators:
        return values
    controls = np.zeros((len(values), ranges.numbers.actuators), np.float32)
    controls[:, ranges.places] = values
    return controls
