"""The compiled program of a chunk: all lanes, split over the host's devices, a slice of control steps at a time.

Lanes whose episodes are done get others while the rest goes on. For controllers that run on the host the program is
driven a control step at a time. One call drives what was decided, settles, and senses for the next step. What the host
needs of it, for controllers and for records, comes as one array, and the lanes go in and out as a few: each array more
costs microseconds, and fetched by itself it costs as much as the physics
(docs/decisions/0025-controllers-on-the-host.md).
"""

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh
from jaxtyping import Bool, Float, Float32, Int

from specs.data.world import World
from specs.field_types import EngineName
from tasks.simulate.application.contract import Body, Observation
from tasks.simulate.application.robot_model import Hull
from tasks.simulate.engines.program import (
    LaneTransfer,
    PackedLanes,
    lane_mesh,
    lane_sharding,
    pack_lane,
    padded_lanes,
    put_lanes,
    split_over,
    strong_types,
    unpack_lane,
    with_stand_in,
)
from tasks.simulate.engines.program_cache import ProgramCache, open_program_cache
from tasks.simulate.engines.pytree_schema import flatten_state, one_lane, unflatten_state
from tasks.simulate.geometry.lidar_scan import LidarOutlines, within_range
from tasks.simulate.host.controllers import (
    HostApplication,
    HostControllers,
    HostStart,
    asked_controls,
    placed_poses,
)
from tasks.simulate.lane.chunk_applications import Applications
from tasks.simulate.lane.control_step import (
    Decision,
    LaneInputs,
    LaneState,
    Mechanics,
    StepRecord,
    advance_lanes,
    among_others,
    finish_step,
    observe,
    others_move,
    side_by_side,
)
from tasks.simulate.lane.lane_boxes import box_places_m
from tasks.simulate.lane.staging import Lane
from tasks.simulate.plan.chunks import SLICE_STEPS

# Of a device's lanes, so many begin together. Fewer rest less, and cost more calls.
_SHARE = 8
_LANES_A_VECTOR = 8
Places = Int[jax.Array, "fresh"]
Occupied = tuple[LaneInputs, LaneState]


# A few lanes are begun together, in a program of as many, and written over what was in lanes that are free: the
# others are not touched. What a lane begins with does not depend on how many begin beside it
# (docs/decisions/0004-lanes-a-multiple-of-eight.md), so neither does its row
# (docs/decisions/0038-lanes-that-are-refilled.md).
class LaneRefill(NamedTuple):
    """How a program's lanes are filled.

    Attributes:
        together: So many lanes of each device begin together.
        blank: Returns what all lanes hold before any was filled, for the inputs of those that are filled first.
        spread: Returns lanes of which only the first on each device were filled: the others rest, and repeat those.
        fill: Returns inputs and state of all lanes, those at the places filled anew. Places are counted on each device
            from 0; one beyond its lanes drops what was meant for it. What was given of the lanes is used up.
    """

    together: int
    blank: Callable[[LaneInputs], Occupied]
    fill: Callable[[LaneInputs, LaneState, LaneInputs, Places], Occupied]
    spread: Callable[[LaneInputs, LaneState], Occupied]


