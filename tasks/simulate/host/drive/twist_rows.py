"""What actuators get of a Twist, a row an actuator, and what is read of each actuator's kind for it."""

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float64

from specs.errors import SimyardError

_DYNAMICS = (mujoco.mjtDyn.mjDYN_NONE, mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)


class DriveUnclear(SimyardError):  # noqa: N818 - a state
    """It cannot be seen what a Twist does to a robot.

    Attributes:
        why: All that is in the way, for a person.
    """

    def __init__(self, why: Sequence[str]) -> None:
        self.why = tuple(why)
        super().__init__("; ".join(why))


class TwistRows(NamedTuple):
    """What each actuator gets of a Twist in the robot's frame, and of the same along the world's axes."""

    own: Float64[np.ndarray, "actuators 3"]
    world: Float64[np.ndarray, "actuators 3"]

    @classmethod
    def none(cls, actuators: int) -> "TwistRows":
        """Returns rows of actuators that get nothing."""
        return cls(np.zeros((actuators, 3)), np.zeros((actuators, 3)))


def actuator_names(model: mujoco.MjModel) -> list[str]:
    """Returns the names of a robot's actuators, in the order of its controls."""
    return [model.actuator(number).name or f"actuator {number}" for number in range(model.nu)]


def takes_speed(model: mujoco.MjModel, number: int) -> bool:
    """Returns whether an actuator's control is a speed that it keeps, as MuJoCo's ``velocity`` actuators do."""
    gain, bias = model.actuator_gainprm[number], model.actuator_biasprm[number]
    return bool(
        model.actuator_gaintype[number] == mujoco.mjtGain.mjGAIN_FIXED
        and model.actuator_biastype[number] == mujoco.mjtBias.mjBIAS_AFFINE
        and mujoco.mjtDyn(model.actuator_dyntype[number]) in _DYNAMICS
        and gain[0] > 0.0
        and np.allclose(bias[:3], (0.0, 0.0, -gain[0]))
    )


def rest_controls(model: mujoco.MjModel) -> Float64[np.ndarray, "actuators"]:
    """Returns what actuators are told that nobody commands: the controls of the first keyframe, else 0."""
    return np.array(model.key_ctrl[0]) if model.nkey else np.zeros(model.nu)
