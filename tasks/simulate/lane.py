"""One lane: what it is given, what changes in it, and one control step of it.

Everything here is written for one robot; the program maps it over lanes.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from tasks.simulate.applications import Applications, Numbers
from tasks.simulate.contract import FloorMap, Observation, State, Truth
from tasks.simulate.lidar import Boxes, Cylinders, scan_ranges
from tasks.simulate.model import BOX_SLOTS, CYLINDER_SLOTS, RobotModel
from tasks.simulate.quiet_mjx import mjx
from tasks.simulate.robot import CONTROL_S
from tasks.simulate.window import distance_m, nearest_obstacles, with_window

TIMEOUT = 2  # index in contract.REASONS
CRASH = 5
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


def advance_lane(
    robot: RobotModel, applications: Applications, inputs: LaneInputs, state: LaneState
) -> tuple[LaneState, Record]:
    """Returns a lane one control step later; a lane that is done stays as it is, bit for bit."""
    controller_state, control = _decide(applications, inputs, state)
    finite_control = jnp.isfinite(control).all()
    body, work, clearance_m = drive(robot, inputs, state.body, control)
    finite_body = jnp.isfinite(body.qpos).all() & jnp.isfinite(body.qvel).all()
    step = state.step + 1
    truth = _truth(inputs, body, work, clearance_m, step)
    scenario_state, verdict = applications.scenario(inputs.numbers).step(state.scenario, truth)
    crash = jnp.where(~finite_control, ROBOT_CRASH, jnp.where(~finite_body, SIMULATION_CRASH, NO_CRASH))
    timeout = ~verdict.done & (step >= inputs.last_step)
    reason = jnp.where(crash > 0, CRASH, jnp.where(timeout, TIMEOUT, verdict.reason))
    moved = LaneState(
        body=body,
        controller=controller_state,
        scenario=scenario_state,
        tally=_tally(state, body, work, clearance_m),
        step=step,
        goal_index=verdict.goal_index,
        done=verdict.done | timeout,
        reason=reason,
        crash=crash,
    )
    # A lane that crashes keeps its last sound state, and says only that it crashed.
    crashed = state._replace(done=jnp.ones((), bool), reason=reason, crash=crash)
    chosen = _select(crash > 0, crashed, moved)
    final = _select(state.done, state, chosen)
    return final, Record(final.body.qpos, control)


def drive(
    robot: RobotModel, inputs: LaneInputs, body: Body, control: Float[jax.Array, "actuators"]
) -> tuple[Body, Work, Float[jax.Array, ""]]:
    """Returns the robot after a control step's physics, the work done, and the clearance of its hull."""
    window = nearest_obstacles(inputs.boxes, inputs.cylinders, body.qpos[:2], BOX_SLOTS, CYLINDER_SLOTS)
    model = with_window(robot, window)
    step_s = model.opt.timestep

    def physics_step(carry: tuple[Body, Work], _: None) -> tuple[tuple[Body, Work], None]:
        before, work = carry
        data = robot.data.replace(
            qpos=before.qpos, qvel=before.qvel, act=before.act, qacc_warmstart=before.warmstart, ctrl=control
        )
        data = mjx.step(model, data)
        push_n = jnp.sqrt(jnp.sum(data.qfrc_constraint[:2] ** 2))
        power_w = jnp.sum(jnp.abs(data.qfrc_actuator * before.qvel))
        after = Body(data.qpos, data.qvel, data.act, data.qacc_warmstart)
        return (after, Work(work.impulse_ns + push_n * step_s, work.energy_j + power_w * step_s)), None

    nothing = Work(jnp.zeros(()), jnp.zeros(()))
    (after, work), _ = jax.lax.scan(physics_step, (body, nothing), None, length=robot.physics_steps)
    return after, work, distance_m(window, after.qpos[:2]) - robot.hull.radius_m


def _decide(
    applications: Applications, inputs: LaneInputs, state: LaneState
) -> tuple[State, Float[jax.Array, "actuators"]]:
    lidar, pose = applications.lidar, state.body.qpos
    ranges = scan_ranges(inputs.seen_boxes, inputs.seen_cylinders, pose, lidar.rays, lidar.range_m)
    goal = jnp.clip(state.goal_index, 0, inputs.goals_m.shape[0] - 1)
    observation = Observation(
        time_s=state.step * CONTROL_S,
        pose=pose,
        velocity=state.body.qvel,
        ranges_m=ranges,
        goal_index=goal,
        goal_m=inputs.goals_m[goal],
    )
    return applications.controller(inputs.numbers).step(state.controller, observation)


def _truth(
    inputs: LaneInputs, body: Body, work: Work, clearance_m: Float[jax.Array, ""], step: Int[jax.Array, ""]
) -> Truth:
    bounds, place = inputs.floor.bounds_m, body.qpos[:2]
    inside = jnp.all((place >= bounds[:2]) & (place <= bounds[2:]))
    return Truth(step * CONTROL_S, body.qpos, body.qvel, clearance_m, work.impulse_ns, inside)


def _tally(state: LaneState, body: Body, work: Work, clearance_m: Float[jax.Array, ""]) -> Tally:
    tally, touching = state.tally, work.impulse_ns > 0.0
    way = body.qpos[:2] - state.body.qpos[:2]
    return Tally(
        path_length_m=tally.path_length_m + jnp.sqrt(jnp.sum(way**2)),
        collisions=tally.collisions + (touching & ~tally.touching),
        touching=touching,
        min_clearance_m=jnp.minimum(tally.min_clearance_m, clearance_m),
        energy_j=tally.energy_j + work.energy_j,
    )


def _select(choose: Bool[jax.Array, ""], yes: LaneState, no: LaneState) -> LaneState:
    """Returns one of two states; what is the same array in both, such as a plan, is not touched at all."""

    def pick(a: jax.Array, b: jax.Array) -> jax.Array:
        return a if a is b else jnp.where(choose, a, jnp.asarray(b).astype(jnp.asarray(a).dtype))

    return jax.tree.map(pick, yes, no)
