"""The bumper: contact switches around the hull."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from tasks.simulate.sensors.sensor import Drive, Fields, Memory, Sensor, Situation


class Bumper(NamedTuple):
    """Contact switches around the hull: sector 0 is centred straight ahead, the others follow counter-clockwise."""

    sectors: int
    latency_steps: int = 0


NO_BUMPER = Bumper(sectors=0)


def _begin(shared: Bumper, _own: Bumper, _start: object) -> Memory:
    return jnp.zeros(shared.sectors, bool)


def _feel(shared: Bumper, _own: Bumper, _before: Memory, drive: Drive) -> Memory:
    return _pressed(drive.motion.work.push_ns, drive.motion.body.qpos[2], shared.sectors)


def _pressed(push_ns: Float[jax.Array, "2"], yaw_rad: Float[jax.Array, ""], sectors: int) -> Bool[jax.Array, "sectors"]:
    """Returns which sector of the hull the robot was pushed on: the one opposite to where it was pushed to."""
    bearing = jnp.arctan2(-push_ns[1], -push_ns[0]) - yaw_rad
    pressed = jnp.round(bearing * (max(sectors, 1) / (2 * np.pi))) % max(sectors, 1)
    return (jnp.arange(sectors) == pressed) & jnp.any(push_ns != 0.0)


def _observe(_shared: Bumper, _own: Bumper, pressed: Memory, _situation: Situation) -> Fields:
    return {"bumper": pressed}


def _blank(shared: Bumper) -> Fields:
    return {"bumper": jnp.zeros(shared.sectors, bool)}


BUMPER = Sensor(
    name="bumper",
    kind=Bumper,
    absent=NO_BUMPER,
    blank=_blank,
    begin=_begin,
    feel=_feel,
    observe=_observe,
    limits={"sectors": (1, 360)},
    whole=("sectors",),
    shared=("sectors",),
)
