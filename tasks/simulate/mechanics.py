"""What an engine that is a JAX function knows to do with one robot: the socket that such engines fit in."""

from collections.abc import Callable
from dataclasses import dataclass

import jax
from jaxtyping import Float

from tasks.simulate.lane_state import Body, LaneInputs, Motion
from tasks.simulate.robot import Hull


@dataclass(frozen=True, eq=False)
class Mechanics:
    """A robot as an engine steps it, for one lane; the program maps it over lanes.

    Attributes:
        engine: The engine's name.
        actuators: How many numbers a control has.
        first_body: Returns the robot at rest at a start (x m, y m, yaw rad).
        drive: Returns what a control step's physics does to it.
    """

    engine: str
    hull: Hull
    actuators: int
    first_body: Callable[[Float[jax.Array, "3"]], Body]
    drive: Callable[[LaneInputs, Body, Float[jax.Array, "actuators"]], Motion]
