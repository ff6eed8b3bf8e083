"""The obstacle window of the mjx engine: the nearest obstacles, written into the slots of one MJX model.

MJX pays for every geom pair at every step, near or far. Of an apartment's hundred solids only those within reach of
the next control step can matter, so each lane's model holds slots for those, refilled at each control step.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Float

from tasks.simulate.engine.mjx.mjx_import import mjx
from tasks.simulate.engine.mjx.model import RobotModel
from tasks.simulate.surroundings.lidar import Boxes, Cylinders
from tasks.simulate.surroundings.obstacle_distance import to_boxes_m, to_cylinders_m


class ObstacleWindow(NamedTuple):
    """The nearest obstacles of one lane."""

    boxes: Boxes
    cylinders: Cylinders


def nearest_obstacles(
    boxes: Boxes, cylinders: Cylinders, center_m: Float[jax.Array, "2"], box_count: int, cylinder_count: int
) -> tuple[ObstacleWindow, Float[jax.Array, ""]]:
    """Returns the boxes and cylinders nearest to a point, seen from above, and how near the nearest is.

    Args:
        boxes: Of the world, in the hull's band of heights.
        cylinders: Likewise.
        center_m: The point (x, y).
        box_count: How many boxes.
        cylinder_count: How many cylinders.
    """
    to_boxes, to_cylinders = to_boxes_m(boxes, center_m), to_cylinders_m(cylinders, center_m)
    _, box_index = jax.lax.top_k(-to_boxes, box_count)
    _, cylinder_index = jax.lax.top_k(-to_cylinders, cylinder_count)
    window = ObstacleWindow(boxes[box_index], cylinders[cylinder_index])
    return window, jnp.minimum(to_boxes.min(), to_cylinders.min())


def with_window(robot: RobotModel, window: ObstacleWindow) -> mjx.Model:
    """Returns the robot's model with the window's obstacles in its slots."""
    base, box, cylinder = robot.model, robot.box_slots, robot.cylinder_slots
    half_yaw = jnp.arctan2(window.boxes[:, 7], window.boxes[:, 6]) / 2
    flat = jnp.zeros_like(half_yaw)
    turn = jnp.stack([jnp.cos(half_yaw), flat, flat, jnp.sin(half_yaw)], axis=-1)
    return base.replace(
        geom_pos=base.geom_pos.at[box].set(window.boxes[:, :3]).at[cylinder].set(window.cylinders[:, :3]),
        geom_quat=base.geom_quat.at[box].set(turn),
        geom_size=base.geom_size.at[box].set(window.boxes[:, 3:6]).at[cylinder, :2].set(window.cylinders[:, 3:5]),
    )
