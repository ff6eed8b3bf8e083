"""The distance of a point, or of a robot's hull part by part, from the obstacles of a world, seen from above."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Float64

from tasks.simulate.geometry.hull_outline import HullPart
from tasks.simulate.geometry.lidar_scan import Boxes, Cylinders
from tasks.simulate.geometry.obstacles import PARKING_M


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


# Obstacles nearest to the robot's centre that an outline is compared with; a disc is compared with all.
_BOXES_LOOKED_AT, _CYLINDERS_LOOKED_AT = 8, 4
# Divisors are at least this: the edge of a rod that is no longer than a speck.
_TINY_M2 = 1e-12
Points = Float[Array, "obstacles points 2"]


# A part is an outline (one corner for a disc, two for a rod, more for a polygon) and a radius around it. Two convex
# outlines that overlap are as deep in each other as the least gap along any of their edges' normals says; two that do
# not are as far apart as the nearest corner of one and edge of the other.
def hull_distance_m(
    parts: Sequence[HullPart], boxes: Boxes, cylinders: Cylinders, pose: Float[jax.Array, "3"]
) -> Float[jax.Array, ""]:
    """Returns how far the nearest part of a robot is from the nearest obstacle at its heights; below 0 inside one.

    Args:
        parts: Of the hull.
        boxes: Obstacles in the hull's band of heights.
        cylinders: Likewise.
        pose: Of the robot's base.
    """
    alone, round_one = len(parts) == 1, all(len(part.corners) == 1 for part in parts)
    if not round_one:
        boxes = _nearest(boxes, to_boxes_m(boxes, pose[:2]), _BOXES_LOOKED_AT)
        cylinders = _nearest(cylinders, to_cylinders_m(cylinders, pose[:2]), _CYLINDERS_LOOKED_AT)
    distances = [_part_distance_m(part, boxes, cylinders, pose, alone=alone) for part in parts]
    return jnp.stack(distances).min()


def _nearest(obstacles: Array, distances: Float[Array, "n"], count: int) -> Array:
    """Returns those obstacles that are nearest to the robot's centre, nearest first, if there are more."""
    places, chosen = jnp.arange(len(distances)), list[Array]()
    if len(distances) <= count:
        return obstacles
    for _ in range(count):
        chosen.append(jnp.argmin(distances))
        distances = jnp.where(places == chosen[-1], jnp.inf, distances)
    return obstacles[jnp.stack(chosen)]


def _part_distance_m(
    part: HullPart, boxes: Boxes, cylinders: Cylinders, pose: Float[jax.Array, "3"], *, alone: bool
) -> Float[jax.Array, ""]:
    cos, sin = jnp.cos(pose[2]), jnp.sin(pose[2])
    if len(part.corners) == 1:
        center = pose[:2] if not part.corners.any() else pose[:2] + _turned(jnp.asarray(part.corners[0]), cos, sin)
        to_boxes, to_cylinders = to_boxes_m(boxes, center), to_cylinders_m(cylinders, center)
    else:
        to_boxes, to_cylinders = _outline_to_boxes_m(part, boxes, pose), _outline_to_cylinders_m(part, cylinders, pose)
    if not alone and np.isfinite(part.low_m):
        to_boxes = jnp.where(_beside(part, boxes[:, 2], boxes[:, 5]), to_boxes, PARKING_M)
        to_cylinders = jnp.where(_beside(part, cylinders[:, 2], cylinders[:, 4]), to_cylinders, PARKING_M)
    return jnp.minimum(to_boxes.min(), to_cylinders.min()) - part.radius_m


def _beside(part: HullPart, height: Float[Array, "n"], half_height: Float[Array, "n"]) -> Bool[Array, "n"]:
    """Returns which obstacles are at a part's heights."""
    return (height - half_height < part.high_m) & (height + half_height > part.low_m)


def _outline_to_boxes_m(part: HullPart, boxes: Boxes, pose: Float[jax.Array, "3"]) -> Float[Array, "boxes"]:
    cos, sin, own = jnp.cos(pose[2]), jnp.sin(pose[2]), jnp.asarray(part.corners, pose.dtype)
    box_cos, box_sin, half = boxes[:, 6:7], boxes[:, 7:8], boxes[:, None, 3:5]
    # The part's corners in each box's frame.
    placed = pose[:2] + _turned(own, cos, sin)
    there = _turned(placed[None] - boxes[:, None, :2], box_cos, -box_sin)
    to_faces = jnp.linalg.norm(jnp.maximum(jnp.abs(there) - half, 0.0), axis=-1).min(axis=1)
    box_gap = jnp.maximum(there.min(axis=1) - half[:, 0], -there.max(axis=1) - half[:, 0]).max(axis=1)
    # Each box's corners in the part's frame.
    signs = jnp.asarray([[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]], pose.dtype)
    box_corners = boxes[:, None, :2] + _turned(signs * half, box_cos, box_sin)
    here = _turned(box_corners - pose[:2], cos, -sin)
    to_edges, part_gap = _to_edges_m(part.corners, here)
    apart = jnp.minimum(to_faces, to_edges.min(axis=1))
    gap = jnp.maximum(box_gap, part_gap.min(axis=1).max(axis=-1))
    return jnp.where(gap > 0.0, apart, gap)


def _outline_to_cylinders_m(
    part: HullPart, cylinders: Cylinders, pose: Float[jax.Array, "3"]
) -> Float[Array, "cylinders"]:
    here = _turned(cylinders[:, None, :2] - pose[:2], jnp.cos(pose[2]), -jnp.sin(pose[2]))
    to_edges, gaps = _to_edges_m(part.corners, here)
    gap = gaps[:, 0].max(axis=-1)
    return jnp.where(gap > 0.0, to_edges[:, 0], gap) - cylinders[:, 3]


def _to_edges_m(
    corners: Float64[np.ndarray, "corners 2"], points: Points
) -> tuple[Float[Array, "obstacles points"], Float[Array, "obstacles points edges"]]:
    """Returns how far points are from an outline's nearest edge, and how far beyond the line of each edge."""
    ends = np.roll(corners, -1, axis=0)
    along = ends - corners
    length = np.maximum(np.linalg.norm(along, axis=1), np.sqrt(_TINY_M2))
    outward = np.stack([along[:, 1], -along[:, 0]], axis=1) / length[:, None]
    from_corner = points[:, :, None] - jnp.asarray(corners, points.dtype)
    beyond = (from_corner * jnp.asarray(outward, points.dtype)).sum(axis=-1)
    passed = (from_corner * jnp.asarray(along / length[:, None], points.dtype)).sum(axis=-1)
    past = passed - jnp.clip(passed, 0.0, jnp.asarray(length, points.dtype))
    return jnp.sqrt(beyond**2 + past**2).min(axis=-1), beyond


def _turned(vectors: Array, cos: Array, sin: Array) -> Array:
    """Returns vectors (..., 2) turned counter-clockwise; cosine and sine have one axis less, or none."""
    x, y = vectors[..., 0], vectors[..., 1]
    return jnp.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)
