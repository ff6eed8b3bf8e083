"""What a trainer sees of an observation: some of the fields that controllers get, as float32, with bounds."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Float32

from specs.base import Fault
from specs.errors import DocumentError
from tasks.simulate.application.contract import Joints, Observation
from tasks.simulate.sensor.sensors import Sensors

# Where nature sets no bound: a yaw counts turns, and a robot that is pushed may move at any speed.
UNBOUNDED = 1e4
_JOINT_FIELDS = ("qpos", "qvel")


class FieldBounds(NamedTuple):
    """The bounds of an observation's field, in the field's shape."""

    low: Float32[np.ndarray, "..."]
    high: Float32[np.ndarray, "..."]


class EpisodeBounds(NamedTuple):
    """What bounds the observations of a pool's episodes.

    Attributes:
        duration_s: The longest episode's.
        goals: The most goals of an episode.
        reach_m: No goal, and no place within a world, has a larger coordinate.
    """

    duration_s: float
    goals: int
    reach_m: float


def default_fields(sensors: Sensors) -> tuple[str, ...]:
    """Returns what a reactive controller needs: the scan, the goal as the robot sees it, and contacts."""
    scan = ("ranges_m",) if sensors.lidar.rays else ()
    return (*scan, "goal_robot_m", *(("bumper",) if sensors.bumper.sectors else ()))


def field_bounds(
    fields: Sequence[str], sensors: Sensors, joints: Joints | None, episodes: EpisodeBounds
) -> dict[str, FieldBounds]:
    """Returns the bounds of the fields that a trainer wants, in its order.

    Args:
        fields: Names of an Observation's fields; ``joints`` stands for ``qpos`` and ``qvel``.
        sensors: The robot's.
        joints: Of a robot that is more than a planar base.
        episodes: The pool's.

    Raises:
        DocumentError: There is no such field, or the robot has none such, or one comes twice.
    """
    known = _all_bounds(sensors, joints, episodes)
    wrong = [name for name in dict.fromkeys(fields) if name not in known]
    twice = sorted({name for name in fields if list(fields).count(name) > 1})
    allowed = f"fields of this robot's observation, each once: {', '.join(known)}"
    if wrong or twice or not fields:
        names = wrong or twice or [""]
        raise DocumentError(
            [Fault(path="observation", value=repr(name), allowed=allowed) for name in names], "simyard.gym"
        )
    return {name: known[name] for name in fields}


def observed_fields(bounds: Mapping[str, FieldBounds], observed: Observation) -> dict[str, Float[jax.Array, "..."]]:
    """Returns what a trainer sees of one lane's observation, within its bounds.

    Args:
        bounds: Of each field that it wants.
        observed: What a controller would get.
    """
    values = observed._asdict() | (observed.joints._asdict() if observed.joints is not None else {})
    return {
        name: jnp.clip(jnp.asarray(values[name], jnp.float32), each.low, each.high) for name, each in bounds.items()
    }


def _all_bounds(sensors: Sensors, joints: Joints | None, episodes: EpisodeBounds) -> dict[str, FieldBounds]:
    rays, sectors, reach = sensors.lidar.rays, sensors.bumper.sectors, episodes.reach_m
    known = {
        "ranges_m": _between(0.0, sensors.lidar.range_m, rays),
        "goal_robot_m": _between(-4.0 * reach, 4.0 * reach, 2),
        "goal_m": _between(-reach, reach, 2),
        "goal_index": _between(0.0, float(max(episodes.goals - 1, 1))),
        "pose": _between(-UNBOUNDED, UNBOUNDED, 3),
        "velocity": _between(-UNBOUNDED, UNBOUNDED, 3),
        "bumper": _between(0.0, 1.0, sectors),
        "time_s": _between(0.0, episodes.duration_s),
    }
    for name in _JOINT_FIELDS if joints is not None else ():
        known[name] = _between(-UNBOUNDED, UNBOUNDED, *getattr(joints, name).shape)
    return {name: bounds for name, bounds in known.items() if bounds.low.size}


def _between(low: float, high: float, *shape: int) -> FieldBounds:
    return FieldBounds(np.full(shape, low, np.float32), np.full(shape, high, np.float32))
