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

from tasks.simulate.application.contract import Body, Motion
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
    """

    body: Body
    outlines: LidarOutlines
    seed: Seed
    step: Int[jax.Array, ""]
    scene: DepthScene | None = None


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
        absent: What stands for a robot without it: a tuple that gives empty readings, or None.
        limits: Least and most of a field; others go from 0 to 10,000.
        whole: Fields that are whole numbers.
        shared: Fields that decide array shapes or what is staged, and so are the same in all episodes of a program.
        streams: Numbers of its noises; no other sensor has them.
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
