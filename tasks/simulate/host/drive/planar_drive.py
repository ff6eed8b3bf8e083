"""What a Twist does to a planar base, from where its velocity actuators push.

An actuator gets the speed that its transmission has when the base moves as the Twist says. That serves speeds ahead and
turn rates, wheels at either side, and actuators along the world's axes, whatever they are called.
"""

from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float64

from tasks.simulate.application.robot_mjcf import rest_position
from tasks.simulate.host.drive.twist_rows import DriveUnclear, TwistRows, actuator_names, takes_speed

_YAW = 2
_QUARTER_RAD = np.pi / 2


class BaseMotor(NamedTuple):
    """How an actuator acts on a planar base that is not turned.

    Attributes:
        moment: Its transmission's speed for each of the base's: along x, along y, about z.
        turns: Whether it turns with the base; one that acts about z alone does.
        strange: Whether it neither turns with the base nor stays with the world's axes.
    """

    moment: Float64[np.ndarray, "3"]
    turns: bool
    strange: bool


def base_motors(model: mujoco.MjModel) -> list[BaseMotor]:
    """Returns how each actuator acts on a planar base."""
    rest = rest_position(model)
    before = _moments(model, rest, 0.0)
    after = _moments(model, rest, _QUARTER_RAD)
    found: list[BaseMotor] = []
    for here, there in zip(before, after, strict=True):
        turns = np.allclose(there, (-here[1], here[0], here[2]), atol=1e-9)
        found.append(BaseMotor(here, bool(turns), not turns and not np.allclose(there, here, atol=1e-9)))
    return found


def planar_rows(model: mujoco.MjModel) -> TwistRows:
    """Returns what the actuators of a planar base get of a Twist.

    One that pushes sideways and has no ``ctrlrange`` stands for tyres that hold the base: it gets 0.

    Raises:
        DriveUnclear: An actuator pushes the base, and its control is no speed.
    """
    rows, why = TwistRows.none(model.nu), list[str]()
    for number, (motor, name) in enumerate(zip(base_motors(model), actuator_names(model), strict=True)):
        if not motor.moment.any():
            continue
        if motor.strange:
            why.append(f"actuator {name} pushes the base neither along its own axes nor along the world's")
        elif not takes_speed(model, number):
            why.append(f"actuator {name} pushes the base and is no velocity actuator, so that a speed tells it nothing")
        elif not _holds(model, number, motor):
            (rows.own if motor.turns else rows.world)[number] = motor.moment
    if why:
        raise DriveUnclear(why)
    return rows


def _holds(model: mujoco.MjModel, number: int, motor: BaseMotor) -> bool:
    sideways = motor.turns and not motor.moment[0] and bool(motor.moment[1])
    return sideways and not model.actuator_ctrllimited[number]


def _moments(
    model: mujoco.MjModel, rest: Float64[np.ndarray, "coordinates"], yaw_rad: float
) -> Float64[np.ndarray, "actuators 3"]:
    data = mujoco.MjData(model)
    data.qpos[:] = rest
    data.qpos[_YAW] = yaw_rad
    mujoco.mj_forward(model, data)
    moments = np.zeros((model.nu, model.nv))
    mujoco.mju_sparse2dense(moments, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind)
    return np.round(moments[:, :3], 9)
