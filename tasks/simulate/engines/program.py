"""The interface of an engine's program: a robot and its applications, ready for a number of lanes.

Engines that are JAX functions run in a compiled program (``compiled_program``), C MuJoCo on the host's threads
(``mujoco_engine``). Also how lanes' arrays get to the devices and back: each array that a compiled call takes or gives
costs microseconds, however small it is, so that what is small goes into one row of words for each lane, bit for bit;
what is large stays an array of its own, which a call that is given it may change in place.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import AxisType, Mesh, NamedSharding, PartitionSpec
from jaxtyping import UInt32

from specs.data.world import World
from specs.field_types import EngineName
from tasks.simulate.application.contract import Body
from tasks.simulate.application.robot_model import Hull
from tasks.simulate.engines.program_cache import ProgramCache
from tasks.simulate.host.controllers import HostApplication, HostControllers, StandIn
from tasks.simulate.lane.chunk_applications import Applications
from tasks.simulate.lane.control_step import LaneInputs, LaneState, StepRecord
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
    def host(self) -> HostApplication | None:
        """Returns the robot application, if it runs on the host."""
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
    def cache(self) -> ProgramCache:
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


class LaneTransfer:
    """The way between the host and a mesh that lanes are split over."""

    def __init__(self, mesh: Mesh) -> None:
        self._sharding, self._shards = lane_sharding(mesh), range(mesh.size)

    def put(self, array: np.ndarray) -> jax.Array:
        """Returns an array of all lanes, split over the devices."""
        return jax.make_array_from_callback(array.shape, self._sharding, array.__getitem__)

    def fetch(self, array: jax.Array) -> list[np.ndarray]:
        """Returns each device's share, in the lanes' order; what it shows may change when the array is used up."""
        # The shards of a mesh's only axis lie in the mesh's order; to ask an array for it takes longer than to fetch.
        return [np.asarray(array.addressable_data(shard)) for shard in self._shards]


Tree = TypeVar("Tree")
# Of one lane: a copy of so many numbers costs less than an array more.
_SMALL = 64
_WORDS = (jnp.dtype("float32"), jnp.dtype("int32"), jnp.dtype("uint32"))
_FLAG = jnp.dtype("bool")


class _Leaf(NamedTuple):
    """An array of one lane.

    Attributes:
        small: Whether it is among the words.
    """

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    small: bool


@dataclass(frozen=True)
class _Form:
    structure: Any
    leaves: tuple[_Leaf, ...]

    def __hash__(self) -> int:
        # Each call asks for it; that of all leaves would take as long as to pass the arrays.
        return hash(self.structure)


@partial(jax.tree_util.register_dataclass, data_fields=["words", "large"], meta_fields=["form"])
@dataclass(frozen=True)
class PackedLanes(Generic[Tree]):
    """A tree of arrays; of one lane, or lanes first.

    Attributes:
        words: All that is small.
        large: The other arrays.
        form: What the tree was.
    """

    words: UInt32[jax.Array, "*lanes words"]
    large: list[jax.Array]
    form: _Form


def pack_lane(tree: Tree) -> PackedLanes[Tree]:
    """Returns one lane's tree of arrays as a few arrays."""
    arrays, structure = jax.tree.flatten(tree)
    leaves = tuple(_leaf(array) for array in arrays)
    words = [_words(array) for array, leaf in zip(arrays, leaves, strict=True) if leaf.small]
    large = [array for array, leaf in zip(arrays, leaves, strict=True) if not leaf.small]
    return PackedLanes(jnp.concatenate([jnp.zeros(0, jnp.uint32), *words]), large, _Form(structure, leaves))


def unpack_lane(packed: PackedLanes[Tree]) -> Tree:
    """Returns the tree of one lane, the same bits."""
    arrays: list[jax.Array] = []
    place, large = 0, iter(packed.large)
    for leaf in packed.form.leaves:
        size = math.prod(leaf.shape)
        arrays.append(_array(packed.words[place : place + size], leaf) if leaf.small else next(large))
        place += size if leaf.small else 0
    return jax.tree.unflatten(packed.form.structure, arrays)


def _leaf(array: jax.Array) -> _Leaf:
    # Whatever is no plain number, such as a key, stays as it is.
    small = array.dtype in {*_WORDS, _FLAG} and array.size <= _SMALL
    return _Leaf(array.shape, array.dtype, small)


def _words(array: jax.Array) -> UInt32[jax.Array, "words"]:
    flat = jnp.ravel(array)
    return flat.astype(jnp.uint32) if array.dtype == _FLAG else jax.lax.bitcast_convert_type(flat, jnp.uint32)


def _array(words: UInt32[jax.Array, "words"], leaf: _Leaf) -> jax.Array:
    flat = words != 0 if leaf.dtype == _FLAG else jax.lax.bitcast_convert_type(words, leaf.dtype)
    return flat.reshape(leaf.shape)
