"""One lane: its data, and one control step of it. The program maps the step over lanes.

A lane senses and decides, is driven by an engine, and is judged by the scenario.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from specs.data.episode import CONTROL_S
from specs.data.people import PERSON_HEIGHT_M
from specs.field_types import EngineName
from tasks.simulate.application.contract import (
    COLLISION,
    CRASH,
    PERSON,
    ROBOT,
    TIMEOUT,
    Body,
    FloorMap,
    Motion,
    Observation,
    State,
    Truth,
)
from tasks.simulate.application.robot_model import Hull
from tasks.simulate.geometry.depth_picture import DepthScene
from tasks.simulate.geometry.hull_distance import LaneObstacles
from tasks.simulate.geometry.lidar_scan import LidarOutlines
from tasks.simulate.lane.chunk_applications import Applications, Numbers
from tasks.simulate.lane.control_delay import Commands, delivered, no_commands, sent
from tasks.simulate.lane.lane_boxes import (
    BoxesInputs,
    Standing,
    begin_boxes,
    box_outlines,
    box_places_m,
    box_scene,
    box_solids,
    boxes_at,
)
from tasks.simulate.lane.shared_world import (
    Others,
    RobotsInputs,
    RobotsState,
    begin_robots,
    first_others,
    meet_others,
    nearest_yet_m,
    others_of,
    robot_circles,
    robot_cylinders,
    with_deadlock,
)
from tasks.simulate.lane.walkers import (
    PeopleInputs,
    PeopleState,
    begin_people,
    meet,
    people_circles,
    people_cylinders,
    robot_disc,
    to_collision_s,
    walk,
)
from tasks.simulate.sensors.sensor import Drive, Fields, Memory, Seed, Situation, rotate
from tasks.simulate.sensors.sensor_table import begin_sensors, feel_all, observe_all

NO_CRASH, ROBOT_CRASH, SIMULATION_CRASH = 0, 1, 2


class LaneInputs(NamedTuple):
    """What does not change during an episode.

    Attributes:
        obstacles: In the hull's band of heights.
        lidar_outlines: What crosses the lidar's plane.
        given: What the scenario's ``place`` gave besides start and goals.
        seed: The episode's, as ``tasks.simulate.sensors.sensor.seed_words``.
        last_step: Control steps until time is up.
        alive: False for a lane that only fills the chunk.
        near: What the engine picked out of the obstacles for some control steps; its own, and None if it did not.
        scene: What a depth camera can see; None for a robot without.
        hull_depth_m: What it sees of its own robot; None for one that sees nothing of it.
        people: Who walks about; None in a lane without people.
        physics: Factors of the robot's mass, friction and motor strength; None in a program without.
        delay_steps: After how many control steps a command reaches the actuators; likewise.
        standing_m: Where they stand while an engine drives a control step (x, y); likewise.
        robots: Who else drives in its world; None in a lane whose robot is alone.
        others: How they are before a control step; likewise.
        boxes: What is put into its world; None in a lane without.
        put: Those boxes that stand in the way while an engine drives a control step, as obstacles; likewise.
    """

    obstacles: LaneObstacles
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
    scene: DepthScene | None = None
    hull_depth_m: Float[jax.Array, "*cameras rows columns"] | None = None
    people: PeopleInputs | None = None
    standing_m: Float[jax.Array, "people 2"] | None = None
    physics: Float[jax.Array, "3"] | None = None
    delay_steps: Int[jax.Array, ""] | None = None
    robots: RobotsInputs | None = None
    others: Others | None = None
    boxes: BoxesInputs | None = None
    put: Float[jax.Array, "boxes 8"] | None = None

    @property
    def solids(self) -> LaneObstacles:
        """Returns the obstacles that there are in a control step, with what was put there."""
        if self.put is None:
            return self.obstacles
        return self.obstacles._replace(boxes=jnp.concatenate([self.obstacles.boxes, self.put]))


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
        people: Who walks about; None in a lane without people.
        robots: How it met other robots; None in a lane whose robot is alone.
        boxes: Which of those that are put there stand at their places; None in a lane without.
        commands: On their way to the actuators; None in a program without a delay.
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
    people: PeopleState | None = None
    robots: RobotsState | None = None
    boxes: Standing | None = None
    commands: Commands | None = None


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
        control: What the controller decided for the step.
        ranges_m: The scan at the step's beginning, which the control was decided on.
        impulse_ns: What contacts pushed the robot with during the step.
        people_m: Where people are at the step's end; None in a lane without.
        robots_m: Where other robots are then; None in a lane whose robot is alone.
        boxes_m: Where boxes stand in the step; None in a lane without.
    """

    pose: Float[jax.Array, "3"]
    velocity: Float[jax.Array, "3"]
    goal_index: Int[jax.Array, ""]
    control: Float[jax.Array, "actuators"]
    ranges_m: Float[jax.Array, "rays"]
    impulse_ns: Float[jax.Array, ""]
    people_m: Float[jax.Array, "people 2"] | None = None
    robots_m: Float[jax.Array, "robots 2"] | None = None
    boxes_m: Float[jax.Array, "boxes 2"] | None = None


