"""The lidar: ranges in a plane, from where it is mounted, with its noise."""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Float32, Int

from tasks.simulate.geometry.lidar_scan import scan_ranges
from tasks.simulate.sensors.sensor import Fields, Memory, Scalar, Seed, Sensor, Situation, is_set, rotate, step_key

_TURN_RAD = 2 * math.pi
_NOISE, _DROPOUT = 0, 1


class Lidar(NamedTuple):
    """A planar lidar.

    Attributes:
        rays: How many, evenly spread counter-clockwise: over the full turn, beginning straight ahead, or over the field
            of view, from its right edge to its left one.
        range_m: What it reports where nothing is nearer.
        height_m: Its plane's height above the floor.
        fov_rad: Its field of view; straight ahead is in the middle.
        x_m, y_m, yaw_rad: Where it is mounted on the robot: ahead, to the left, turned counter-clockwise.
        sigma_m: Standard deviation of a range, at any distance.
        sigma_share: Standard deviation that grows with the distance, as a share of it.
        dropout: Probability that a ray reports the range although something is nearer.
        resolution_m: Ranges are rounded to multiples of it; 0 for none.
        rate_hz, latency_steps: When it scans, and how old a scan is then, as ``PacedDeclaration`` has it.
    """

    rays: int
    range_m: float
    height_m: float
    fov_rad: float = _TURN_RAD
    x_m: Scalar = 0.0
    y_m: Scalar = 0.0
    yaw_rad: Scalar = 0.0
    sigma_m: Scalar = 0.0
    sigma_share: Scalar = 0.0
    dropout: Scalar = 0.0
    resolution_m: Scalar = 0.0
    rate_hz: float = 0.0
    latency_steps: int = 0


NO_LIDAR = Lidar(rays=0, range_m=1.0, height_m=0.0)


def ray_angles(lidar: Lidar) -> Float32[np.ndarray, "rays"]:
    """Returns the rays' directions in the lidar's own frame, radians counter-clockwise from straight ahead."""
    steps = np.arange(lidar.rays)
    if lidar.fov_rad >= _TURN_RAD:
        return (_TURN_RAD * steps / max(lidar.rays, 1)).astype(np.float32)
    from_right = steps / (lidar.rays - 1) if lidar.rays > 1 else np.full(1, 0.5)
    return (lidar.fov_rad * (from_right - 0.5)).astype(np.float32)


def noisy_ranges(
    ranges_m: Float[Array, "rays"],
    lidar: Lidar,
    seed: Seed,
    step: Int[Array, ""],
    streams: tuple[int, int] = (_NOISE, _DROPOUT),
) -> Float[Array, "rays"]:
    """Returns ranges as a lidar reports them: noise, then resolution, then dropouts; what sees nothing stays so.

    Without any noise declared they are returned as they are, bit for bit.

    Args:
        ranges_m: True ranges.
        lidar: How it errs.
        seed: The episode's.
        step: Which control step; each has its own errors.
        streams: Numbers of the noise and of the dropouts, of another sensor that errs as a lidar does.
    """
    noisy = ranges_m
    if is_set(lidar.sigma_m) or is_set(lidar.sigma_share):
        sigma_m = lidar.sigma_m + lidar.sigma_share * ranges_m
        noisy = noisy + sigma_m * jax.random.normal(step_key(seed, streams[0], step), ranges_m.shape, ranges_m.dtype)
    if is_set(lidar.resolution_m):
        mark_m = jnp.where(lidar.resolution_m > 0.0, lidar.resolution_m, 1.0)
        noisy = jnp.where(lidar.resolution_m > 0.0, mark_m * jnp.round(noisy / mark_m), noisy)
    if noisy is not ranges_m:
        noisy = jnp.clip(noisy, 0.0, lidar.range_m)
    if is_set(lidar.dropout):
        lost = jax.random.uniform(step_key(seed, streams[1], step), ranges_m.shape) < lidar.dropout
        noisy = jnp.where(lost, lidar.range_m, noisy)
    return ranges_m if noisy is ranges_m else jnp.where(ranges_m < lidar.range_m, noisy, ranges_m)


def _observe(shared: Lidar, own: Lidar, _memory: Memory, situation: Situation) -> Fields:
    return {"ranges_m": _scan(shared, own, situation)}


def _scan(shared: Lidar, own: Lidar, situation: Situation) -> Float[Array, "rays"]:
    if shared.rays == 0:
        return jnp.zeros(0)
    pose = situation.body.qpos
    mount = (own.x_m, own.y_m, own.yaw_rad)
    if any(map(is_set, mount)):
        offset = jnp.stack([jnp.asarray(value, pose.dtype) for value in mount])
        pose = pose + rotate(offset, pose[2])
    ranges = scan_ranges(situation.outlines, pose, ray_angles(shared), shared.range_m)
    return noisy_ranges(ranges, own, situation.seed, situation.step)


def _blank(shared: Lidar) -> Fields:
    return {"ranges_m": jnp.zeros(shared.rays)}


LIDAR = Sensor(
    name="lidar",
    kind=Lidar,
    absent=NO_LIDAR,
    blank=_blank,
    observe=_observe,
    limits={
        "rays": (1, 4096),
        "range_m": (0.01, 1e4),
        "fov_rad": (1e-3, _TURN_RAD + 1e-6),
        "x_m": (-1e4, 1e4),
        "y_m": (-1e4, 1e4),
        "yaw_rad": (-1e4, 1e4),
        "dropout": (0.0, 1.0),
    },
    whole=("rays",),
    shared=("rays", "range_m", "height_m", "fov_rad"),
    streams=(_NOISE, _DROPOUT),
)
