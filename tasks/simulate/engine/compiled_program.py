"""The compiled program of a chunk: all lanes, split over the host's devices, a slice of control steps at a time."""

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import jax
import jax.numpy as jnp
from jax.sharding import Mesh

from specs.data.world import World
from specs.pipeline.simulation_section import EngineName
from tasks.simulate.application.motion import Body
from tasks.simulate.application.robot_mjcf import Hull
from tasks.simulate.engine.program import lane_mesh, padded_lanes, put_lanes, split_over, strong_types
from tasks.simulate.lane.calls import Applications
from tasks.simulate.lane.lane_state import LaneInputs, LaneState, StepRecord, begin_lane
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
    """

    mechanics: Mechanics
    applications: Applications
    lanes: int
    mesh: Mesh
    begin: Callable[[LaneInputs], LaneState]
    advance: Callable[[LaneInputs, LaneState], tuple[LaneState, StepRecord]]

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

    def ready(self, inputs: LaneInputs, lanes: Sequence[Lane], worlds: Mapping[str, World]) -> "CompiledRun":  # noqa: ARG002 - all that is needed of them is in the inputs
        """Returns episodes ready to run."""
        return CompiledRun(self, put_lanes(self.mesh, inputs))


@dataclass(frozen=True, eq=False)
class CompiledRun:
    """Episodes of a compiled program; see ``tasks.simulate.engine.program.Run``."""

    program: CompiledProgram
    inputs: LaneInputs
    crashes: Mapping[int, str] = field(default_factory=dict[int, str])

    def begin(self) -> LaneState:
        """Returns the lanes before the first control step."""
        return self.program.begin(self.inputs)

    def advance(self, state: LaneState) -> tuple[LaneState, StepRecord]:
        """Returns the lanes a slice later, and the slice's records."""
        return self.program.advance(self.inputs, state)


def compiled_program(mechanics: Mechanics, applications: Applications, lanes: int) -> CompiledProgram:
    """Returns the program of a robot and its applications; compiles nothing yet."""
    mesh = lane_mesh()
    begin = split_over(mesh, jax.vmap(functools.partial(_begin_lane, mechanics, applications)), 1)
    advance = split_over(mesh, functools.partial(_advance_slice, mechanics, applications), 2)
    return CompiledProgram(
        mechanics=mechanics,
        applications=applications,
        lanes=padded_lanes(lanes, mesh.size),
        mesh=mesh,
        begin=jax.jit(begin),
        advance=jax.jit(advance, donate_argnums=1),
    )


def _begin_lane(mechanics: Mechanics, applications: Applications, inputs: LaneInputs) -> LaneState:
    return strong_types(begin_lane(applications, inputs, mechanics.first_body(inputs.start)))


def _advance_slice(
    mechanics: Mechanics, applications: Applications, inputs: LaneInputs, state: LaneState
) -> tuple[LaneState, StepRecord]:
    """Returns one device's lanes a slice later; a device whose lanes are all done does nothing."""
    control_step = jax.vmap(functools.partial(advance_lane, mechanics, applications))

    def run(lanes: LaneState) -> tuple[LaneState, StepRecord]:
        lanes, records = jax.lax.scan(lambda s, _: control_step(inputs, s), lanes, None, length=SLICE_STEPS)
        return lanes, jax.tree.map(lambda array: jnp.swapaxes(array, 0, 1), records)

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