def begin_lane(applications: Applications, inputs: LaneInputs, body: Body) -> LaneState:
    """Returns a lane's state before its first control step."""
    zero, none = jnp.zeros(()), jnp.zeros((), jnp.int32)
    scenario = applications.scenario(inputs.numbers).init(inputs.start, inputs.goals_m, *inputs.given)
    people = None if inputs.people is None else begin_people(inputs.people)
    boxes = None if inputs.boxes is None else begin_boxes(inputs.boxes, inputs.start[:2])
    if inputs.robots is not None:
        inputs = inputs._replace(others=first_others(inputs.robots))
    start = _situation(applications, inputs, body._replace(qpos=inputs.start), none, (people, boxes))
    return LaneState(
        body=body,
        sensed=begin_sensors(applications.sensors, applications.lane_sensors(inputs.numbers), start),
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
        people=people,
        robots=None if inputs.robots is None else begin_robots(inputs.robots, inputs.start),
        boxes=boxes,
    )


def decide(applications: Applications, inputs: LaneInputs, state: LaneState) -> Decision:
    """Returns what the controller keeps, its control for the step to come, and the scan that it saw."""
    observed = observe(applications, inputs, state)
    kept, control = applications.controller(inputs.numbers).step(state.controller, observed)
    return Decision(kept, control, observed.ranges_m)


def observe(applications: Applications, inputs: LaneInputs, state: LaneState) -> Observation:
    """Returns what the robot senses before a control step; without sensors of its pose it knows the true one."""
    own, body = applications.lane_sensors(inputs.numbers), state.body
    situation = _situation(applications, inputs, body, state.step, (state.people, state.boxes))
    sensed: Fields = {"pose": body.qpos, "velocity": body.qvel}
    sensed |= observe_all(applications.sensors, own, state.sensed, situation)
    goal = jnp.clip(state.goal_index, 0, inputs.goals_m.shape[0] - 1)
    pose = sensed["pose"]
    return Observation(
        time_s=state.step * CONTROL_S,
        goal_index=goal,
        goal_m=inputs.goals_m[goal],
        goal_robot_m=rotate(inputs.goals_m[goal] - pose[:2], -pose[2]),
        joints=body.joints,
        **sensed,
    )


def feel(applications: Applications, inputs: LaneInputs, state: LaneState, motion: Motion) -> dict[str, Memory]:
    """Returns what the sensors remember after a control step that an engine drove, by name.

    Args:
        applications: With the sensors.
        inputs: The lane's.
        state: Before the step.
        motion: What the engine made of it.
    """
    own = applications.lane_sensors(inputs.numbers)
    drive = Drive(_situation(applications, inputs, state.body, state.step, (state.people, state.boxes)), motion)
    return feel_all(applications.sensors, own, state.sensed, drive)


def _situation(
    applications: Applications,
    inputs: LaneInputs,
    body: Body,
    step: Int[jax.Array, ""],
    beside: tuple[PeopleState | None, Standing | None],
) -> Situation:
    outlines, scene, (people, boxes) = inputs.lidar_outlines, inputs.scene, beside
    if boxes is not None and inputs.boxes is not None:
        outlines = outlines._replace(boxes=box_outlines(inputs.boxes, boxes, applications.lidar.height_m))
        if scene is not None:
            own = box_scene(inputs.boxes.half_m, box_places_m(inputs.boxes, boxes))
            scene = scene._replace(boxes=jnp.concatenate([scene.boxes, own]))
    if people is not None:
        place_m = people.place_m
        if applications.lidar.height_m < PERSON_HEIGHT_M:
            outlines = outlines._replace(people=people_circles(place_m))
        if scene is not None:
            scene = scene._replace(cylinders=jnp.concatenate([scene.cylinders, people_cylinders(place_m)]))
    if inputs.robots is not None and inputs.others is not None:
        circles = robot_circles(inputs.robots, inputs.others, applications.lidar.height_m)
        before = [] if outlines.people is None else [outlines.people]
        outlines = outlines._replace(people=jnp.concatenate([*before, circles]))
        if scene is not None:
            own = robot_cylinders(inputs.robots, inputs.others.place_m)
            scene = scene._replace(cylinders=jnp.concatenate([scene.cylinders, own]))
    return Situation(body, outlines, inputs.seed, step, scene, inputs.hull_depth_m)


