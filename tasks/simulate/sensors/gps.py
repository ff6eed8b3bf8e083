"""The receiver of satellites: where its antenna is, with noise, and an error that changes slowly."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from specs.data.episode import CONTROL_S
from tasks.simulate.sensors.sensor import (
    Drive,
    Fields,
    Memory,
    Scalar,
    Sensor,
    Situation,
    height_of,
    is_set,
    place_of,
    step_key,
)

_WHITE, _DRIFT = 17, 18
_WORSE_UPWARDS = (1.0, 1.0, 2.0)


class Gps(NamedTuple):
    """A receiver of satellites; fields as in ``GpsDeclaration``."""

    latitude_deg: Scalar = 0.0
    longitude_deg: Scalar = 0.0
    altitude_m: Scalar = 0.0
    x_m: Scalar = 0.0
    y_m: Scalar = 0.0
    z_m: Scalar = 0.0
    sigma_m: Scalar = 0.0
    drift_m: Scalar = 0.0
    drift_s: Scalar = 60.0
    rate_hz: float = 0.0
    latency_steps: int = 0


class _Sky(NamedTuple):
    """How high the base was at the start, and the error that changes slowly."""

    start_m: Float[Array, ""]
    drift_m: Float[Array, "3"]


def _drawn(sigma_m: Scalar, stream: int, now: Situation) -> Float[Array, "3"]:
    errors = jax.random.normal(step_key(now.seed, stream, now.step), (3,), jnp.float32)
    return sigma_m * errors * jnp.array(_WORSE_UPWARDS)


def _begin(_shared: Gps, own: Gps, start: Situation) -> Memory:
    drift_m = _drawn(own.drift_m, _DRIFT, start) if is_set(own.drift_m) else jnp.zeros(3)
    return _Sky(height_of(start.body), drift_m)


# A Gauss-Markov process of first order: its spread stays as it began.
def _feel(_shared: Gps, own: Gps, sky: Memory, drive: Drive) -> Memory:
    if not is_set(own.drift_m):
        return sky
    kept = jnp.exp(-CONTROL_S / own.drift_s)
    fresh_m = jnp.sqrt(1.0 - kept**2) * _drawn(own.drift_m, _DRIFT, drive.after)
    return sky._replace(drift_m=kept * sky.drift_m + fresh_m)


def _observe(_shared: Gps, own: Gps, sky: Memory, now: Situation) -> Fields:
    found = place_of(now.body, sky.start_m, own.x_m, own.y_m, own.z_m) + sky.drift_m
    return {"gps_m": found + _drawn(own.sigma_m, _WHITE, now) if is_set(own.sigma_m) else found}


GPS = Sensor(
    name="gps",
    kind=Gps,
    absent=None,
    blank=lambda _: {"gps_m": jnp.zeros(3)},
    begin=_begin,
    feel=_feel,
    observe=_observe,
    limits={
        "latitude_deg": (-90.0, 90.0),
        "longitude_deg": (-180.0, 180.0),
        "drift_s": (0.1, 1e4),
        **dict.fromkeys(("altitude_m", "x_m", "y_m", "z_m"), (-1e4, 1e4)),
    },
    streams=(_WHITE, _DRIFT),
)