def lane_refill(mesh: Mesh, lanes: int, begin: Callable[[LaneInputs], LaneState], cache: ProgramCache) -> LaneRefill:
    """Returns how lanes are filled; compiles nothing yet.

    Args:
        mesh: The devices.
        lanes: Of the program, on all devices.
        begin: Returns the state of one device's lanes before their first control step.
        cache: Of the program's functions.
    """

    def fill(inputs: LaneInputs, state: LaneState, fresh: LaneInputs, places: Places) -> Occupied:
        new = (fresh, begin(fresh))
        return jax.tree.map(lambda old, some: old.at[places].set(some, mode="drop"), (inputs, state), new)

    together = lanes_together(lanes // mesh.size)
    begun = jax.jit(cache.cached("begin", split_over(mesh, begin, 1)))

    def blank(fresh: LaneInputs) -> Occupied:
        forms = (fresh, jax.eval_shape(begun, fresh))
        # Of NumPy: those of JAX are compiled, for each shape.
        zeros = jax.tree.map(lambda form: np.zeros((lanes, *form.shape[1:]), form.dtype), forms)
        return jax.device_put(zeros, lane_sharding(mesh))

    def spread(inputs: LaneInputs, state: LaneState) -> Occupied:
        every = jnp.arange(state.done.shape[0])
        inputs, state = jax.tree.map(lambda array: array[every % together], (inputs, state))
        return inputs, state._replace(done=state.done | (every >= together))

    return LaneRefill(
        together=together,
        blank=blank,
        fill=jax.jit(cache.cached("fill", split_over(mesh, fill, 4)), donate_argnums=(0, 1)),
        spread=jax.jit(cache.cached("spread", split_over(mesh, spread, 2))),
    )


def lanes_together(lanes: int) -> int:
    """Returns how many lanes of a device that has so many begin together: whole vectors, as all programs have."""
    return -(-max(1, lanes // _SHARE) // _LANES_A_VECTOR) * _LANES_A_VECTOR


# What a robot senses, whether its lane is done, and what is recorded of a step, as one row of numbers: the scan first.
Row = Float[jax.Array, "numbers"]
Rows = Float32[np.ndarray, "lanes numbers"]
PackedInputs = PackedLanes[LaneInputs]
PackedState = PackedLanes[LaneState]
# Of what a row tells a record: the pose, the velocity, the goal's index and the impulse; people, other robots and boxes
# follow.
_RECORDED = 8


class StepwiseCalls(NamedTuple):
    """The compiled functions of a program whose controllers run on the host.

    Attributes:
        begin: Returns the state before the first control step.
        observe: Returns what the robots sense; only its form is asked for.
        sense: Returns the same as rows of numbers.
        pack_inputs, pack: Return inputs and a state as a few arrays.
        step: Returns the state a control step later that the host decided, and what the robots sense then, with what is
            recorded; the state that was given is used up.
        unpack: Returns the state.
        place: Returns the state with robots at rest where they are set; those set nowhere (not a number) stay. What was
            given is used up.
    """

    begin: Callable[[LaneInputs], LaneState]
    observe: Callable[[LaneInputs, LaneState], Observation]
    sense: Callable[[LaneInputs, LaneState], Float[jax.Array, "lanes numbers"]]
    pack_inputs: Callable[[LaneInputs], PackedInputs]
    pack: Callable[[LaneState], PackedState]
    step: Callable[..., tuple[PackedState, Float[jax.Array, "lanes numbers"]]]
    unpack: Callable[[PackedState], LaneState]
    place: Callable[[PackedState, jax.Array], PackedState]


class StepwiseRun:
    """Episodes whose controllers run on the host; see ``tasks.simulate.engines.program.Run``. It runs once."""

    def __init__(
        self, calls: StepwiseCalls, mesh: Mesh, inputs: LaneInputs, host: HostControllers, actuators: int
    ) -> None:
        self.host, self._actuators = host, actuators
        self._calls, self._transfer = calls, LaneTransfer(mesh)
        self._inputs: Any = inputs  # packed, once it has begun
        self._poses = np.asarray(inputs.start)
        people, robots = inputs.people, inputs.robots
        self._people = None if people is None else (people.there.shape[1], 2)
        self._robots = None if robots is None else (robots.radius_m.shape[1], 2)
        self._boxes = None if inputs.boxes is None else (inputs.boxes.touched.shape[1], 2)

    def begin(self) -> LaneState:
        """Returns the lanes before the first control step."""
        state = self._calls.begin(self._inputs)
        self._columns = SensedColumns(jax.eval_shape(self._calls.observe, self._inputs, state))
        self._rows = self._fetched(self._calls.sense(self._inputs, state))
        self._inputs = self._calls.pack_inputs(self._inputs)
        return state

    def advance(self, state: LaneState) -> tuple[LaneState, StepRecord]:
        """Returns the lanes a slice later, or when all are done, and the records up to then."""
        lanes = len(self._rows)
        movers = (self._people, self._robots, self._boxes)
        sizes = [(3,), (3,), (), (self._actuators,), (self._columns.rays,), (), *movers]
        blank: list[Any] = [
            None if size is None else np.empty((lanes, SLICE_STEPS, *size), np.float32) for size in sizes
        ]
        blank[2] = np.empty((lanes, SLICE_STEPS), np.int32)
        packed, record, steps = self._calls.pack(state), StepRecord(*blank), 0
        while steps < SLICE_STEPS:
            observed, done = self._columns.observed(self._rows), self._columns.done(self._rows)
            if steps and done.all():
                break
            controls = asked_controls(self.host, observed, ~done, lambda: self._poses)
            if (poses := placed_poses(self.host, lanes)) is not None:
                packed = self._calls.place(packed, self._transfer.put(poses))
            packed, after = self._calls.step(self._inputs, packed, self._transfer.put(controls))
            self._rows = self._fetched(after)
            recorded = self._rows[:, -_RECORDED - sum(math.prod(size) for size in movers if size) :]
            self._poses = recorded[:, :3]
            _keep(record, steps, observed, controls, recorded)
            steps += 1
        return self._calls.unpack(packed), jax.tree.map(lambda array: array[:, :steps], record)

    def _fetched(self, rows: jax.Array) -> Rows:
        return np.concatenate(self._transfer.fetch(rows))


class SensedColumns:
    """Where in rows of numbers, as ``sense_lanes`` makes them, what robots sense stands.

    Attributes:
        rays: Of the scan.
    """

    def __init__(self, form: Observation) -> None:
        """Makes it.

        Args:
            form: The shapes and types of the observation, lanes first.
        """
        scan, others = _scan_first(form)
        self.rays, self._structure = scan.shape[1], jax.tree.structure(form._replace(ranges_m=None))
        self._fields: list[tuple[slice, tuple[int, ...], np.dtype[np.generic]]] = []
        place = self.rays + 1
        for each in others:
            size = math.prod(each.shape[1:])
            self._fields.append((slice(place, place + size), each.shape, np.dtype(each.dtype)))
            place += size

    def observed(self, rows: Rows) -> Observation:
        """Returns what all robots sense."""
        fields = [rows[:, columns].astype(dtype, copy=False).reshape(shape) for columns, shape, dtype in self._fields]
        return jax.tree.unflatten(self._structure, fields)._replace(ranges_m=rows[:, : self.rays])

    def done(self, rows: Rows) -> Bool[np.ndarray, "lanes"]:
        """Returns which lanes are done."""
        return rows[:, self.rays] > 0


def step_lanes(
    mechanics: Mechanics,
    applications: Applications,
    packed_inputs: PackedInputs,
    packed: PackedState,
    control: Float[jax.Array, "lanes actuators"],
) -> tuple[PackedState, Float[jax.Array, "lanes numbers"]]:
    """Returns all lanes a control step later that the host decided, and what is sensed then and recorded of them."""
    inputs = jax.vmap(unpack_lane)(packed_inputs)
    before = unflatten_state(applications, one_lane(inputs), jax.vmap(unpack_lane)(packed))

    def step(own: LaneInputs, state: LaneState, control: Float[jax.Array, "actuators"]) -> tuple[LaneState, StepRecord]:
        # The host has the scan that the controller saw, for the record.
        decided = Decision(state.controller, control, jnp.zeros(0))
        own, walked = others_move(mechanics, own, state)
        return finish_step(applications, own, walked, decided, mechanics.drive_delayed(own, walked, control))

    state, record = side_by_side(inputs, before, *jax.vmap(step)(among_others(inputs, before), before, control))
    movers_m = (record.people_m, record.robots_m, record.boxes_m)
    recorded = (record.pose, record.velocity, record.goal_index, record.impulse_ns, *movers_m)
    numbers = [sense_lanes(applications, inputs, state), *map(jax.vmap(_numbers), jax.tree.leaves(recorded))]
    return jax.vmap(pack_lane)(flatten_state(state)), jnp.concatenate(numbers, axis=1)


def sense_lanes(applications: Applications, inputs: LaneInputs, state: LaneState) -> Float[jax.Array, "lanes numbers"]:
    """Returns what lanes' robots sense, and whether each lane is done, as one row of numbers each."""

    def sense(own: LaneInputs, state: LaneState) -> Row:
        ranges_m, others = _scan_first(observe(applications, own, state))
        return jnp.concatenate([_numbers(each) for each in (ranges_m, state.done, *others)])

    return jax.vmap(sense)(among_others(inputs, state), state)


def _keep(record: Any, step: int, observed: Observation, controls: Rows, recorded: Rows) -> None:  # noqa: ANN401 - a StepRecord in NumPy
    record.pose[:, step], record.velocity[:, step] = recorded[:, :3], recorded[:, 3:6]
    record.goal_index[:, step], record.impulse_ns[:, step] = recorded[:, 6], recorded[:, 7]
    record.control[:, step], record.ranges_m[:, step] = controls, observed.ranges_m
    place = _RECORDED
    for movers_m in (record.people_m, record.robots_m, record.boxes_m):
        if movers_m is not None:
            now = movers_m[:, step]
            size = now[0].size
            now[:] = recorded[:, place : place + size].reshape(now.shape)
            place += size


def _numbers(array: jax.Array) -> Row:
    return jnp.ravel(array).astype(jnp.float32)


def _scan_first(observed: Observation) -> tuple[jax.Array, list[jax.Array]]:
    return observed.ranges_m, jax.tree.leaves(observed._replace(ranges_m=None))


@dataclass(frozen=True, eq=False)
class CompiledProgram:
    """A robot and its applications, compiled for a lane count; see ``tasks.simulate.engines.program.Program``.

    Attributes:
        begin: Returns the state before the first control step.
        advance: Returns the state a slice later, and the records of the slice, (lanes, steps) first; the state that
            was given is used up.
        stepwise: The functions for a robot application that runs on the host.
        cache: Of the functions, for processes to come.
        refill: Puts episodes into lanes that are free.
        host: The robot application, if it runs on the host.
    """

    mechanics: Mechanics
    applications: Applications
    lanes: int
    mesh: Mesh
    begin: Callable[[LaneInputs], LaneState]
    advance: Callable[[LaneInputs, LaneState], tuple[LaneState, StepRecord]]
    stepwise: StepwiseCalls
    cache: ProgramCache
    refill: LaneRefill
    host: HostApplication | None = None

    @property
    def engine(self) -> EngineName:
        """Returns the engine's name."""
        return self.mechanics.engine

    @property
    def hull(self) -> Hull:
        """Returns the robot's hull."""
        return self.mechanics.hull

    @property
    def actuators(self) -> int:
        """Returns how many numbers a control has."""
        return self.mechanics.actuators

    def body(self) -> Body:
        """Returns a robot at rest, to check applications with."""
        return self.mechanics.first_body(jnp.zeros(3))

    def ready(
        self,
        inputs: LaneInputs,
        lanes: Sequence[Lane],
        worlds: Mapping[str, World],
    ) -> "CompiledRun | StepwiseRun":
        """Returns episodes ready to run."""
        put = put_lanes(self.mesh, inputs)
        if self.host is None:
            return CompiledRun(self, put)
        start = HostStart(lanes, self.lanes, self.actuators, self.applications.sensors, worlds)
        return StepwiseRun(self.stepwise, self.mesh, put, self.host.start(start), self.actuators)


@dataclass(frozen=True, eq=False)
class CompiledRun:
    """Episodes of a compiled program; see ``tasks.simulate.engines.program.Run``."""

    program: CompiledProgram
    inputs: LaneInputs
    host: HostControllers | None = None

    def begin(self) -> LaneState:
        """Returns the lanes before the first control step."""
        return self.program.begin(self.inputs)

    def advance(self, state: LaneState) -> tuple[LaneState, StepRecord]:
        """Returns the lanes a slice later, and the slice's records."""
        return self.program.advance(self.inputs, state)


def compiled_program(
    mechanics: Mechanics, applications: Applications, lanes: int, host: HostApplication | None = None
) -> CompiledProgram:
    """Returns the program of a robot and its applications; compiles nothing yet.

    Args:
        mechanics: The robot on an engine.
        applications: The robot application and the scenario.
        lanes: At least so many.
        host: The robot application, if it runs on the host.
    """
    mesh = lane_mesh()
    seen = with_stand_in(applications, mechanics.actuators, host=host is not None)
    cache = open_program_cache(lane_sharding(mesh), seen, mechanics.engine, host=host is not None)
    begin_lanes, whole = jax.vmap(functools.partial(_begin_lane, mechanics, seen)), padded_lanes(lanes, mesh.size)
    begin = jax.jit(cache.cached("begin", split_over(mesh, begin_lanes, 1)))
    advance = split_over(mesh, functools.partial(_advance_slice, mechanics, seen), 2)
    return CompiledProgram(
        mechanics=mechanics,
        applications=seen,
        lanes=whole,
        mesh=mesh,
        begin=begin,
        advance=jax.jit(cache.cached("advance", advance), donate_argnums=1),
        cache=cache,
        stepwise=_stepwise_calls(mechanics, seen, mesh, begin),
        refill=lane_refill(mesh, whole, begin_lanes, cache),
        host=host,
    )


def _stepwise_calls(
    mechanics: Mechanics, applications: Applications, mesh: Mesh, begin: Callable[[LaneInputs], LaneState]
) -> StepwiseCalls:
    step = functools.partial(step_lanes, mechanics, applications)
    pack = jax.jit(split_over(mesh, jax.vmap(pack_lane), 1))
    return StepwiseCalls(
        begin=begin,
        observe=jax.vmap(functools.partial(observe, applications)),
        sense=jax.jit(split_over(mesh, functools.partial(sense_lanes, applications), 2)),
        pack_inputs=pack,
        pack=pack,
        step=jax.jit(split_over(mesh, step, 3), donate_argnums=1),
        unpack=jax.jit(split_over(mesh, jax.vmap(unpack_lane), 1)),
        place=jax.jit(split_over(mesh, jax.vmap(functools.partial(_place_lane, mechanics)), 2), donate_argnums=0),
    )


def _place_lane(mechanics: Mechanics, packed: PackedState, pose: Float[jax.Array, "3"]) -> PackedState:
    """Returns a lane whose robot is at rest at a pose, if that is one."""
    state, chosen = unpack_lane(packed), jnp.isfinite(pose).all()
    first = mechanics.first_body(pose)
    body = jax.tree.map(lambda new, old: jnp.where(chosen, new, old).astype(old.dtype), first, state.body)
    return pack_lane(state._replace(body=body))


def _begin_lane(mechanics: Mechanics, applications: Applications, inputs: LaneInputs) -> LaneState:
    return flatten_state(strong_types(mechanics.begin(applications, inputs)))


def _near(
    mechanics: Mechanics, applications: Applications, inputs: LaneInputs, body: Body
) -> tuple[Any, LidarOutlines]:
    """Returns what a lane looks at in a slice: obstacles to touch, and outlines to see."""
    outlines = within_range(inputs.lidar_outlines, body.qpos[:2], applications.lidar.range_m)
    return mechanics.near(inputs, body), outlines


def _standing_m(inputs: LaneInputs, lanes: LaneState) -> Float[jax.Array, "lanes boxes 2"] | None:
    """Returns where boxes are in all lanes; None in lanes without."""
    if inputs.boxes is None or lanes.boxes is None:
        return None
    return jax.vmap(box_places_m)(inputs.boxes, lanes.boxes)


def _advance_slice(
    mechanics: Mechanics, applications: Applications, inputs: LaneInputs, state: LaneState
) -> tuple[LaneState, StepRecord]:
    """Returns one device's lanes a slice later; a device whose lanes are all done does nothing."""
    control_step = functools.partial(advance_lanes, mechanics, applications)

    def run(lanes: LaneState) -> tuple[LaneState, StepRecord]:
        lanes = unflatten_state(applications, one_lane(inputs), lanes)
        near, seen = jax.vmap(functools.partial(_near, mechanics, applications))(inputs, lanes.body)
        around = inputs._replace(near=near, lidar_outlines=seen)
        lanes, records = jax.lax.scan(lambda s, _: control_step(around, s), lanes, None, length=SLICE_STEPS)
        return flatten_state(lanes), jax.tree.map(lambda array: jnp.swapaxes(array, 0, 1), records)

    def rest(lanes: LaneState) -> tuple[LaneState, StepRecord]:
        one = StepRecord(
            pose=lanes.body.qpos,
            velocity=lanes.body.qvel,
            goal_index=lanes.goal_index,
            control=jnp.zeros((lanes.step.shape[0], mechanics.actuators)),
            ranges_m=jnp.zeros((lanes.step.shape[0], applications.lidar.rays)),
            impulse_ns=jnp.zeros_like(lanes.totals.impulse_ns),
            people_m=None if lanes.people is None else lanes.people.place_m,
            robots_m=None if lanes.robots is None else lanes.robots.place_m,
            boxes_m=_standing_m(inputs, lanes),
        )
        return lanes, jax.tree.map(lambda array: jnp.repeat(array[:, None], SLICE_STEPS, 1), one)

    return jax.lax.cond(jnp.all(state.done), rest, run, state)
