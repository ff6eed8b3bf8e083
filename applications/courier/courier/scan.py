"""What the courier's lidar is, and what its scan says: where rays end, and how far the hull can go on."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Float32

from .planning import RADIUS_M

Number = float | Float[jax.Array, ""]


class Lidar(NamedTuple):
    """A planar lidar; ``height_m`` is above the floor."""

    rays: int = 32
    range_m: float = 10.0
    height_m: float = 0.2
    sigma_m: Number = 0.0
    dropout: Number = 0.0


def angles_rad() -> Float32[np.ndarray, "rays"]:
    """Returns the directions of the lidar's rays in the robot's frame."""
    return (2 * np.pi * np.arange(Lidar().rays) / Lidar().rays).astype(np.float32)


def ray_directions() -> tuple[Float[jax.Array, "rays"], Float[jax.Array, "rays"]]:
    """Returns the same as vectors."""
    angles = 2 * np.pi * np.arange(Lidar().rays) / Lidar().rays
    return jnp.asarray(np.cos(angles), jnp.float32), jnp.asarray(np.sin(angles), jnp.float32)


def ends_of(pose: Float[jax.Array, "3"], ranges_m: Float[jax.Array, "rays"]) -> Float[jax.Array, "rays 2"]:
    """Returns where the rays of a scan end, in the map's frame."""
    angles = pose[2] + jnp.asarray(angles_rad())
    return pose[:2] + ranges_m[:, None] * jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=1)


def free_ahead(ranges_m: Float[jax.Array, "rays"]) -> Float[jax.Array, "rays"]:
    """Returns how far the hull can go straight on before it touches each ray's end; far for rays that it passes."""
    ray_x, ray_y = ray_directions()
    along, across = ranges_m * ray_x, ranges_m * ray_y
    reach = jnp.sqrt(jnp.maximum(RADIUS_M**2 - across**2, 0.0))
    in_way = (along > 0.0) & (jnp.abs(across) < RADIUS_M)
    return jnp.where(in_way, along - reach, Lidar().range_m)


def free_behind(ranges_m: Float[jax.Array, "rays"]) -> Float[jax.Array, "rays"]:
    """Returns the same of going straight back."""
    return free_ahead(jnp.roll(ranges_m, Lidar().rays // 2))
