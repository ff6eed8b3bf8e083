"""The obstacle window of the planar engine: the nearest obstacles, as scalars relative to where the robot stands.

One lane's scalars become vectors over lanes when the program maps it, so that everything downstream is elementwise and
vectorises; arrays of one lane's obstacles would put eight numbers, not all lanes, into the innermost loop.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float

from tasks.simulate.engine.planar.algebra import Scalar
from tasks.simulate.engine.planar.neighbours import Neighbours, nearest
from tasks.simulate.surroundings.lidar import Boxes, Cylinders


class Obstacle(NamedTuple):
    """A box or an upright cylinder: a rectangle grown by a radius, seen from above.

    Attributes:
        x, y: Its middle, relative to where the robot stood when the control step began.
        half_x, half_y: Of the rectangle along its own axes; 0 for a cylinder.
        cos, sin: Of the rectangle's yaw.
        radius: Of a cylinder; 0 for a box.
        height, half_height: Of its middle above the floor, and from there to its top.
        round: Whether it is a cylinder.
    """

    x: Scalar
    y: Scalar
    half_x: Scalar
    half_y: Scalar
    cos: Scalar
    sin: Scalar
    radius: Scalar
    height: Scalar
    half_height: Scalar
    round: Bool[jax.Array, ""]


def window(
    boxes: Boxes, cylinders: Cylinders, center_m: Float[jax.Array, "2"], count: int, near: Neighbours | None = None
) -> list[Obstacle]:
    """Returns the obstacles nearest to a point, seen from above, nearest first.

    Args:
        boxes: Of the world, in the hull's band of heights.
        cylinders: Likewise.
        center_m: The point (x, y).
        count: How many, boxes and cylinders together.
        near: Those that were picked out before; None if none were.
    """
    found = nearest(boxes, cylinders, center_m, count, near)
    x, y, half_x, half_y, cos, sin, radius, height, half_height = found.columns
    return [
        Obstacle(
            x=x[k] - center_m[0],
            y=y[k] - center_m[1],
            half_x=half_x[k],
            half_y=half_y[k],
            cos=cos[k],
            sin=sin[k],
            radius=radius[k],
            height=height[k],
            half_height=half_height[k],
            round=found.round[k],
        )
        for k in range(found.round.shape[0])
    ]


def distance_m(obstacles: list[Obstacle], x: Scalar, y: Scalar) -> Scalar:
    """Returns how far a point is from the nearest of the obstacles; at most 0 inside one."""
    nearest = jnp.full_like(x, jnp.inf)
    for each in obstacles:
        dx, dy = x - each.x, y - each.y
        beyond_x = jnp.maximum(jnp.abs(each.cos * dx + each.sin * dy) - each.half_x, 0.0)
        beyond_y = jnp.maximum(jnp.abs(each.cos * dy - each.sin * dx) - each.half_y, 0.0)
        nearest = jnp.minimum(nearest, jnp.sqrt(beyond_x**2 + beyond_y**2) - each.radius)
    return nearest
