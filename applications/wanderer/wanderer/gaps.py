"""Where the hull fits through: how far it could go straight on in each direction that the lidar sees."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Float64, Int

# What a turn counts beside the way that it is off.
_LAZY = 0.25
Rays = Float[jax.Array, "rays"]
Headings = Float[jax.Array, "headings"]
Host = Float64[np.ndarray, "_"]


def free_ways_m(ranges_m: Rays, angles_rad: Host, headings_rad: Host, radius_m: float, range_m: float) -> Headings:
    """Returns for each heading how far a disc can go before it touches a ray's end.

    Gaps need no search of their own: a heading leads through one if the disc passes (compare V. Sezer and M. Gokasan,
    Follow the gap, 2012, where a gap is as wide as the angle between the rays beside it).

    Args:
        ranges_m: The scan, seen from the disc's centre; what sees nothing has ``range_m`` and is in nobody's way.
        angles_rad: The rays' directions.
        headings_rad: The headings.
        radius_m: The disc's radius.
        range_m: The lidar's range.
    """
    # Headings lie in the last axis, so that vector units work on neighbouring ones.
    turn = angles_rad[:, None] - headings_rad[None]
    ends_m = ranges_m[:, None]
    along = ends_m * jnp.asarray(np.cos(turn), jnp.float32)
    across = ends_m * jnp.asarray(np.sin(turn), jnp.float32)
    reach_2 = radius_m**2 - across**2
    in_way = (along > 0.0) & (reach_2 > 0.0) & (ends_m < range_m)
    return jnp.min(jnp.where(in_way, along - jnp.sqrt(jnp.maximum(reach_2, 0.0)), range_m), axis=0)


def towards(
    wish_rad: Float[jax.Array, ""], is_open: Bool[jax.Array, "headings"], headings_rad: Host
) -> Int[jax.Array, ""]:
    """Returns which open heading is nearest to the wished one; of two alike the one that is less of a turn."""
    headings = jnp.asarray(headings_rad, jnp.float32)
    off = jnp.abs(between(headings, wish_rad)) + _LAZY * jnp.abs(headings)
    return jnp.argmin(jnp.where(is_open, off, jnp.inf))


def along_wall(
    side: jax.Array, ranges_m: Rays, angles_rad: Host, is_open: Bool[jax.Array, "headings"], headings_rad: Host
) -> Int[jax.Array, ""]:
    """Returns the first open heading, turning away from what is nearest: it leads along it, and around its corners.

    Args:
        side: 1 to keep it on the left, -1 on the right.
        ranges_m: The scan.
        angles_rad: The rays' directions.
        is_open: For each heading.
        headings_rad: The headings, from the right to the left.
    """
    nearest = jnp.asarray(angles_rad, jnp.float32)[jnp.argmin(ranges_m)]
    headings = jnp.asarray(headings_rad, jnp.float32)
    # From 0 straight at it to nearly a full turn, the other way round than the wall lies.
    turn = (side * (nearest - headings)) % (2 * jnp.pi)
    return jnp.argmin(jnp.where(is_open, turn, jnp.inf))


def between(one_rad: jax.Array, other_rad: jax.Array) -> jax.Array:
    """Returns the turn from one direction to another, at most half a turn to either side."""
    return (one_rad - other_rad + jnp.pi) % (2 * jnp.pi) - jnp.pi