def others_move(mechanics: "Mechanics", inputs: LaneInputs, state: LaneState) -> tuple[LaneInputs, LaneState]:
    """Returns a lane whose people have gone a control step, and whose boxes are there or not, before an engine drives.

    One that is done stays.
    """
    if inputs.boxes is not None and state.boxes is not None:
        boxes = put_boxes(inputs.boxes, state.boxes, state.body, state.step, state.done)
        inputs, state = inputs._replace(put=box_solids(inputs.boxes, boxes)), state._replace(boxes=boxes)
    if inputs.people is None or state.people is None:
        return inputs, state
    everyone = None if inputs.others is None else inputs.others.everyone
    people = go_on(inputs.people, state.people, state.body, state.done, mechanics.hull.radius_m, everyone)
    return inputs._replace(standing_m=people.place_m), state._replace(people=people)


def put_boxes(
    boxes: BoxesInputs, before: Standing, body: Body, step: Int[jax.Array, ""], done: Bool[jax.Array, ""]
) -> Standing:
    """Returns which boxes of a lane are there in a control step; of one that is done those that were."""
    return jnp.where(done, before, boxes_at(boxes, before, body.qpos[:2], step))


def go_on(  # noqa: PLR0917 - a lane, and who else is there
    people: PeopleInputs,
    before: PeopleState,
    body: Body,
    done: Bool[jax.Array, ""],
    hull_radius_m: float,
    everyone: Float[jax.Array, "robots 4"] | None = None,
) -> PeopleState:
    """Returns the people of a lane a control step later; those of one that is done stay where they are.

    Args:
        people: Of the lane.
        before: Before the step.
        body: The lane's robot, likewise.
        done: Whether it is.
        hull_radius_m: Of it, and of all others.
        everyone: All robots of its world, as ``Others.everyone``; None of one that is alone.
    """
    met, collision_s = before.meetings, to_collision_s(before, body, hull_radius_m)
    before = before._replace(meetings=met._replace(collision_s=jnp.minimum(met.collision_s, collision_s)))
    robots = [(body.qpos, body.qvel)] if everyone is None else [(each[:2], each[2:]) for each in everyone]
    gone = walk(people, before, [robot_disc(place_m, velocity, hull_radius_m) for place_m, velocity in robots])
    return jax.tree.map(lambda old, new: jnp.where(done, old, new), before, gone)


# What MuJoCo calls a bad number, finite or not (mjMAXVAL); every engine's lanes end there.
_MOST = 1e10


def finish_step(
    applications: Applications, inputs: LaneInputs, state: LaneState, decided: Decision, motion: Motion
) -> tuple[LaneState, StepRecord]:
    """Returns a lane after a control step that a controller decided and an engine drove.

    A lane that is done stays as it is, bit for bit.

    Args:
        applications: With the scenario and the sensors.
        inputs: The lane's.
        state: Before the step.
        decided: By the controller.
        motion: What the engine made of it.
    """
    body, step = motion.body, state.step + 1
    truth = truth_after(inputs, motion, step)
    scenario_state, verdict = applications.scenario(inputs.numbers).step(state.scenario, truth)
    crash = _crash(decided, body)
    timeout = ~verdict.done & (step >= inputs.last_step)
    broken, robots = crash > 0, _met_others(inputs, state, motion)
    ending = jnp.where(timeout, TIMEOUT, _whose(verdict.reason, motion))
    if inputs.robots is not None and inputs.others is not None and robots is not None:
        ending = with_deadlock(ending, inputs.robots, robots, inputs.others, body.qpos[:2])
    reason = jnp.where(broken, CRASH, ending)
    moved = LaneState(
        body=body,
        sensed=feel(applications, inputs, state, motion),
        controller=decided.controller,
        scenario=scenario_state,
        metrics=applications.metrics(inputs.numbers, scenario_state),
        totals=_totals(state, motion, truth),
        step=step,
        goal_index=verdict.goal_index,
        goal_steps=_goal_steps(state, verdict.goal_index, step),
        done=verdict.done | timeout,
        reason=reason,
        crash=crash,
        people=_met(inputs, state, motion),
        robots=robots,
        boxes=state.boxes,
        commands=None if state.commands is None else sent(state.commands, decided.control),
    )
    # A lane that crashes keeps its last sound state, and says only that it crashed.
    crashed = state._replace(done=jnp.ones((), bool), reason=reason, crash=crash)
    final = _select(state.done, state, _select(crash > 0, crashed, moved))
    record = _record(final, decided, truth.impulse_ns)
    if inputs.boxes is not None and final.boxes is not None:
        record = record._replace(boxes_m=box_places_m(inputs.boxes, final.boxes))
    return final, record


