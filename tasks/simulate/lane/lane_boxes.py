"""Boxes in a lane: when each stands in the robot's way, and as what the robot meets and sees it.

One that appears waits until the robot is out of its place. To the robot it is a solid as any other.
"""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from specs.data.boxes import MOST_BOXES
from tasks.simulate.geometry.box_places import HostBoxes
from tasks.simulate.geometry.obstacles import PARKING_M

Arrays = Any  # of NumPy on the host, of JAX in a program
# Which of a lane's boxes stand at their places.
Standing = Bool[Arrays, "... boxes"]


class BoxesInputs(NamedTuple):
    """The boxes of a lane; fields as in ``HostBoxes``."""

    place_m: Float[Arrays, "boxes 2"]
    half_m: Float[Arrays, "boxes 3"]
    appears: Int[Arrays, "boxes"]
    leaves: Int[Arrays, "boxes"]
    touched: Bool[Arrays, "boxes"]
    room_m: Float[Arrays, ""]


def begin_boxes(boxes: BoxesInputs, robot_m: Float[Arrays, "... 2"], using: Any = jnp) -> Standing:  # noqa: ANN401 - NumPy or its like
    """Returns the boxes of a lane, or of lanes, before the first control step."""
    return boxes_at(boxes, using.zeros_like(boxes.touched), robot_m, 0, using)


def boxes_at(
    boxes: BoxesInputs,
    before: Standing,
    robot_m: Float[Arrays, "... 2"],
    step: Int[Arrays, ""] | int,
    using: Any = jnp,  # noqa: ANN401 - NumPy or its like
) -> Standing:
    """Returns which boxes stand at their places in a control step.

    Args:
        boxes: Of a lane, or of lanes.
        before: In the step before.
        robot_m: Where the robot is at the step's beginning (x, y).
        step: The control step, from 0.
        using: What computes it: JAX, or NumPy.
    """
    beyond_m = using.maximum(using.abs(robot_m[..., None, :] - boxes.place_m) - boxes.half_m[..., :2], 0.0)
    clear = using.sum(beyond_m**2, axis=-1) >= boxes.room_m[..., None] ** 2
    due = (boxes.appears <= step) & (step < boxes.leaves)
    return due & (before | clear)


def box_places_m(boxes: BoxesInputs, standing: Standing, using: Any = jnp) -> Float[Arrays, "... boxes 2"]:  # noqa: ANN401 - likewise
    """Returns where boxes are; far away, each by itself, those that are not there."""
    away = using.stack([-PARKING_M - 10.0 * np.arange(MOST_BOXES), np.full(MOST_BOXES, PARKING_M)], axis=-1)
    return using.where(standing[..., None], boxes.place_m, away.astype(boxes.place_m.dtype))


def box_solids(boxes: BoxesInputs, standing: Standing) -> Float[jax.Array, "boxes 8"]:
    """Returns boxes as obstacles in the hull's band of heights, as ``LaneObstacles.boxes``."""
    place_m = box_places_m(boxes, standing & boxes.touched)
    straight = jnp.broadcast_to(jnp.array([1.0, 0.0], place_m.dtype), place_m.shape)
    return jnp.concatenate([place_m, boxes.half_m[:, 2:], boxes.half_m, straight], axis=1)


def box_outlines(boxes: BoxesInputs, standing: Standing, height_m: float) -> Float[jax.Array, "boxes 4"]:
    """Returns boxes as a lidar sees them whose plane is at a height: (x, y, half x, half y)."""
    high = standing & (2.0 * boxes.half_m[:, 2] > height_m)
    return jnp.concatenate([box_places_m(boxes, high), boxes.half_m[:, :2]], axis=1)


def box_scene(half_m: Float[jax.Array, "boxes 3"], place_m: Float[jax.Array, "boxes 2"]) -> Float[jax.Array, "boxes 8"]:
    """Returns boxes at places as a depth camera sees them, as ``DepthScene.boxes``."""
    floor, straight = jnp.zeros_like(half_m[:, :1]), jnp.broadcast_to(jnp.array([1.0, 0.0]), place_m.shape)
    return jnp.concatenate([place_m, floor, 2.0 * half_m[:, 2:], half_m[:, :2], straight], axis=1)


def boxes_seen(
    boxes: HostBoxes | None, places_m: Float32[np.ndarray, "pictures boxes 2"]
) -> Float[jax.Array, "pictures boxes 8"] | None:
    """Returns an episode's boxes as a depth camera sees them, for each of some pictures; None without any.

    Args:
        boxes: Of the episode.
        places_m: Where each stands, picture by picture.
    """
    if boxes is None:
        return None
    return jax.vmap(functools.partial(box_scene, jnp.asarray(boxes.half_m)))(jnp.asarray(places_m))
