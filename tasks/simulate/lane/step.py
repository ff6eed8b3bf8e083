"""One control step of one lane: sense and decide, drive, settle. The program maps it over lanes.

``Mechanics`` is the socket that an engine fits in which is a JAX function.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
from jaxtyping import Float

from specs.data.engine_name import EngineName
from tasks.simulate.application.motion import Body, Motion
from tasks.simulate.application.robot_mjcf import Hull
from tasks.simulate.lane.calls import Applications
from tasks.simulate.lane.lane_state import LaneInputs, LaneState, StepRecord
from tasks.simulate.lane.sense import decide
from tasks.simulate.lane.settle import settle


def _nothing(_inputs: LaneInputs, _body: Body) -> None:
    """Returns nothing: most engines look at all obstacles in each step."""


@dataclass(frozen=True, eq=False)
class Mechanics:
    """A robot as an engine steps it, for one lane; the program maps it over lanes.

    Attributes:
        engine: The engine's name.
        actuators: How many numbers a control has.
        first_body: Returns the robot at rest at a start (x m, y m, yaw rad).
        drive: Returns what a control step's physics does to it.
        near: Returns what it picks out of the obstacles around a body, for control steps to come (``LaneInputs.near``).
    """

    engine: EngineName
    hull: Hull
    actuators: int
    first_body: Callable[[Float[jax.Array, "3"]], Body]
    drive: Callable[[LaneInputs, Body, Float[jax.Array, "actuators"]], Motion]
    near: Callable[[LaneInputs, Body], Any] = _nothing


def advance_lane(
    mechanics: Mechanics, applications: Applications, inputs: LaneInputs, state: LaneState
) -> tuple[LaneState, StepRecord]:
    """Returns a lane one control step later.

    Args:
        mechanics: The robot on an engine.
        applications: Controller, scenario and sensors.
        inputs: The lane's.
        state: Before the step.
    """
    decided = decide(applications, inputs, state)
    motion = mechanics.drive(inputs, state.body, decided.control)
    return settle(applications, inputs, state, decided, motion)
