"""The obstacle window of the planar engine: the nearest obstacles, as scalars relative to where the robot stands.

One lane's scalars become vectors over lanes when the program maps it, so that everything downstream is elementwise and
vectorises; arrays of one lane's obstacles would put eight numbers, not all lanes, into the innermost loop.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from tasks.simulate.engine.planar.algebra import Scalar
from tasks.simulate.surroundings.lidar import Boxes, Cylinders
from tasks.simulate.surroundings.obstacle_distance import to_boxes_m, to_cylinders_m

_NEVER = 2**31 - 1


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


def window(boxes: Boxes, cylinders: Cylinders, center_m: Float[jax.Array, "2"], count: int) -> list[Obstacle]:
    """Returns the obstacles nearest to a point, seen from above, nearest first.

    Args:
        boxes: Of the world, in the hull's band of heights.
        cylinders: Likewise.
        center_m: The point (x, y).
        count: How many, boxes and cylinders together.
    """
    box_count = boxes.shape[0]
    distances = jnp.concatenate([to_boxes_m(boxes, center_m), to_cylinders_m(cylinders, center_m)])
    nearest = _smallest(distances, min(count, distances.shape[0]))
    near_boxes = boxes[jnp.minimum(nearest, box_count - 1)]
    near_cylinders = cylinders[jnp.maximum(nearest - box_count, 0)]
    round_ones = nearest >= box_count
    return [_obstacle(near_boxes[k], near_cylinders[k], round_ones[k], center_m) for k in range(nearest.shape[0])]


def distance_m(obstacles: list[Obstacle], x: Scalar, y: Scalar) -> Scalar:
    """Returns how far a point is from the nearest of the obstacles; at most 0 inside one."""
    nearest = jnp.full_like(x, jnp.inf)
    for each in obstacles:
        dx, dy = x - each.x, y - each.y
        beyond_x = jnp.maximum(jnp.abs(each.cos * dx + each.sin * dy) - each.half_x, 0.0)
        beyond_y = jnp.maximum(jnp.abs(each.cos * dy - each.sin * dx) - each.half_y, 0.0)
        nearest = jnp.minimum(nearest, jnp.sqrt(beyond_x**2 + beyond_y**2) - each.radius)
    return nearest


def _smallest(distances: Float[jax.Array, "obstacles"], count: int) -> Int[jax.Array, "nearest"]:
    """Returns the places of the smallest distances.

    A place is written into the last bits of its distance (as integers, floats from 0 up sort as they do), so that each
    round is one minimum over whole vectors; ``top_k`` takes six times as long as all of a control step's physics.
    Distances that differ by less than a 30,000th of themselves may change places.
    """
    bits = max(1, (distances.shape[0] - 1).bit_length())
    place_mask = (1 << bits) - 1
    ordered = jax.lax.bitcast_convert_type(jnp.maximum(distances, 0.0), jnp.int32)
    keys = (ordered & ~place_mask) | jnp.arange(distances.shape[0], dtype=jnp.int32)
    chosen: list[Int[jax.Array, ""]] = []
    last = jnp.int32(-1)
    for _ in range(count):
        last = jnp.min(jnp.where(keys > last, keys, _NEVER))
        chosen.append(last & place_mask)
    return jnp.stack(chosen)


def _obstacle(
    box: Float[jax.Array, "8"],
    cylinder: Float[jax.Array, "5"],
    is_round: Bool[jax.Array, ""],
    center_m: Float[jax.Array, "2"],
) -> Obstacle:
    def either(of_cylinder: Scalar | float, of_box: Scalar | float) -> Scalar:
        return jnp.where(is_round, of_cylinder, of_box)

    return Obstacle(
        x=either(cylinder[0], box[0]) - center_m[0],
        y=either(cylinder[1], box[1]) - center_m[1],
        half_x=either(0.0, box[3]),
        half_y=either(0.0, box[4]),
        cos=either(1.0, box[6]),
        sin=either(0.0, box[7]),
        radius=either(cylinder[3], 0.0),
        height=either(cylinder[2], box[2]),
        half_height=either(cylinder[4], box[5]),
        round=is_round,
    )
