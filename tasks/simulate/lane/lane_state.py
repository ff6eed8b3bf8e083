"""One lane as data: what it is given, what changes in it, and what is kept of a control step."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from tasks.simulate.application.calls import Applications, Numbers
from tasks.simulate.application.contract import FloorMap, Joints, State
from tasks.simulate.lane.noise import Seed
from tasks.simulate.surroundings.lidar import Boxes, Cylinders
from tasks.simulate.surroundings.silhouettes import Silhouettes

NO_CRASH, ROBOT_CRASH, SIMULATION_CRASH = 0, 1, 2


class LaneInputs(NamedTuple):
    """What does not change during an episode.

    Attributes:
        boxes, cylinders: Obstacles in the hull's band of heights.
        seen: What crosses the lidar's plane.
        given: What the scenario's ``place`` gave besides start and goals.
        seed: The episode's, as ``noise.seed_words``.
        last_step: Control steps until time is up.
        alive: False for a lane that only fills the chunk.
    """

    boxes: Boxes
    cylinders: Cylinders
    seen: Silhouettes
    floor: FloorMap
    start: Float[jax.Array, "3"]
    goals_m: Float[jax.Array, "goals 2"]
    given: tuple[jax.Array, ...]
    seed: Seed
    numbers: Numbers
    last_step: Int[jax.Array, ""]
    alive: Bool[jax.Array, ""]


class Body(NamedTuple):
    """The robot's mechanical state, and what the solver starts from.

    Attributes:
        qpos: Pose of its base: (x m, y m, yaw rad).
        qvel: How that moves along the world's axes.
        warmstart: The last accelerations; an engine that keeps its own state has none.
        joints: Of a robot that is more than a planar base; None for the others.
    """

    qpos: Float[jax.Array, "3"]
    qvel: Float[jax.Array, "3"]
    act: Float[jax.Array, "activations"]
    warmstart: Float[jax.Array, "speeds"]
    joints: Joints | None = None


class Tally(NamedTuple):
    """What is summed up over an episode; fields as in EpisodeResult."""

    path_length_m: Float[jax.Array, ""]
    collisions: Int[jax.Array, ""]
    touching: Bool[jax.Array, ""]
    impulse_ns: Float[jax.Array, ""]
    max_impulse_ns: Float[jax.Array, ""]
    min_clearance_m: Float[jax.Array, ""]
    energy_j: Float[jax.Array, ""]


class Sensed(NamedTuple):
    """What the sensors made of the last control step.

    Attributes:
        pose: Where the robot believes to be; None without odometry, when it knows.
        bumper: Which sectors were touched.
    """

    pose: Float[jax.Array, "3"] | None
    bumper: Bool[jax.Array, "sectors"]


class LaneState(NamedTuple):
    """What changes: the robot, both applications' states, and how the episode stands.

    Attributes:
        goal_steps: After how many control steps each goal was reached; 0 for one that was not.
        metrics: What the scenario measures by itself, by name.
    """

    body: Body
    sensed: Sensed
    controller: State
    scenario: State
    metrics: dict[str, Float[jax.Array, ""]]
    tally: Tally
    step: Int[jax.Array, ""]
    goal_index: Int[jax.Array, ""]
    goal_steps: Int[jax.Array, "goals"]
    done: Bool[jax.Array, ""]
    reason: Int[jax.Array, ""]
    crash: Int[jax.Array, ""]


class Work(NamedTuple):
    """What a control step's physics did.

    Attributes:
        impulse_ns: How much contacts pushed the robot in the plane, whichever way.
        push_ns: The same as a vector along the world's axes: where it was pushed to, pushes against each other apart.
        energy_j: What its actuators spent.
    """

    impulse_ns: Float[jax.Array, ""]
    push_ns: Float[jax.Array, "2"]
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


class Decision(NamedTuple):
    """What a controller made of what it sensed at a control step.

    Attributes:
        controller: What it keeps.
        control: For the step to come.
        ranges_m: The scan that it saw.
    """

    controller: State
    control: Float[jax.Array, "actuators"]
    ranges_m: Float[jax.Array, "rays"]


class Record(NamedTuple):
    """What is kept of a control step.

    Attributes:
        pose, velocity: Of the robot's base at the step's end.
        goal_index: The goal to go to then.
        control: What drove it during the step.
        ranges_m: The scan at the step's beginning, which the control was decided on.
        impulse_ns: What contacts pushed the robot with during the step.
    """

    pose: Float[jax.Array, "3"]
    velocity: Float[jax.Array, "3"]
    goal_index: Int[jax.Array, ""]
    control: Float[jax.Array, "actuators"]
    ranges_m: Float[jax.Array, "rays"]
    impulse_ns: Float[jax.Array, ""]


def begin_lane(applications: Applications, inputs: LaneInputs, body: Body) -> LaneState:
    """Returns a lane's state before its first control step."""
    zero, none = jnp.zeros(()), jnp.zeros((), jnp.int32)
    scenario = applications.scenario(inputs.numbers).init(inputs.start, inputs.goals_m, *inputs.given)
    return LaneState(
        body=body,
        sensed=Sensed(
            pose=None if applications.sensors.odometry is None else inputs.start,
            bumper=jnp.zeros(applications.sensors.bumper.sectors, bool),
        ),
        controller=applications.controller(inputs.numbers).init(inputs.floor, inputs.goals_m),
        scenario=scenario,
        metrics=applications.metrics(inputs.numbers, scenario),
        tally=Tally(zero, none, jnp.zeros((), bool), zero, zero, jnp.full((), jnp.inf), zero),
        step=none,
        goal_index=none,
        goal_steps=jnp.zeros(inputs.goals_m.shape[0], jnp.int32),
        done=~inputs.alive,
        reason=none,
        crash=none,
    )
