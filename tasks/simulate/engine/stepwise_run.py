"""Drives a compiled program a control step at a time, for controllers that run on the host.

One call drives what was decided, settles, and senses for the next step. What the host needs of it, for controllers and
for records, comes as one array, and the lanes go in and out as a few: each array more costs microseconds, and fetched
by itself it costs as much as the physics (docs/decisions/0025-controllers-on-the-host.md).
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh
from jaxtyping import Bool, Float, Float32

from tasks.simulate.application.contract import Observation
from tasks.simulate.engine.kept_program.sealed_state import opened, sealed
from tasks.simulate.engine.lane_transfer import LaneTransfer
from tasks.simulate.engine.packed_lanes import PackedLanes, pack_lane, unpack_lane
from tasks.simulate.host.controllers import HostControllers
from tasks.simulate.lane.calls import Applications
from tasks.simulate.lane.lane_state import Decision, LaneInputs, LaneState, StepRecord
from tasks.simulate.lane.sense import observe
from tasks.simulate.lane.settle import settle
from tasks.simulate.lane.step import Mechanics
from tasks.simulate.plan.chunks import SLICE_STEPS

# What a robot senses, whether its lane is done, and what is recorded of a step, as one row of numbers: the scan first.
Row = Float[jax.Array, "numbers"]
Rows = Float32[np.ndarray, "lanes numbers"]
PackedInputs = PackedLanes[LaneInputs]
PackedState = PackedLanes[LaneState]
# Of what a row tells a record: the pose, the velocity, the goal's index and the impulse.
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
    """

    begin: Callable[[LaneInputs], LaneState]
    observe: Callable[[LaneInputs, LaneState], Observation]
    sense: Callable[[LaneInputs, LaneState], Float[jax.Array, "lanes numbers"]]
    pack_inputs: Callable[[LaneInputs], PackedInputs]
    pack: Callable[[LaneState], PackedState]
    step: Callable[..., tuple[PackedState, Float[jax.Array, "lanes numbers"]]]
    unpack: Callable[[PackedState], LaneState]


class StepwiseRun:
    """Episodes whose controllers run on the host; see ``tasks.simulate.engine.program.Run``. It runs once."""

    def __init__(
        self, calls: StepwiseCalls, mesh: Mesh, inputs: LaneInputs, host: HostControllers, actuators: int
    ) -> None:
        self.host, self._actuators = host, actuators
        self._calls, self._transfer = calls, LaneTransfer(mesh)
        self._inputs: Any = inputs  # packed, once it has begun

    def begin(self) -> LaneState:
        """Returns the lanes before the first control step."""
        state = self._calls.begin(self._inputs)
        self._columns = SensedColumns(jax.eval_shape(self._calls.observe, self._inputs, state))
        self._rows = self._fetched(self._calls.sense(self._inputs, state))
        self._inputs = self._calls.pack_inputs(self._inputs)
        return state

    def advance(self, state: LaneState) -> tuple[LaneState, StepRecord]:
        """Returns the lanes a slice later, or when all are done, and the records up to then."""
        packed, record, steps = self._calls.pack(state), self._blank_record(), 0
        while steps < SLICE_STEPS:
            observed, done = self._columns.observed(self._rows), self._columns.done(self._rows)
            if steps and done.all():
                break
            controls = self.host.controls(observed, ~done)
            packed, after = self._calls.step(self._inputs, packed, self._transfer.put(controls))
            self._rows = self._fetched(after)
            _keep(record, steps, observed, controls, self._rows[:, -_RECORDED:])
            steps += 1
        return self._calls.unpack(packed), jax.tree.map(lambda array: array[:, :steps], record)

    def _blank_record(self) -> StepRecord:
        lanes = len(self._rows)
        sizes = [(3,), (3,), (), (self._actuators,), (self._columns.rays,), ()]
        blank: list[Any] = [np.empty((lanes, SLICE_STEPS, *size), np.float32) for size in sizes]
        blank[2] = np.empty((lanes, SLICE_STEPS), np.int32)
        return StepRecord(*blank)

    def _fetched(self, rows: jax.Array) -> Rows:
        return np.concatenate(self._transfer.fetch(rows))


class SensedColumns:
    """Where in rows of numbers, as ``sense_lane`` makes them, what robots sense stands.

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


def step_lane(
    mechanics: Mechanics,
    applications: Applications,
    packed_inputs: PackedInputs,
    packed: PackedState,
    control: Float[jax.Array, "actuators"],
) -> tuple[PackedState, Row]:
    """Returns a lane a control step later that the host decided, and what is sensed then and recorded of it."""
    inputs = unpack_lane(packed_inputs)
    before = opened(applications, inputs, unpack_lane(packed))
    # The host has the scan that the controller saw, for the record.
    decided = Decision(before.controller, control, jnp.zeros(0))
    motion = mechanics.drive(inputs, before.body, control)
    state, record = settle(applications, inputs, before, decided, motion)
    recorded = (record.pose, record.velocity, record.goal_index, record.impulse_ns)
    return pack_lane(sealed(state)), jnp.concatenate(
        [sense_lane(applications, inputs, state), *map(_numbers, recorded)]
    )


def sense_lane(applications: Applications, inputs: LaneInputs, state: LaneState) -> Row:
    """Returns what a lane's robot senses, and whether the lane is done, as one row of numbers."""
    ranges_m, others = _scan_first(observe(applications, inputs, state))
    return jnp.concatenate([_numbers(each) for each in (ranges_m, state.done, *others)])


def _keep(record: Any, step: int, observed: Observation, controls: Rows, recorded: Rows) -> None:  # noqa: ANN401 - a StepRecord in NumPy
    record.pose[:, step], record.velocity[:, step] = recorded[:, :3], recorded[:, 3:6]
    record.goal_index[:, step], record.impulse_ns[:, step] = recorded[:, 6], recorded[:, 7]
    record.control[:, step], record.ranges_m[:, step] = controls, observed.ranges_m


def _numbers(array: jax.Array) -> Row:
    return jnp.ravel(array).astype(jnp.float32)


def _scan_first(observed: Observation) -> tuple[jax.Array, list[jax.Array]]:
    return observed.ranges_m, jax.tree.leaves(observed._replace(ranges_m=None))
