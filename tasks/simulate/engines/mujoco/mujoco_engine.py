"""The mujoco engine: C MuJoCo on the host's threads among all solids of each lane's world, for any robot.

Sensors, controller and scenario are the same JAX functions as on the other engines, over all lanes at once; between the
two halves of a control step C MuJoCo drives those lanes that are not done. One call finishes a
step and decides the next one.
"""

import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh
from jaxtyping import Array, Bool, Float, Float32

from specs.data.physics import control_delay_steps, physical_factors
from specs.data.world import World
from specs.field_types import EngineName
from tasks.simulate.application.contract import Body, Motion, Observation, PeopleWork, Work, joints_kind
from tasks.simulate.application.robot_model import Hull, rest_control
from tasks.simulate.devices import device_count
from tasks.simulate.engines.mujoco.world_stepper import (
    HostBody,
    HostRobot,
    HostWork,
    Stepper,
    host_robot,
    varied_model,
    world_models,
)
from tasks.simulate.engines.program import (
    LaneTransfer,
    lane_mesh,
    lane_sharding,
    padded_lanes,
    put_lanes,
    split_over,
    stacked_records,
    strong_types,
    with_stand_in,
)
from tasks.simulate.engines.program_cache import ProgramCache, open_program_cache
from tasks.simulate.engines.pytree_schema import flatten_state, unflatten_state
from tasks.simulate.geometry.hull_distance import hull_distance_m, hull_to_people_m
from tasks.simulate.host.controllers import (
    HostApplication,
    HostControllers,
    HostStart,
    asked_controls,
    placed_poses,
)
from tasks.simulate.lane.chunk_applications import Applications
from tasks.simulate.lane.control_delay import HostCommands
from tasks.simulate.lane.control_step import (
    Decision,
    LaneInputs,
    LaneState,
    StepRecord,
    begin_lane,
    decide,
    finish_step,
    go_on,
    observe,
    put_boxes,
)
from tasks.simulate.lane.lane_boxes import BoxesInputs, Standing, box_places_m, box_solids
from tasks.simulate.lane.staging import Lane
from tasks.simulate.lane.walkers import PeopleInputs, PeopleState
from tasks.simulate.plan.chunks import SLICE_STEPS

# Of a lane, as one row of numbers: what was driven, and what the host needs of it: each array more that goes from the
# host to JAX, or back, costs a tenth of a millisecond, whatever the number of lanes.
Row = Float[Array, "numbers"]
# So few lanes on a device cost little more than none: what a step costs then is to hand it to one device more.
_LANES_A_DEVICE = 32
# Of a finished row: pose, velocity, the goal's index, the impulse, and whether the lane is done; the scan follows.
_SETTLED = 9
# Those parts of a controller's state that a step changed, by place: what it hands on, such as a plan, stays put.
Changed = dict[int, Array]
# What the controllers changed, their controls, and the scans that they saw, lanes first.
Decided = tuple[Changed, Float[Array, "lanes actuators"], Float[Array, "lanes rays"]]


