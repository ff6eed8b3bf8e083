"""The distance of a point from the obstacles of a world, seen from above."""

import jax
import jax.numpy as jnp
from jaxtyping import Float

from tasks.simulate.surroundings.lidar import Boxes, Cylinders


def to_boxes_m(boxes: Boxes, center_m: Float[jax.Array, "2"]) -> Float[jax.Array, "boxes"]:
    """Returns how far a point is from each box; 0 inside one."""
    dx, dy = center_m[0] - boxes[:, 0], center_m[1] - boxes[:, 1]
    cos, sin = boxes[:, 6], boxes[:, 7]
    beyond_x = jnp.maximum(jnp.abs(cos * dx + sin * dy) - boxes[:, 3], 0.0)
    beyond_y = jnp.maximum(jnp.abs(cos * dy - sin * dx) - boxes[:, 4], 0.0)
    return jnp.sqrt(beyond_x**2 + beyond_y**2)


def to_cylinders_m(cylinders: Cylinders, center_m: Float[jax.Array, "2"]) -> Float[jax.Array, "cylinders"]:
    """Returns how far a point is from the side of each cylinder; negative inside one."""
    dx, dy = center_m[0] - cylinders[:, 0], center_m[1] - cylinders[:, 1]
    return jnp.sqrt(dx**2 + dy**2) - cylinders[:, 3]
