"""What a trainer's action does to the actuators: from -1 to 1 over each control range, or the control itself."""

from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Float32, Int

from specs.base import Fault
from specs.errors import DocumentError
from tasks.simulate.application.robot_mjcf import compile_robot, read_robot_mjcf


class ActionMap(NamedTuple):
    """How actions become controls.

    Actuators without a ``ctrlrange`` are no part of an action: they are given 0, as the courier's, which holds it from
    sliding sideways.

    Attributes:
        names: Of the actuators that an action drives, in its order.
        places: Where their controls are.
        low, high: Their control ranges.
        actuators: How many numbers a control has.
        normalized: Whether actions go from -1 to 1; else they are controls.
    """

    names: tuple[str, ...]
    places: Int[np.ndarray, "actions"]
    low: Float32[np.ndarray, "actions"]
    high: Float32[np.ndarray, "actions"]
    actuators: int
    normalized: bool

    @property
    def least(self) -> Float32[np.ndarray, "actions"]:
        """Returns the least action."""
        return np.full_like(self.low, -1.0) if self.normalized else self.low

    @property
    def most(self) -> Float32[np.ndarray, "actions"]:
        """Returns the largest action."""
        return np.full_like(self.high, 1.0) if self.normalized else self.high


def action_map(robot: Path, *, normalized: bool) -> ActionMap:
    """Returns how actions become controls of a robot.

    Args:
        robot: Its ``robot.xml``.
        normalized: Whether actions go from -1 to 1.

    Raises:
        DocumentError: No actuator has a ``ctrlrange``, so that there is nothing to draw actions from.
    """
    model = compile_robot(read_robot_mjcf(robot))
    limited = np.flatnonzero(model.actuator_ctrllimited)
    if not limited.size:
        allowed = "at least one actuator with a ctrlrange: actions are drawn from it"
        raise DocumentError([Fault(path="actuator", value="no ctrlrange", allowed=allowed)], f"{robot}")
    low, high = model.actuator_ctrlrange[limited].astype(np.float32).T
    names = tuple(model.actuator(int(each)).name or f"actuator {each}" for each in limited)
    return ActionMap(names, limited, np.ascontiguousarray(low), np.ascontiguousarray(high), model.nu, normalized)


def control_of(actions: ActionMap, action: Float[jax.Array, "actions"]) -> Float[jax.Array, "actuators"]:
    """Returns one lane's control.

    An action from -1 to 1 becomes ``middle + half * action``, clipped before; a control is clipped to its range.

    Args:
        actions: The robot's.
        action: One number for each actuator that has a control range.
    """
    held = jnp.clip(action, actions.least, actions.most)
    if actions.normalized:
        middle, half = (actions.high + actions.low) / 2, (actions.high - actions.low) / 2
        held = middle + half * held
    return jnp.zeros(actions.actuators, jnp.float32).at[actions.places].set(held)