@dataclass(frozen=True, eq=False)
class HostProgram:
    """A robot and its applications on C MuJoCo; see ``tasks.simulate.engines.program.Program``.

    Attributes:
        begin: Returns the lanes' state before the first control step.
        sense: Returns what the robots sense, for controllers that are plain Python.
        decide: Returns what the controllers change of their states, their controls, and what they saw.
        finish: Returns the lanes after a control step that was decided and driven, and what is recorded of it; the
            state given is used up.
        walk: Returns the people a control step later, who then stand while robots are driven.
        put: Returns which boxes are there then, and where.
        step: Returns what ``finish`` does, and what is decided then, all that the host needs of both as one array; what
            it is given of either is used up.
        cache: Of the functions, for processes to come.
        host: The robot application, if it runs on the host.
    """

    robot: HostRobot
    applications: Applications
    lanes: int
    threads: int
    mesh: Mesh
    begin: Callable[[LaneInputs, Body], LaneState]
    sense: Callable[[LaneInputs, LaneState], Observation]
    decide: Callable[[LaneInputs, LaneState], Decided]
    finish: Callable[[LaneInputs, LaneState, Decided, Float[Array, "lanes numbers"]], tuple[LaneState, jax.Array]]
    step: Callable[
        [LaneInputs, LaneState, Decided, Float[Array, "lanes numbers"]], tuple[LaneState, Decided, jax.Array]
    ]
    walk: Callable[[PeopleInputs, PeopleState, Body, jax.Array], PeopleState]
    put: Callable[[BoxesInputs, Standing, Body, jax.Array, jax.Array], tuple[Standing, jax.Array]]
    cache: ProgramCache
    host: HostApplication | None
    engine: EngineName = "mujoco"

    @property
    def hull(self) -> Hull:
        """Returns the robot's hull."""
        return self.robot.hull

    @property
    def actuators(self) -> int:
        """Returns how many numbers a control has."""
        return self.robot.actuators

    def body(self) -> Body:
        """Returns a robot at rest, to check applications with."""
        stepper = Stepper(self.robot, [self.robot.alone], np.zeros((1, 3)), 1)
        return _body(self.robot, jax.tree.map(lambda array: array[0], stepper.body()))

    def ready(self, inputs: LaneInputs, lanes: Sequence[Lane], worlds: Mapping[str, World]) -> "HostRun":
        """Returns episodes ready to run."""
        people = 0 if inputs.people is None else inputs.people.there.shape[1]
        boxes = tuple(box.size_m for box in lanes[0].request.boxes or ())
        used = {lane.request.world: worlds[lane.request.world] for lane in lanes}
        models = world_models(self.robot, used, people, boxes)
        filled = [*lanes, *[lanes[0]] * (self.lanes - len(lanes))]
        each = [varied_model(models[lane.request.world], physical_factors(lane.request.environment)) for lane in filled]
        stepper = Stepper(self.robot, each, np.asarray(inputs.start), self.threads, boxes)
        controllers = None
        if self.host is not None:
            start = HostStart(lanes, self.lanes, self.actuators, self.applications.sensors, worlds)
            controllers = self.host.start(start)
        commands, delays = None, [control_delay_steps(lane.request.environment) for lane in filled]
        if inputs.delay_steps is not None:
            commands = HostCommands(rest_control(self.robot.alone), [steps or 0 for steps in delays])
        return HostRun(self, put_lanes(self.mesh, inputs), stepper, controllers, LaneTransfer(self.mesh), commands)


@dataclass(eq=False)
class HostRun:
    """Episodes on C MuJoCo; see ``tasks.simulate.engines.program.Run``. It runs once."""

    program: HostProgram
    inputs: LaneInputs
    stepper: Stepper
    host: HostControllers | None
    transfer: LaneTransfer
    commands: HostCommands | None = None
    _ahead: tuple[Decided, Float[np.ndarray, "lanes actuators"]] | None = None

    def begin(self) -> LaneState:
        """Returns the lanes before the first control step."""
        return self.program.begin(self.inputs, _body(self.program.robot, self.stepper.body()))

    def advance(self, state: LaneState) -> tuple[LaneState, StepRecord]:
        """Returns the lanes a slice later, or when all are done, and the records up to then."""
        records: list[StepRecord] = []
        moving = ~self._fetched(state.done)
        while len(records) < SLICE_STEPS:
            if records and not moving.any():
                break
            decided, controls = self._decided(state, moving)
            if self.host is not None and (poses := placed_poses(self.host, len(moving))) is not None:
                state = self._placed(state, poses)
            state, people_m = self._walked(state)
            state, boxes_m = self._put(state)
            arrived = controls if self.commands is None else self.commands.deliver(controls)
            done = self.stepper.drive(arrived, moving, people_m, boxes_m)
            driven = self.transfer.put(_driven_rows(*done, people_m))
            state, rows = self._settled(state, decided, driven)
            moving = rows[:, _SETTLED - 1] == 0.0
            records.append(_record(rows, controls, people_m, boxes_m))
        return state, stacked_records(records)

    def _decided(
        self, state: LaneState, moving: Bool[np.ndarray, "lanes"]
    ) -> tuple[Decided, Float[np.ndarray, "lanes actuators"]]:
        if self._ahead is not None:
            return self._ahead
        if self.host is None:
            decided = self.program.decide(self.inputs, state)
            return decided, self._fetched(decided[1])
        observed = jax.tree.map(np.asarray, self.program.sense(self.inputs, state))
        controls = asked_controls(self.host, observed, moving, lambda: np.asarray(state.body.qpos))
        return ({}, self.transfer.put(controls), self.transfer.put(observed.ranges_m)), controls

    def _placed(self, state: LaneState, poses: Float32[np.ndarray, "lanes 3"]) -> LaneState:
        """Returns the lanes with robots at rest where they are set; those set nowhere (not a number) stay."""
        chosen = np.isfinite(poses).all(axis=1)
        self.stepper.place(np.flatnonzero(chosen), poses[chosen])

        def pick(new: jax.Array, old: jax.Array) -> jax.Array:
            return jnp.where(chosen.reshape(-1, *[1] * (old.ndim - 1)), new, old)

        return state._replace(body=jax.tree.map(pick, _body(self.program.robot, self.stepper.body()), state.body))

    def _walked(self, state: LaneState) -> tuple[LaneState, Float32[np.ndarray, "lanes people 2"] | None]:
        """Returns the lanes whose people have gone a control step, and where they stand; None in lanes without."""
        if self.inputs.people is None or state.people is None:
            return state, None
        people = self.program.walk(self.inputs.people, state.people, state.body, state.done)
        return state._replace(people=people), self._fetched(people.place_m)

    def _put(self, state: LaneState) -> tuple[LaneState, Float32[np.ndarray, "lanes boxes 2"] | None]:
        """Returns the lanes with the boxes that are there now, and where those stand; None in lanes without."""
        if self.inputs.boxes is None or state.boxes is None:
            return state, None
        boxes, place_m = self.program.put(self.inputs.boxes, state.boxes, state.body, state.step, state.done)
        return state._replace(boxes=boxes), self._fetched(place_m)

    def _settled(
        self, state: LaneState, decided: Decided, driven: jax.Array
    ) -> tuple[LaneState, Float32[np.ndarray, "lanes numbers"]]:
        """Returns the lanes after a control step, and what is recorded of it; what comes next is decided as well."""
        if self.host is not None:
            state, finished = self.program.finish(self.inputs, state, decided, driven)
            return state, self._fetched(finished)
        state, after, together = self.program.step(self.inputs, state, decided, driven)
        rows, actuators = self._fetched(together), self.program.actuators
        self._ahead = after, rows[:, rows.shape[1] - actuators :]
        return state, rows[:, : rows.shape[1] - actuators]

    def _fetched(self, array: jax.Array) -> np.ndarray:
        return np.concatenate(self.transfer.fetch(array))


