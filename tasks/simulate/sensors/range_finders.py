"""Range finders, ultrasonic or infrared: how near the nearest thing is in each one's cone; the floor gives no echo."""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from tasks.simulate.geometry.depth_picture import View, depth_picture, rays_of
from tasks.simulate.sensors.sensor import Fields, Memory, Scalar, Sensor, Situation, is_set, step_key

_NOISE, _DROPOUT = 9, 10
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


NO_RANGE_FINDERS = RangeFinders(finders=0, range_m=1.0, z_m=0.0)


def _observe(shared: RangeFinders, own: RangeFinders, _memory: Memory, now: Situation) -> Fields:
    if shared.finders == 0:
        return {}
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
    return {"finder_m": _noisy(jnp.minimum(found, shared.range_m), shared, own, now)}


def _noisy(
    true_m: Float[Array, "finders"], shared: RangeFinders, own: RangeFinders, now: Situation
) -> Float[Array, "finders"]:
    noisy = true_m
    if is_set(own.sigma_m):
        drawn = jax.random.normal(step_key(now.seed, _NOISE, now.step), true_m.shape, true_m.dtype)
        noisy = jnp.clip(noisy + own.sigma_m * drawn, 0.0, shared.range_m)
    if is_set(own.dropout):
        lost = jax.random.uniform(step_key(now.seed, _DROPOUT, now.step), true_m.shape) < own.dropout
        noisy = jnp.where(lost, shared.range_m, noisy)
    return jnp.where(true_m < shared.range_m, noisy, true_m)


def _blank(shared: RangeFinders) -> Fields:
    return {} if shared.finders == 0 else {"finder_m": jnp.full(shared.finders, shared.range_m)}


RANGE_FINDERS = Sensor(
    name="range_finders",
    kind=RangeFinders,
    absent=NO_RANGE_FINDERS,
    blank=_blank,
    observe=_observe,
    limits={
        "finders": (1, 64),
        "range_m": (0.01, 1e4),
        "cone_rad": (0.01, 2.0),
        "first_rad": (-1e4, 1e4),
        "apart_rad": (-1e4, 1e4),
        "out_m": (-1e4, 1e4),
        "dropout": (0.0, 1.0),
    },
    whole=("finders",),
    shared=("finders", "range_m", "cone_rad"),
    streams=(_NOISE, _DROPOUT),
)
