"""The data of one lane: its inputs, its state, and the record of a control step."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from tasks.simulate.application.contract import Body, FloorMap, State
from tasks.simulate.geometry.lidar_scan import Boxes, Cylinders, LidarOutlines
from tasks.simulate.lane.chunk_applications import Applications, Numbers
from tasks.simulate.sensors.sensor import Memory, Seed
from tasks.simulate.sensors.sensor_table import begin_sensors

NO_CRASH, ROBOT_CRASH, SIMULATION_CRASH = 0, 1, 2


class LaneInputs(NamedTuple):
    """What does not change during an episode.

    Attributes:
        boxes, cylinders: Obstacles in the hull's band of heights.
        lidar_outlines: What crosses the lidar's plane.
        given: What the scenario's ``place`` gave besides start and goals.
        seed: The episode's, as ``tasks.simulate.sensors.sensor.seed_words``.
        last_step: Control steps until time is up.
        alive: False for a lane that only fills the chunk.
        near: What the engine picked out of the obstacles for some control steps; its own, and None if it did not.
    """

    boxes: Boxes
    cylinders: Cylinders
    lidar_outlines: LidarOutlines
    floor: FloorMap
    start: Float[jax.Array, "3"]
    goals_m: Float[jax.Array, "goals 2"]
    given: tuple[jax.Array, ...]
    seed: Seed
    numbers: Numbers
    last_step: Int[jax.Array, ""]
    alive: Bool[jax.Array, ""]
    near: Any = None


class EpisodeTotals(NamedTuple):
    """What is summed up over an episode; fields as in EpisodeResult."""

    path_length_m: Float[jax.Array, ""]
    collisions: Int[jax.Array, ""]
    touching: Bool[jax.Array, ""]
    impulse_ns: Float[jax.Array, ""]
    max_impulse_ns: Float[jax.Array, ""]
    min_clearance_m: Float[jax.Array, ""]
    energy_j: Float[jax.Array, ""]


class LaneState(NamedTuple):
    """What changes: the robot, both applications' states, and how the episode stands.

    Attributes:
        sensed: What the sensors remember, by name (``tasks.simulate.sensors``).
        goal_steps: After how many control steps each goal was reached; 0 for one that was not.
        metrics: What the scenario measures by itself, by name.
    """

    body: Body
    sensed: dict[str, Memory]
    controller: State
    scenario: State
    metrics: dict[str, Float[jax.Array, ""]]
    totals: EpisodeTotals
    step: Int[jax.Array, ""]
    goal_index: Int[jax.Array, ""]
    goal_steps: Int[jax.Array, "goals"]
    done: Bool[jax.Array, ""]
    reason: Int[jax.Array, ""]
    crash: Int[jax.Array, ""]


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


class StepRecord(NamedTuple):
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
        sensed=begin_sensors(applications.sensors, inputs.start),
        controller=applications.controller(inputs.numbers).init(inputs.floor, inputs.goals_m),
        scenario=scenario,
        metrics=applications.metrics(inputs.numbers, scenario),
        totals=EpisodeTotals(zero, none, jnp.zeros((), bool), zero, zero, jnp.full((), jnp.inf), zero),
        step=none,
        goal_index=none,
        goal_steps=jnp.zeros(inputs.goals_m.shape[0], jnp.int32),
        done=~inputs.alive,
        reason=none,
        crash=none,
    )
