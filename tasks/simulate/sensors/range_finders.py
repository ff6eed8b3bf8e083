"""Range finders and cliff sensors, ultrasonic or infrared: how near the nearest thing is in each one's cone, or below.

The floor gives a range finder no echo.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from tasks.simulate.geometry.depth_picture import View, depth_picture, rays_of
from tasks.simulate.sensors.lidar import Lidar, noisy_ranges
from tasks.simulate.sensors.sensor import Fields, Memory, Scalar, Sensor, Situation, height_of, place_of

_STREAMS, _CLIFF_STREAMS = (9, 10), (15, 16)
# Rays across a cone: what is narrower than a tenth of it may slip through.
_ACROSS = 11


class RangeFinders(NamedTuple):
    """Range finders around a robot; fields as in ``RangeFindersDeclaration``."""

    finders: int
    range_m: float
    z_m: Scalar
    cone_rad: float = 0.5
    first_rad: Scalar = 0.0
    apart_rad: Scalar = 0.0
    out_m: Scalar = 0.0
    sigma_m: Scalar = 0.0
    dropout: Scalar = 0.0
    rate_hz: float = 0.0
    latency_steps: int = 0


class CliffSensors(NamedTuple):
    """Cliff sensors around a robot; fields as in ``CliffSensorsDeclaration``."""

    sensors: int
    range_m: float = 0.3
    z_m: Scalar = 0.05
    first_rad: Scalar = -0.6
    apart_rad: Scalar = 0.6
    out_m: Scalar = 0.15
    sigma_m: Scalar = 0.0
    dropout: Scalar = 0.0
    rate_hz: float = 0.0
    latency_steps: int = 0


def _observe(shared: RangeFinders, own: RangeFinders, _memory: Memory, now: Situation) -> Fields:
    if now.scene is None:
        raise ValueError("no scene was staged for a robot with range finders")
    scene, pose = now.scene, now.body.qpos
    view = View(_ACROSS, _ACROSS, shared.cone_rad, 0.0, shared.range_m)
    rays = rays_of(view)
    long = np.sqrt(rays.ahead**2 + rays.left**2 + rays.up**2)
    in_cone = np.hypot(rays.left, rays.up) <= math.tan(shared.cone_rad / 2)

    def nearest(number: Array) -> Float[Array, ""]:
        yaw = pose[2] + own.first_rad + own.apart_rad * number
        eye = jnp.stack(
            [
                pose[0] + own.out_m * jnp.cos(yaw),
                pose[1] + own.out_m * jnp.sin(yaw),
                jnp.asarray(own.z_m, pose.dtype),
                yaw,
            ]
        )
        depth_m = depth_picture(scene, eye, view, floor=False)
        seen = jnp.asarray(in_cone) & (depth_m < shared.range_m)
        return jnp.min(jnp.where(seen, depth_m * long, shared.range_m))

    found = jax.vmap(nearest)(jnp.arange(shared.finders, dtype=pose.dtype))
    return {"finder_m": _noisy(jnp.minimum(found, shared.range_m), own, now, _STREAMS)}


def _noisy(
    true_m: Float[Array, "finders"], own: RangeFinders | CliffSensors, now: Situation, streams: tuple[int, int]
) -> Float[Array, "finders"]:
    errors = Lidar(0, own.range_m, 0.0, sigma_m=own.sigma_m, dropout=own.dropout)
    return noisy_ranges(true_m, errors, now.seed, now.step, streams)


def _below(shared: CliffSensors, own: CliffSensors, start_m: Memory, now: Situation) -> Fields:
    scene = now.scene
    if scene is None:
        raise ValueError("no scene was staged for a robot with cliff sensors")
    view = View(1, 1, 0.01, math.pi / 2, shared.range_m)

    def nearest(number: Array) -> Float[Array, ""]:
        bearing = own.first_rad + own.apart_rad * number
        place = place_of(now.body, start_m, own.out_m * jnp.cos(bearing), own.out_m * jnp.sin(bearing), own.z_m)
        return depth_picture(scene, jnp.append(place, 0.0), view)[0, 0]

    found = jax.vmap(nearest)(jnp.arange(shared.sensors, dtype=now.body.qpos.dtype))
    return {"cliff_m": _noisy(found, own, now, _CLIFF_STREAMS)}


_AROUND = dict.fromkeys(("first_rad", "apart_rad", "out_m"), (-1e4, 1e4)) | {"dropout": (0.0, 1.0)}
RANGE_FINDERS = Sensor(
    name="range_finders",
    kind=RangeFinders,
    absent=None,
    blank=lambda shared: {"finder_m": jnp.full(shared.finders, shared.range_m)},
    observe=_observe,
    limits={
        "finders": (1, 64),
        "range_m": (0.01, 1e4),
        "cone_rad": (0.01, 2.0),
        **_AROUND,
    },
    whole=("finders",),
    shared=("finders", "range_m", "cone_rad"),
    streams=_STREAMS,
)

CLIFF_SENSORS = Sensor(
    name="cliff_sensors",
    kind=CliffSensors,
    absent=None,
    blank=lambda shared: {"cliff_m": jnp.full(shared.sensors, shared.range_m)},
    begin=lambda _shared, _own, start: height_of(start.body),
    feel=lambda _shared, _own, start_m, _drive: start_m,
    observe=_below,
    limits={"sensors": (1, 64), "range_m": (0.01, 1e4), **_AROUND},
    whole=("sensors",),
    shared=("sensors", "range_m"),
    streams=_CLIFF_STREAMS,
)
