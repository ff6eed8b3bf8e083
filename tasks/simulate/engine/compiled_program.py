"""The compiled program of a chunk: all lanes, split over the host's devices, a slice of control steps at a time.

Where controllers run on the host, it is a control step at a time: one call drives what was decided, settles, and senses
for the next step; then the host decides. Both ways give the same bits for the same controls
(docs/decisions/0025-controllers-on-the-host.md).
"""

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax.sharding import Mesh

from specs.data.engine_name import EngineName
from specs.data.world import World
from tasks.simulate.application.motion import Body
from tasks.simulate.application.robot_mjcf import Hull
from tasks.simulate.engine.kept_program.keeper import ProgramKeeper, program_keeper
from tasks.simulate.engine.kept_program.sealed_state import one_lane, opened, sealed
from tasks.simulate.engine.lane_refill import LaneRefill, lane_refill
from tasks.simulate.engine.packed_lanes import pack_lane, unpack_lane
from tasks.simulate.engine.program import (
    lane_mesh,
    lane_sharding,
    padded_lanes,
    put_lanes,
    split_over,
    strong_types,
    with_stand_in,
)
from tasks.simulate.engine.stepwise_run import StepwiseCalls, StepwiseRun, sense_lane, step_lane
from tasks.simulate.host.controllers import HostApplication, HostControllers, HostStart
from tasks.simulate.lane.calls import Applications
from tasks.simulate.lane.lane_state import LaneInputs, LaneState, StepRecord, begin_lane
from tasks.simulate.lane.sense import observe
from tasks.simulate.lane.staging import Lane
from tasks.simulate.lane.step import Mechanics, advance_lane
from tasks.simulate.plan.chunks import SLICE_STEPS


@dataclass(frozen=True, eq=False)
class CompiledProgram:
    """A robot and its applications, compiled for a lane count; see ``tasks.simulate.engine.program.Program``.

    Attributes:
        begin: Returns the state before the first control step.
        advance: Returns the state a slice later, and the records of the slice, (lanes, steps) first; the state that
            was given is used up.
        stepwise: The functions for a robot application that runs on the host.
        keeper: Of the functions, for processes to come.
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
    keeper: ProgramKeeper
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
        worlds: Mapping[str, World],  # noqa: ARG002 - all that is needed of them is in the inputs
    ) -> "CompiledRun | StepwiseRun":
        """Returns episodes ready to run."""
        put = put_lanes(self.mesh, inputs)
        if self.host is None:
            return CompiledRun(self, put)
        start = HostStart(lanes, self.lanes, self.actuators, self.applications.sensors)
        return StepwiseRun(self.stepwise, self.mesh, put, self.host.start(start), self.actuators)


@dataclass(frozen=True, eq=False)
class CompiledRun:
    """Episodes of a compiled program; see ``tasks.simulate.engine.program.Run``."""

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
    keeper = program_keeper(lane_sharding(mesh), seen, mechanics.engine, host=host is not None)
    begin_lanes, whole = jax.vmap(functools.partial(_begin_lane, mechanics, seen)), padded_lanes(lanes, mesh.size)
    begin = jax.jit(keeper.kept("begin", split_over(mesh, begin_lanes, 1)))
    advance = split_over(mesh, functools.partial(_advance_slice, mechanics, seen), 2)
    return CompiledProgram(
        mechanics=mechanics,
        applications=seen,
        lanes=whole,
        mesh=mesh,
        begin=begin,
        advance=jax.jit(keeper.kept("advance", advance), donate_argnums=1),
        keeper=keeper,
        stepwise=_stepwise_calls(mechanics, seen, mesh, begin),
        refill=lane_refill(mesh, whole, begin_lanes, keeper),
        host=host,
    )


def _stepwise_calls(
    mechanics: Mechanics, applications: Applications, mesh: Mesh, begin: Callable[[LaneInputs], LaneState]
) -> StepwiseCalls:
    step = jax.vmap(functools.partial(step_lane, mechanics, applications))
    pack = jax.jit(split_over(mesh, jax.vmap(pack_lane), 1))
    return StepwiseCalls(
        begin=begin,
        observe=jax.vmap(functools.partial(observe, applications)),
        sense=jax.jit(split_over(mesh, jax.vmap(functools.partial(sense_lane, applications)), 2)),
        pack_inputs=pack,
        pack=pack,
        step=jax.jit(split_over(mesh, step, 3), donate_argnums=1),
        unpack=jax.jit(split_over(mesh, jax.vmap(unpack_lane), 1)),
    )


def _begin_lane(mechanics: Mechanics, applications: Applications, inputs: LaneInputs) -> LaneState:
    return sealed(strong_types(begin_lane(applications, inputs, mechanics.first_body(inputs.start))))


def _advance_slice(
    mechanics: Mechanics, applications: Applications, inputs: LaneInputs, state: LaneState
) -> tuple[LaneState, StepRecord]:
    """Returns one device's lanes a slice later; a device whose lanes are all done does nothing."""
    control_step = jax.vmap(functools.partial(advance_lane, mechanics, applications))

    def run(lanes: LaneState) -> tuple[LaneState, StepRecord]:
        lanes = opened(applications, one_lane(inputs), lanes)
        around = inputs._replace(near=jax.vmap(mechanics.near)(inputs, lanes.body))
        lanes, records = jax.lax.scan(lambda s, _: control_step(around, s), lanes, None, length=SLICE_STEPS)
        return sealed(lanes), jax.tree.map(lambda array: jnp.swapaxes(array, 0, 1), records)

    def rest(lanes: LaneState) -> tuple[LaneState, StepRecord]:
        one = StepRecord(
            pose=lanes.body.qpos,
            velocity=lanes.body.qvel,
            goal_index=lanes.goal_index,
            control=jnp.zeros((lanes.step.shape[0], mechanics.actuators)),
            ranges_m=jnp.zeros((lanes.step.shape[0], applications.lidar.rays)),
            impulse_ns=jnp.zeros_like(lanes.tally.impulse_ns),
        )
        return lanes, jax.tree.map(lambda array: jnp.repeat(array[:, None], SLICE_STEPS, 1), one)

    return jax.lax.cond(jnp.all(state.done), rest, run, state)
