"""The compiled program of a chunk: all lanes, split over the host's devices, a slice of control steps at a time."""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jax.sharding import AxisType, Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, Float

from tasks.simulate.applications import Applications
from tasks.simulate.lane import advance_lane
from tasks.simulate.lane_state import LaneInputs, LaneState, Record, begin_lane
from tasks.simulate.model import RobotModel

# 1.25 simulated seconds: how often the host looks whether all lanes are done, or whether it shall stop.
SLICE_STEPS = 25
_AXIS = "lanes"
# Lanes fill whole vectors: three lanes a device, or one, are compiled to other arithmetic for what is left over, and
# results differ in the last bits. With multiples of eight they are the same for any lane and device count.
_LANES_A_VECTOR = 8


@dataclass(frozen=True, eq=False)
class Program:
    """A robot and its applications, compiled for a lane count.

    Attributes:
        lanes: Lanes that a run always has, filled up with idle ones.
        begin: Returns the state before the first control step.
        advance: Returns the state a slice later, and the records of the slice, (lanes, steps) first; the state that
            was given is used up.
    """

    robot: RobotModel
    applications: Applications
    lanes: int
    mesh: Mesh
    begin: Callable[[LaneInputs], LaneState]
    advance: Callable[[LaneInputs, LaneState], tuple[LaneState, Record]]

    def place(self, inputs: LaneInputs) -> LaneInputs:
        """Returns the inputs, lanes first, split over the devices."""
        return jax.device_put(inputs, NamedSharding(self.mesh, PartitionSpec(_AXIS)))


def padded_lanes(lanes: int, devices: int) -> int:
    """Returns the lanes of a run: at least as many as asked for, and the same whole vectors on each device."""
    together = _LANES_A_VECTOR * devices
    return -(-lanes // together) * together


def make_program(robot: RobotModel, applications: Applications, lanes: int) -> Program:
    """Returns the program of a robot and its applications; compiles nothing yet."""
    devices = jax.devices()
    mesh = jax.make_mesh((len(devices),), (_AXIS,), axis_types=(AxisType.Auto,))
    split = functools.partial(_split, mesh)
    begin = split(jax.vmap(functools.partial(begin_lane, robot, applications)), 1)
    advance = split(functools.partial(_advance_slice, robot, applications), 2)
    return Program(
        robot=robot,
        applications=applications,
        lanes=padded_lanes(lanes, len(devices)),
        mesh=mesh,
        begin=jax.jit(begin),
        advance=jax.jit(advance, donate_argnums=1),
    )


def _split(mesh: Mesh, kernel: Callable[..., Any], arguments: int) -> Callable[..., Any]:
    spec = PartitionSpec(_AXIS)
    return jax.shard_map(kernel, mesh=mesh, in_specs=(spec,) * arguments, out_specs=spec, check_vma=False)


def _advance_slice(
    robot: RobotModel, applications: Applications, inputs: LaneInputs, state: LaneState
) -> tuple[LaneState, Record]:
    """Returns one device's lanes a slice later; a device whose lanes are all done does nothing."""
    control_step = jax.vmap(functools.partial(advance_lane, robot, applications))

    def run(lanes: LaneState) -> tuple[LaneState, Record]:
        lanes, records = jax.lax.scan(lambda s, _: control_step(inputs, s), lanes, None, length=SLICE_STEPS)
        return lanes, jax.tree.map(lambda array: jnp.swapaxes(array, 0, 1), records)

    def rest(lanes: LaneState) -> tuple[LaneState, Record]:
        controls = jnp.zeros((lanes.step.shape[0], SLICE_STEPS, robot.actuators))
        return lanes, Record(_repeated(lanes.body.qpos), controls)

    return jax.lax.cond(jnp.all(state.done), rest, run, state)


def _repeated(pose: Float[Array, "lanes 3"]) -> Float[Array, "lanes steps 3"]:
    return jnp.broadcast_to(pose[:, None], (pose.shape[0], SLICE_STEPS, 3))
