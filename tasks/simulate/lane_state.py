"""One lane as data: what it is given, what changes in it, and what is kept of a control step."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from tasks.simulate.applications import Applications, Numbers
from tasks.simulate.contract import FloorMap, State
from tasks.simulate.lidar import Boxes, Cylinders
from tasks.simulate.model import RobotModel

NO_CRASH, ROBOT_CRASH, SIMULATION_CRASH = 0, 1, 2


class LaneInputs(NamedTuple):
    """What does not change during an episode.

    Attributes:
        boxes, cylinders: Obstacles in the hull's band of heights.
        seen_boxes, seen_cylinders: Those that cross the lidar's plane.
        last_step: Control steps until time is up.
        alive: False for a lane that only fills the chunk.
    """

    boxes: Boxes
    cylinders: Cylinders
    seen_boxes: Boxes
    seen_cylinders: Cylinders
    floor: FloorMap
    start: Float[jax.Array, "3"]
    goals_m: Float[jax.Array, "goals 2"]
    numbers: Numbers
    last_step: Int[jax.Array, ""]
    alive: Bool[jax.Array, ""]


class Body(NamedTuple):
    """The robot's mechanical state, and what the solver starts from."""

    qpos: Float[jax.Array, "3"]
    qvel: Float[jax.Array, "3"]
    act: Float[jax.Array, "activations"]
    warmstart: Float[jax.Array, "3"]


class Tally(NamedTuple):
    """What is summed up over an episode; fields as in EpisodeResult."""

    path_length_m: Float[jax.Array, ""]
    collisions: Int[jax.Array, ""]
    touching: Bool[jax.Array, ""]
    min_clearance_m: Float[jax.Array, ""]
    energy_j: Float[jax.Array, ""]


class LaneState(NamedTuple):
    """What changes: the robot, both applications' states, and how the episode stands."""

    body: Body
    controller: State
    scenario: State
    tally: Tally
    step: Int[jax.Array, ""]
    goal_index: Int[jax.Array, ""]
    done: Bool[jax.Array, ""]
    reason: Int[jax.Array, ""]
    crash: Int[jax.Array, ""]


class Work(NamedTuple):
    """What a control step's physics did: contact impulse in the plane (N s) and the actuators' energy (J)."""

    impulse_ns: Float[jax.Array, ""]
    energy_j: Float[jax.Array, ""]


class Motion(NamedTuple):
    """What an engine makes of a control step.

    Attributes:
        body: The robot at the step's end.
        clearance_m: From its hull to the nearest solid then, below 0 when pressed into it.
    """

    body: Body
    work: Work
    clearance_m: Float[jax.Array, ""]


class Record(NamedTuple):
    """What is kept of a control step: pose at its end, and the control."""

    pose: Float[jax.Array, "3"]
    control: Float[jax.Array, "actuators"]


def begin_lane(robot: RobotModel, applications: Applications, inputs: LaneInputs) -> LaneState:
    """Returns a lane's state before its first control step."""
    zero, none = jnp.zeros(()), jnp.zeros((), jnp.int32)
    rest = jnp.zeros(3)
    return LaneState(
        body=Body(inputs.start, rest, jnp.zeros(robot.host.na), rest),
        controller=applications.controller(inputs.numbers).init(inputs.floor, inputs.goals_m),
        scenario=applications.scenario(inputs.numbers).init(inputs.start, inputs.goals_m),
        tally=Tally(zero, none, jnp.zeros((), bool), jnp.full((), jnp.inf), zero),
        step=none,
        goal_index=none,
        done=~inputs.alive,
        reason=none,
        crash=none,
    )