def truth_after(inputs: LaneInputs, motion: Motion, step: Int[jax.Array, ""]) -> Truth:
    """Returns what really happened in a control step.

    Args:
        inputs: The lane's.
        motion: What the engine made of the step.
        step: How many control steps there were with it.
    """
    body, work, apart_m, people, robots_ns = motion
    pushed_ns = work.impulse_ns if people is None else work.impulse_ns + people.impulse_ns
    pushed_ns = pushed_ns if robots_ns is None else pushed_ns + robots_ns
    # Seen from above a hull may lean over an edge that it does not touch: only what pushes it is below 0.
    clearance_m = jnp.where(work.impulse_ns > 0.0, apart_m, jnp.maximum(apart_m, 0.0))
    bounds, place = inputs.floor.bounds_m, body.qpos[:2]
    inside = jnp.all((place >= bounds[:2]) & (place <= bounds[2:]))
    return Truth(step * CONTROL_S, body.qpos, body.qvel, clearance_m, pushed_ns, inside)


def _whose(reason: Int[jax.Array, ""], motion: Motion) -> Int[jax.Array, ""]:
    """Returns the reason of a verdict: a collision in a step in which no solid pushed is one with who did."""
    for movers_ns, theirs in ((motion.robots_ns, ROBOT), (motion.people and motion.people.impulse_ns, PERSON)):
        if movers_ns is not None:
            alone = (movers_ns > 0.0) & (motion.work.impulse_ns <= 0.0)
            reason = jnp.where(alone & (reason == COLLISION), theirs, reason)
    return reason


def _met_others(inputs: LaneInputs, state: LaneState, motion: Motion) -> RobotsState | None:
    """Returns how the robot has met others after a step; how near it came to them is measured when all are there."""
    if state.robots is None or inputs.others is None or motion.robots_ns is None:
        return state.robots
    return meet_others(state.robots, inputs.others, state.body, motion.body, motion.robots_ns)


def _met(inputs: LaneInputs, state: LaneState, motion: Motion) -> PeopleState | None:
    """Returns the people after the robot met them, or did not."""
    if inputs.people is None or state.people is None or motion.people is None:
        return state.people
    return state.people._replace(meetings=meet(inputs.people, state.people, state.body, motion.people))


def _crash(decided: Decision, body: Body) -> Int[jax.Array, ""]:
    """Returns whether a step went wrong, and whose fault it is: a control or a body that is no number."""
    finite_control = jnp.isfinite(decided.control).all()
    sound_body = jnp.stack([(jnp.abs(each) < _MOST).all() for each in jax.tree.leaves((body[:2], body.joints))]).all()
    return jnp.where(~finite_control, ROBOT_CRASH, jnp.where(~sound_body, SIMULATION_CRASH, NO_CRASH))


def _record(final: LaneState, decided: Decision, impulse_ns: Float[jax.Array, ""]) -> StepRecord:
    return StepRecord(
        pose=final.body.qpos,
        velocity=final.body.qvel,
        goal_index=final.goal_index,
        control=decided.control,
        ranges_m=decided.ranges_m,
        impulse_ns=impulse_ns,
        people_m=None if final.people is None else final.people.place_m,
    )


def _totals(state: LaneState, motion: Motion, truth: Truth) -> EpisodeTotals:
    totals, work, touching = state.totals, motion.work, motion.work.impulse_ns > 0.0
    way = motion.body.qpos[:2] - state.body.qpos[:2]
    return EpisodeTotals(
        path_length_m=totals.path_length_m + jnp.sqrt(jnp.sum(way**2)),
        collisions=totals.collisions + (touching & ~totals.touching),
        touching=touching,
        impulse_ns=totals.impulse_ns + truth.impulse_ns,
        max_impulse_ns=jnp.maximum(totals.max_impulse_ns, truth.impulse_ns),
        min_clearance_m=jnp.minimum(totals.min_clearance_m, truth.clearance_m),
        energy_j=totals.energy_j + work.energy_j,
    )


