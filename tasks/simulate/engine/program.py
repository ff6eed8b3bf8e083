"""The interface of an engine's program: a robot and its applications, ready for a number of lanes.

Engines that are JAX functions run in a compiled program (``compiled_program``), C MuJoCo on the host's threads
(``mujoco.engine``).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import AxisType, Mesh, NamedSharding, PartitionSpec

from specs.data.engine_name import EngineName
from specs.data.world import World
from tasks.simulate.application.motion import Body
from tasks.simulate.application.robot_mjcf import Hull
from tasks.simulate.engine.kept_program.keeper import ProgramKeeper
from tasks.simulate.host.controllers import HostControllers, StandIn
from tasks.simulate.lane.calls import Applications
from tasks.simulate.lane.lane_state import LaneInputs, LaneState, StepRecord
from tasks.simulate.lane.staging import Lane

_AXIS = "lanes"
# Lanes fill whole vectors: three lanes a device, or one, are compiled to other arithmetic for what is left over, and
# results differ in the last bits. With multiples of eight, and without fused multiply-add (``devices``), they are the
# same for any lane and device count, and wherever in the batch a lane lies.
_LANES_A_VECTOR = 8


class Run(Protocol):
    """The episodes of one chunk on their way."""

    @property
    def host(self) -> HostControllers | None:
        """Returns the controllers, where they run on the host: they know more than a lane's state says."""
        ...

    def begin(self) -> LaneState:
        """Returns the lanes before the first control step, lanes first."""
        ...

    def advance(self, state: LaneState) -> tuple[LaneState, StepRecord]:
        """Returns the lanes a slice later, and its records, (lanes, steps) first; ``state`` is used up."""
        ...


class Program(Protocol):
    """A robot and its applications on an engine."""

    @property
    def engine(self) -> EngineName:
        """Returns the engine's name."""
        ...

    @property
    def applications(self) -> Applications:
        """Returns the robot application and the scenario."""
        ...

    @property
    def hull(self) -> Hull:
        """Returns the robot's hull."""
        ...

    @property
    def actuators(self) -> int:
        """Returns how many numbers a control has."""
        ...

    @property
    def lanes(self) -> int:
        """Returns the lanes that a run always has, filled up with idle ones."""
        ...

    @property
    def keeper(self) -> ProgramKeeper:
        """Returns what keeps its functions for processes to come."""
        ...

    def body(self) -> Body:
        """Returns a robot at rest, to check applications with."""
        ...

    def ready(self, inputs: LaneInputs, lanes: Sequence[Lane], worlds: Mapping[str, World]) -> Run:
        """Returns episodes ready to run.

        Args:
            inputs: All the program's lanes, lanes first.
            lanes: The episodes in them.
            worlds: By name, at least those of the episodes.
        """
        ...


def padded_lanes(lanes: int, devices: int) -> int:
    """Returns the lanes of a run: at least as many as asked for, and the same whole vectors on each device."""
    together = _LANES_A_VECTOR * devices
    return -(-lanes // together) * together


def strong_types(state: LaneState) -> LaneState:
    """Returns a state whose arrays have types of their own: JAX would compile a program again for a "weak" one.

    What comes out of a program's first slice has strong types, whatever literals an application began with.
    """
    return jax.tree.map(lambda array: jax.lax.convert_element_type(array, jnp.asarray(array).dtype), state)


def lane_mesh(most: int | None = None) -> Mesh:
    """Returns devices to split lanes over.

    Args:
        most: So many; None for all.
    """
    devices = jax.devices()[:most]
    return jax.make_mesh((len(devices),), (_AXIS,), axis_types=(AxisType.Auto,), devices=devices)


def split_over(mesh: Mesh, kernel: Callable[..., Any], arguments: int) -> Callable[..., Any]:
    """Returns a function of arrays with lanes first, each device of the mesh working on its share of the lanes."""
    spec = PartitionSpec(_AXIS)
    return jax.shard_map(kernel, mesh=mesh, in_specs=(spec,) * arguments, out_specs=spec, check_vma=False)


def put_lanes(mesh: Mesh, inputs: LaneInputs) -> LaneInputs:
    """Returns the inputs, lanes first, split over the devices."""
    return jax.device_put(inputs, lane_sharding(mesh))


def lane_sharding(mesh: Mesh) -> NamedSharding:
    """Returns how arrays with lanes first are split over the devices."""
    return NamedSharding(mesh, PartitionSpec(_AXIS))


def with_stand_in(applications: Applications, actuators: int, *, host: bool) -> Applications:
    """Returns applications as compiled functions see them: with a stand-in for a controller on the host."""
    if not host:
        return applications
    stand_in = StandIn(applications.sensors, actuators)
    return replace(applications, make_controller=lambda _: stand_in)


def stacked_records(records: Sequence[StepRecord]) -> StepRecord:
    """Returns the records of control steps as one, (lanes, steps) first."""
    return jax.tree.map(lambda *each: np.stack(each, axis=1), *records)