def host_program(
    path: Path,
    applications: Applications,
    lanes: int,
    host: HostApplication | None = None,
    *,
    threads: int | None = None,
) -> HostProgram:
    """Returns the program of a robot and its applications; compiles nothing yet.

    Args:
        path: The ``robot.xml``.
        applications: The robot application and the scenario.
        lanes: At least so many.
        host: The robot application, if it runs on the host.
        threads: To step robots on; one for each core if None.

    Raises:
        RobotRefused: It does not load, or cannot be driven about.
    """
    robot, mesh = host_robot(path), lane_mesh(most=-(-lanes // _LANES_A_DEVICE))
    seen = with_stand_in(applications, robot.actuators, host=host is not None)
    cache = open_program_cache(lane_sharding(mesh), seen, "mujoco", host=host is not None)

    def split(name: str, kernel: Callable[..., object], arguments: int) -> Callable[..., Any]:
        return cache.cached(name, split_over(mesh, jax.vmap(functools.partial(kernel, seen)), arguments))

    walk = jax.vmap(functools.partial(go_on, hull_radius_m=robot.hull.radius_m))
    return HostProgram(
        robot=robot,
        applications=seen,
        lanes=padded_lanes(lanes, mesh.size),
        threads=threads or device_count(),
        mesh=mesh,
        begin=jax.jit(split("begin", _begin_lane, 2)),
        sense=jax.jit(split("sense", observe, 2)),
        decide=jax.jit(split("decide", _decide_lane, 2)),
        finish=jax.jit(split("finish", functools.partial(_finish_lane, robot), 4), donate_argnums=1),
        walk=jax.jit(cache.cached("walk", split_over(mesh, walk, 4))),
        put=jax.jit(cache.cached("put", split_over(mesh, jax.vmap(_put_lane), 5))),
        step=jax.jit(split("step", functools.partial(_step_lane, robot), 4), donate_argnums=(1, 2)),
        cache=cache,
        host=host,
    )


def _put_lane(
    boxes: BoxesInputs, before: Standing, body: Body, step: jax.Array, done: jax.Array
) -> tuple[Standing, Float[Array, "boxes 2"]]:
    after = put_boxes(boxes, before, body, step, done)
    return after, box_places_m(boxes, after)


def _begin_lane(applications: Applications, inputs: LaneInputs, body: Body) -> LaneState:
    return flatten_state(strong_types(begin_lane(applications, inputs, body)))


def _decide_lane(applications: Applications, inputs: LaneInputs, state: LaneState) -> Decided:
    state = unflatten_state(applications, inputs, state)
    after, control, ranges_m = decide(applications, inputs, state)
    before = jax.tree.leaves(state.controller)
    changed = {place: leaf for place, leaf in enumerate(jax.tree.leaves(after)) if leaf is not before[place]}
    return changed, control, ranges_m


def _finish_lane(  # noqa: PLR0917 - as the program maps it
    robot: HostRobot, applications: Applications, inputs: LaneInputs, state: LaneState, decided: Decided, driven: Row
) -> tuple[LaneState, Row]:
    changed, control, ranges_m = decided
    state = unflatten_state(applications, inputs, state)
    body, work, people_ns = _from_row(robot, driven)
    if inputs.boxes is not None and state.boxes is not None:
        inputs = inputs._replace(put=box_solids(inputs.boxes, state.boxes))
    clearance_m = hull_distance_m(robot.parts, inputs.solids, body.qpos)
    met = None
    if state.people is not None:
        met = PeopleWork(people_ns[0], hull_to_people_m(robot.parts, state.people.place_m, body.qpos))
    leaves, form = jax.tree.flatten(state.controller)
    memory = jax.tree.unflatten(form, [changed.get(place, leaf) for place, leaf in enumerate(leaves)])
    decision = Decision(memory, control, ranges_m)
    after, record = finish_step(applications, inputs, state, decision, Motion(body, work, clearance_m, met))
    numbers = (record.pose, record.velocity, record.goal_index, record.impulse_ns, after.done, record.ranges_m)
    return flatten_state(after), jnp.concatenate([jnp.ravel(each).astype(jnp.float32) for each in numbers])


def _step_lane(  # noqa: PLR0917 - as the program maps it
    robot: HostRobot, applications: Applications, inputs: LaneInputs, state: LaneState, decided: Decided, driven: Row
) -> tuple[LaneState, Decided, Row]:
    after, finished = _finish_lane(robot, applications, inputs, state, decided, driven)
    following = _decide_lane(applications, inputs, after)
    return after, following, jnp.concatenate([finished, following[1].astype(jnp.float32)])


def _driven_rows(
    body: HostBody, work: HostWork, people_m: Float32[np.ndarray, "lanes people 2"] | None
) -> Float32[np.ndarray, "lanes numbers"]:
    joints = body.joints or ()
    done = (work.impulse_ns[:, None], work.push_ns, work.energy_j[:, None])
    alive = () if people_m is None else (work.people_ns[:, None],)
    return np.concatenate([*body[:3], *joints, *done, *alive], axis=1)


def _from_row(robot: HostRobot, row: Row) -> tuple[Body, Work, Float[Array, "alive"]]:
    """Returns what a row of ``_driven_rows`` tells, what people pushed with last: nothing in lanes without."""
    model, articulated = robot.alone, robot.base.articulated
    sizes = [3, 3, model.na, *((model.nq, model.nv) if articulated else ()), 1, 2, 1]
    pose, velocity, act, *joints, impulse, push, energy, people_ns = jnp.split(row, np.cumsum(sizes))
    kind = joints_kind(free=robot.base.free)
    body = Body(pose, velocity, act, jnp.zeros(0), kind(*joints) if articulated else None)
    return body, Work(impulse[0], push, energy[0]), people_ns


def _record(
    rows: Float32[np.ndarray, "lanes numbers"],
    controls: Float[np.ndarray, "lanes actuators"],
    people_m: Float32[np.ndarray, "lanes people 2"] | None,
    boxes_m: Float32[np.ndarray, "lanes boxes 2"] | None,
) -> StepRecord:
    found: Any = rows  # a record's arrays are NumPy's on the host
    given: Any = controls
    standing: Any = people_m
    put: Any = boxes_m
    return StepRecord(
        pose=found[:, :3],
        velocity=found[:, 3:6],
        goal_index=found[:, 6].astype(np.int32),
        control=given,
        ranges_m=found[:, _SETTLED:],
        impulse_ns=found[:, 7],
        people_m=standing,
        boxes_m=put,
    )


def _body(robot: HostRobot, host: HostBody) -> Body:
    joints = None if host.joints is None else joints_kind(free=robot.base.free)(*_arrays(host.joints))
    pose, velocity, act, warmstart = _arrays((*host[:3], np.zeros((*host.qpos.shape[:-1], 0), np.float32)))
    return Body(pose, velocity, act, warmstart, joints)


def _arrays(host: Iterable[np.ndarray]) -> tuple[jax.Array, ...]:
    return tuple(jnp.asarray(array) for array in host)
