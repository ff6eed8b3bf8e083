"""The record of a sensor: how a controller declares it, what it remembers, and what it gives at a control step.

Its noise belongs to an episode's seed, a sensor and a control step, and to nothing else.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key, UInt32

from specs.data.episode import control_stride
from tasks.simulate.application.contract import Body, FreeJoints, Motion
from tasks.simulate.geometry.depth_picture import DepthScene
from tasks.simulate.geometry.lidar_scan import LidarOutlines

Seed = UInt32[Array, "2"]
_WORD = 32


# Keys are counted, not carried: what a lane draws does not depend on the lanes beside it, on how it got to that step,
# or on the engine.
def seed_words(seed: int) -> UInt32[np.ndarray, "2"]:
    """Returns an episode's seed as the two words that ``step_key`` begins with; its lowest 64 bits count."""
    return np.array([(seed >> _WORD) & 0xFFFFFFFF, seed & 0xFFFFFFFF], np.uint32)


def step_key(seed: Seed, stream: int, step: Int[Array, ""]) -> Key[Array, ""]:
    """Returns the key of a sensor at a control step.

    Args:
        seed: The episode's.
        stream: Number of the sensor's noise; no other noise has it.
        step: The control step.
    """
    # Named, since JAX's default is a setting of the process.
    key = jax.random.wrap_key_data(seed, impl="threefry2x32")
    return jax.random.fold_in(jax.random.fold_in(key, stream), step)


Scalar = float | Float[jax.Array, ""]
Limits = Mapping[str, tuple[float, float]]
# The tuple of what a controller declares of a sensor.
Declared = TypeVar("Declared", bound=tuple[Any, ...])
# What a sensor keeps from one control step to the next: a pytree of arrays.
Memory = Any
# Values of an Observation, by field.
Fields = dict[str, Any]


# The functions of a record are pure JAX for one lane, the same for every engine. They get the sensor as the program
# has it, in plain numbers, and as the lane has it, whose numbers may be traced.
class Situation(NamedTuple):
    """One lane before a control step.

    Attributes:
        body: The robot.
        outlines: What crosses the lidar's plane.
        seed: The episode's.
        step: Which control step comes.
        scene: What a depth camera can see; None for a robot without.
        hull_depth_m: What it sees of its own robot; None for one that sees nothing of it.
    """

    body: Body
    outlines: LidarOutlines
    seed: Seed
    step: Int[jax.Array, ""]
    scene: DepthScene | None = None
    hull_depth_m: Float[jax.Array, "*cameras rows columns"] | None = None


class Drive(NamedTuple):
    """One lane over a control step that an engine drove.

    Attributes:
        before: The lane at the step's beginning.
        motion: What the engine made of the step.
    """

    before: Situation
    motion: Motion

    @property
    def after(self) -> Situation:
        """Returns the lane at the step's end."""
        return self.before._replace(body=self.motion.body, step=self.before.step + 1)


