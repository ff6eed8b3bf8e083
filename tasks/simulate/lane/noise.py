"""Noise that belongs to an episode's seed, a sensor and a control step, and to nothing else.

Keys are counted, not carried: what a lane draws does not depend on the lanes beside it, on how it got to that step, or
on the engine.
"""

from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key, UInt32

from tasks.simulate.application.sensors import Lidar, Odometry, is_set

Seed = UInt32[Array, "2"]
Pose = Float[Array, "3"]
Stream = Literal["lidar", "dropout", "odometry"]
_STREAMS: dict[Stream, int] = {"lidar": 0, "dropout": 1, "odometry": 2}
_WORD = 32
# A way shorter than this is none: nothing is divided by 0.
_REST_M = 1e-9


def seed_words(seed: int) -> UInt32[np.ndarray, "2"]:
    """Returns an episode's seed as the two words that ``step_key`` begins with; its lowest 64 bits count."""
    return np.array([(seed >> _WORD) & 0xFFFFFFFF, seed & 0xFFFFFFFF], np.uint32)


def step_key(seed: Seed, stream: Stream, step: Int[Array, ""]) -> Key[Array, ""]:
    """Returns the key of a sensor at a control step."""
    # Named, since JAX's default is a setting of the process.
    key = jax.random.wrap_key_data(seed, impl="threefry2x32")
    return jax.random.fold_in(jax.random.fold_in(key, _STREAMS[stream]), step)


def noisy_ranges(
    ranges_m: Float[Array, "rays"], lidar: Lidar, seed: Seed, step: Int[Array, ""]
) -> Float[Array, "rays"]:
    """Returns ranges as a lidar reports them: noise, then resolution, then dropouts; what sees nothing stays so.

    Without any noise declared they are returned as they are, bit for bit.
    """
    noisy = ranges_m
    if is_set(lidar.sigma_m) or is_set(lidar.sigma_share):
        sigma_m = lidar.sigma_m + lidar.sigma_share * ranges_m
        noisy = noisy + sigma_m * jax.random.normal(step_key(seed, "lidar", step), ranges_m.shape, ranges_m.dtype)
    if is_set(lidar.resolution_m):
        mark_m = jnp.where(lidar.resolution_m > 0.0, lidar.resolution_m, 1.0)
        noisy = jnp.where(lidar.resolution_m > 0.0, mark_m * jnp.round(noisy / mark_m), noisy)
    if noisy is not ranges_m:
        noisy = jnp.clip(noisy, 0.0, lidar.range_m)
    if is_set(lidar.dropout):
        lost = jax.random.uniform(step_key(seed, "dropout", step), ranges_m.shape) < lidar.dropout
        noisy = jnp.where(lost, lidar.range_m, noisy)
    return ranges_m if noisy is ranges_m else jnp.where(ranges_m < lidar.range_m, noisy, ranges_m)


def drifted(believed: Pose, before: Pose, after: Pose, odometry: Odometry, *, seed: Seed, step: Int[Array, ""]) -> Pose:
    """Returns the pose that a robot believes to have after a control step.

    Args:
        believed: What it believed before the step.
        before: Its true pose then.
        after: Its true pose now.
        odometry: How it errs.
        seed: The episode's.
        step: Which control step; each has its own errors.
    """
    way, turn_rad = after[:2] - before[:2], after[2] - before[2]
    way_m = jnp.sqrt(jnp.sum(way**2))
    draws = jax.random.normal(step_key(seed, "odometry", step), (2,), believed.dtype)
    longer_m = odometry.sigma_m_per_m * jnp.sqrt(way_m) * draws[0]
    yaw_variance = odometry.sigma_rad_per_m**2 * way_m + odometry.sigma_rad_per_rad**2 * jnp.abs(turn_rad)
    counted = way * (1.0 + longer_m / jnp.maximum(way_m, _REST_M))
    lead_rad = believed[2] - before[2]
    cos, sin = jnp.cos(lead_rad), jnp.sin(lead_rad)
    x, y = cos * counted[0] - sin * counted[1], sin * counted[0] + cos * counted[1]
    yaw_rad = turn_rad + jnp.sqrt(yaw_variance) * draws[1]
    return believed + jnp.stack([x, y, yaw_rad])