def _goal_steps(state: LaneState, reached: Int[jax.Array, ""], step: Int[jax.Array, ""]) -> Int[jax.Array, "goals"]:
    """Returns after how many steps each goal was reached, those reached in this step filled in."""
    goals = jnp.arange(state.goal_steps.shape[0])
    return jnp.where((goals < reached) & (state.goal_steps == 0), step, state.goal_steps)


def _select(choose: Bool[jax.Array, ""], yes: LaneState, no: LaneState) -> LaneState:
    """Returns one of two states; what is the same array in both, such as a plan, is not touched at all."""

    def pick(a: jax.Array, b: jax.Array) -> jax.Array:
        return a if a is b else jnp.where(choose, a, jnp.asarray(b).astype(jnp.asarray(a).dtype))

    return jax.tree.map(pick, yes, no)


def _nothing(_inputs: LaneInputs, _body: Body) -> None:
    """Returns nothing: most engines look at all obstacles in each step."""


# ``Mechanics`` is the socket that an engine fits in which is a JAX function.
@dataclass(frozen=True, eq=False)
class Mechanics:
    """A robot as an engine steps it, for one lane; the program maps it over lanes.

    Attributes:
        engine: The engine's name.
        actuators: How many numbers a control has.
        rest_control: What they get until something is commanded.
        first_body: Returns the robot at rest at a start (x m, y m, yaw rad).
        drive: Returns what a control step's physics does to it.
        near: Returns what it picks out of the obstacles around a body, for control steps to come (``LaneInputs.near``).
    """

    engine: EngineName
    hull: Hull
    actuators: int
    rest_control: Float[np.ndarray, "actuators"]
    first_body: Callable[[Float[jax.Array, "3"]], Body]
    drive: Callable[[LaneInputs, Body, Float[jax.Array, "actuators"]], Motion]
    near: Callable[[LaneInputs, Body], Any] = _nothing

    def begin(self, applications: Applications, inputs: LaneInputs) -> LaneState:
        """Returns a lane's state before its first control step, the robot at rest."""
        state = begin_lane(applications, inputs, self.first_body(inputs.start))
        if inputs.delay_steps is None:
            return state
        return state._replace(commands=no_commands(self.rest_control))

    def drive_delayed(self, inputs: LaneInputs, state: LaneState, control: Float[jax.Array, "actuators"]) -> Motion:
        """Returns what a control step's physics does to a lane's robot, with the command that reaches it by now."""
        if inputs.delay_steps is not None and state.commands is not None:
            control = delivered(state.commands, control, inputs.delay_steps)
        return self.drive(inputs, state.body, control)


def among_others(inputs: LaneInputs, state: LaneState) -> LaneInputs:
    """Returns the inputs of all lanes, each with how the robots that share its world are."""
    if inputs.robots is None or state.robots is None:
        return inputs
    return inputs._replace(others=others_of(inputs.robots, state.body, state.done, state.robots.still_steps))


def side_by_side(
    inputs: LaneInputs, before: LaneState, after: LaneState, record: StepRecord
) -> tuple[LaneState, StepRecord]:
    """Returns all lanes after a control step, with how near robots came to those that share their worlds.

    Args:
        inputs: Of all lanes.
        before: The lanes before the step; what is said of one that was done stays.
        after: After it.
        record: Of the step.
    """
    if inputs.robots is None or after.robots is None:
        return after, record
    others = others_of(inputs.robots, after.body, after.done, after.robots.still_steps)
    nearest_m = jax.vmap(nearest_yet_m)(inputs.robots, after.robots, after.body, others)
    ended = before.done | (after.crash > 0)
    robots = after.robots._replace(
        least_m=jnp.where(ended, after.robots.least_m, nearest_m),
        place_m=jnp.where(ended[:, None, None], after.robots.place_m, others.place_m),
    )
    return after._replace(robots=robots), record._replace(robots_m=robots.place_m)


def advance_lanes(
    mechanics: Mechanics, applications: Applications, inputs: LaneInputs, state: LaneState
) -> tuple[LaneState, StepRecord]:
    """Returns all lanes one control step later; arguments as of ``advance_lane``, lanes first."""
    step = jax.vmap(functools.partial(advance_lane, mechanics, applications))
    return side_by_side(inputs, state, *step(among_others(inputs, state), state))


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
    inputs, state = others_move(mechanics, inputs, state)
    motion = mechanics.drive_delayed(inputs, state, decided.control)
    return finish_step(applications, inputs, state, decided, motion)