class Pace(NamedTuple):
    """When a sensor reads, and how old its readings are when they are there.

    Attributes:
        stride: How many control steps lie between two.
        latency_steps: How many control steps old one is then.
    """

    stride: int
    latency_steps: int

    @property
    def slots(self) -> int:
        """Returns how many readings are kept: those that are on their way, and the one that is there."""
        return -(-self.latency_steps // self.stride) + 1


def pace_of(shared: object) -> Pace:
    """Returns the pace of a declared sensor; one that declares none reads at each control step."""
    return Pace(control_stride(getattr(shared, "rate_hz", 0.0)), getattr(shared, "latency_steps", 0))


def _no_memory(_shared: object, _own: object, _start: object) -> Memory:
    return ()


def _no_change(_shared: object, _own: object, memory: Memory, _drive: Drive) -> Memory:
    return memory


@dataclass(frozen=True, eq=False)
class Sensor(Generic[Declared]):
    """A sensor.

    Attributes:
        name: Attribute of a controller that declares it.
        kind: What is declared: a tuple, whose fields with a default may be left out.
        absent: What stands for a robot without it: a tuple that gives empty readings, or None, which gives none.
        limits: Least and most of a field; others go from 0 to 10,000.
        whole: Fields that are whole numbers.
        shared: Fields that decide array shapes or what is staged, and so are the same in all episodes of a program.
        streams: Numbers of its noises; no other sensor has them.
        keeps: Whether it keeps readings by itself until they are due; those of others are kept for them.
        blank: Returns what a controller gets before anything runs, to check it with.
        begin: Returns what it remembers before the first control step, given both declarations, the program's first.
        feel: Returns what it remembers after a control step, given both declarations and the memory before.
        observe: Returns fields of the observation, given both declarations, the program's first, and the memory.
    """

    name: str
    kind: type[Declared]
    absent: Declared | None
    blank: Callable[[Declared], Fields]
    observe: Callable[[Declared, Declared, Memory, Situation], Fields]
    limits: Limits
    whole: tuple[str, ...] = ()
    shared: tuple[str, ...] = ()
    streams: tuple[int, ...] = ()
    keeps: bool = False
    begin: Callable[[Declared, Declared, Situation], Memory] = _no_memory
    feel: Callable[[Declared, Declared, Memory, Drive], Memory] = _no_change


def is_set(value: Scalar) -> bool:
    """Returns whether a number may be other than 0: a traced one is only known when the program runs."""
    return not (isinstance(value, int | float) and value == 0.0)


def rotate(vector: Float[jax.Array, "axes"], yaw_rad: Float[jax.Array, ""]) -> Float[jax.Array, "axes"]:
    """Returns a vector with its first two parts turned counter-clockwise."""
    cos, sin = jnp.cos(yaw_rad), jnp.sin(yaw_rad)
    rotated = jnp.stack([cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1]])
    return jnp.concatenate([rotated, vector[2:]])


class Base(NamedTuple):
    """How a base moves: its orientation as a quaternion, its speed along the world's axes, its turns along its own."""

    quaternion: Float[Array, "4"]
    speed_m_s: Float[Array, "3"]
    turn_rad_s: Float[Array, "3"]


def base_of(body: Body) -> Base:
    """Returns how a robot's base moves; a planar one is level."""
    if isinstance(body.joints, FreeJoints):
        qpos, qvel = body.joints.qpos, body.joints.qvel
        return Base(qpos[3:7], qvel[:3], qvel[3:6])
    half_rad, zero = body.qpos[2] / 2, jnp.zeros((), body.qpos.dtype)
    upright = jnp.stack([jnp.cos(half_rad), zero, zero, jnp.sin(half_rad)])
    return Base(upright, jnp.append(body.qvel[:2], zero), jnp.stack([zero, zero, body.qvel[2]]))


def turned(quaternion: Float[Array, "4"], vector: Float[Array, "3"], *, back: bool = False) -> Float[Array, "3"]:
    """Returns a vector turned as a quaternion turns, or back."""
    axis = -quaternion[1:] if back else quaternion[1:]
    twice = 2.0 * jnp.cross(axis, vector)
    return vector + quaternion[0] * twice + jnp.cross(axis, twice)


def height_of(body: Body) -> Float[Array, ""]:
    """Returns how high a base is; a planar one stays on the floor."""
    return body.joints.qpos[2] if isinstance(body.joints, FreeJoints) else jnp.zeros((), body.qpos.dtype)


def place_of(body: Body, start_m: Float[Array, ""], *mount: Scalar) -> Float[Array, "3"]:
    """Returns where a point of a robot is in the world.

    Args:
        body: The robot.
        start_m: How high its base was at the start.
        mount: Ahead, to the left, and above the floor that it started on.
    """
    ahead, left, up = (jnp.asarray(each, body.qpos.dtype) for each in mount)
    way = turned(base_of(body).quaternion, jnp.stack([ahead, left, up - start_m]))
    return way + jnp.append(body.qpos[:2], height_of(body))
