"""The distance of a point, or of a robot's hull part by part, from the obstacles of a world, seen from above."""

import functools
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Float64

from specs.data.people import PERSON_HEIGHT_M, PERSON_RADIUS_M
from specs.data.world import MOST_CORNERS
from tasks.simulate.geometry.hull_outline import HullPart
from tasks.simulate.geometry.obstacles import PARKING_M

Boxes = Float[Array, "boxes 8"]
Cylinders = Float[Array, "cylinders 5"]
Prisms = Float[Array, "prisms 20"]
# Divisors are at least this: the edge of a rod, or a prism's, that is no longer than a speck.
_TINY_M2 = 1e-12


class LaneObstacles(NamedTuple):
    """Obstacles of a lane, on its device; as in ``Obstacles``. Where no world of a program has prisms, none are."""

    boxes: Boxes
    cylinders: Cylinders
    prisms: Prisms


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


Numbers = Float[Array, "..."]


class Outline(NamedTuple):
    """A convex outline as numbers, or many as vectors: all that is done with them is elementwise.

    Attributes:
        corners: Counter-clockwise; a repeated one is an edge without a length, which changes nothing.
        per_square: One by the square of the length of the edge that begins at each corner.
    """

    corners: list[tuple[Numbers, Numbers]]
    per_square: list[Numbers]


def outline_of(columns: Float[Array, "16 ..."] | Sequence[Numbers]) -> Outline:
    """Returns outlines, given x and y of each corner in turn."""
    corners = [(columns[2 * k], columns[2 * k + 1]) for k in range(MOST_CORNERS)]
    edges = [(x - from_x, y - from_y) for (from_x, from_y), (x, y) in _edges(corners)]
    return Outline(corners, [1.0 / jnp.maximum(along_x**2 + along_y**2, _TINY_M2) for along_x, along_y in edges])


def _edges(
    corners: list[tuple[Numbers, Numbers]],
) -> list[tuple[tuple[Numbers, Numbers], tuple[Numbers, Numbers]]]:
    return list(zip(corners, [*corners[1:], corners[0]], strict=True))


def from_border(outline: Outline, x: Numbers, y: Numbers) -> tuple[Numbers, Numbers, Numbers, Bool[Array, "..."]]:
    """Returns the way to a point from the nearest place on an outline (x, y, its square), and whether it is inside."""
    nearest, way_x, way_y, inside = jnp.full_like(x, jnp.inf), x, y, jnp.ones_like(x, bool)
    for ((from_x, from_y), (to_x, to_y)), per_square in zip(_edges(outline.corners), outline.per_square, strict=True):
        along_x, along_y, off_x, off_y = to_x - from_x, to_y - from_y, x - from_x, y - from_y
        share = jnp.clip((along_x * off_x + along_y * off_y) * per_square, 0.0, 1.0)
        beside_x, beside_y = off_x - share * along_x, off_y - share * along_y
        squared = beside_x**2 + beside_y**2
        nearer = squared < nearest
        nearest = jnp.where(nearer, squared, nearest)
        way_x, way_y = jnp.where(nearer, beside_x, way_x), jnp.where(nearer, beside_y, way_y)
        inside &= along_x * off_y - along_y * off_x >= 0.0
    return way_x, way_y, nearest, inside


def to_prisms_m(prisms: Prisms, center_m: Float[jax.Array, "2"]) -> Float[jax.Array, "prisms"]:
    """Returns how far a point is from each prism; 0 inside one."""
    x, y, _, _, *corners = prisms.T
    return to_outlines_m(corners, center_m[0] - x, center_m[1] - y)


def to_outlines_m(columns: Sequence[Float[jax.Array, "n"]], x: Numbers, y: Numbers) -> Float[jax.Array, "n"]:
    """Returns how far points are from outlines; 0 inside one.

    Args:
        columns: x and y of each corner in turn, of all outlines.
        x: Of each point, from its outline's middle.
        y: Likewise.
    """
    *_, squared, inside = from_border(outline_of(columns), x, y)
    return jnp.where(inside, 0.0, jnp.sqrt(squared))


def to_obstacles_m(obstacles: LaneObstacles, center_m: Float[jax.Array, "2"]) -> list[Float[jax.Array, "n"]]:
    """Returns how far a point is from each obstacle, kind by kind, of those kinds that there are."""
    found = [to_boxes_m(obstacles.boxes, center_m), to_cylinders_m(obstacles.cylinders, center_m)]
    return [*found, to_prisms_m(obstacles.prisms, center_m)] if len(obstacles.prisms) else found


# Boxes, cylinders and prisms nearest to the robot's centre that an outline is compared with; a disc: with all.
_LOOKED_AT = (8, 4, 8)
Points = Float[Array, "obstacles points 2"]


# A part is an outline (one corner for a disc, two for a rod, more for a polygon) and a radius around it. Two convex
# outlines that overlap are as deep in each other as the least gap along any of their edges' normals says; two that do
# not are as far apart as the nearest corner of one and edge of the other.
def hull_distance_m(
    parts: Sequence[HullPart], obstacles: LaneObstacles, pose: Float[jax.Array, "3"]
) -> Float[jax.Array, ""]:
    """Returns how far the nearest part of a robot is from the nearest obstacle at its heights; below 0 inside one.

    Args:
        parts: Of the hull.
        obstacles: In the hull's band of heights.
        pose: Of the robot's base.
    """
    alone, round_one = len(parts) == 1, all(len(part.corners) == 1 for part in parts)
    if not round_one:
        apart_m = to_obstacles_m(obstacles, pose[:2])
        near = [_nearest(*kind) for kind in zip(obstacles, apart_m, _LOOKED_AT, strict=False)]
        obstacles = LaneObstacles(*near, *obstacles[len(near) :])
    distances = [_part_distance_m(part, obstacles, pose, alone=alone) for part in parts]
    return jnp.stack(distances).min()


def hull_to_people_m(
    parts: Sequence[HullPart], people_m: Float[jax.Array, "people 2"], pose: Float[jax.Array, "3"]
) -> Float[jax.Array, ""]:
    """Returns how far the nearest part of a robot is from the nearest person; below 0 inside one.

    Args:
        parts: Of the hull.
        people_m: Where people stand (x, y).
        pose: Of the robot's base.
    """
    half_m = PERSON_HEIGHT_M / 2
    same = jnp.broadcast_to(jnp.array([half_m, PERSON_RADIUS_M, half_m], people_m.dtype), (len(people_m), 3))
    no_box = jnp.array([[PARKING_M, PARKING_M, half_m, 0.0, 0.0, half_m, 1.0, 0.0]], people_m.dtype)
    people = LaneObstacles(no_box, jnp.concatenate([people_m, same], axis=1), jnp.zeros((0, 4 + 2 * MOST_CORNERS)))
    return hull_distance_m(parts, people, pose)


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
    part: HullPart, obstacles: LaneObstacles, pose: Float[jax.Array, "3"], *, alone: bool
) -> Float[jax.Array, ""]:
    boxes, cylinders, prisms = obstacles
    cos, sin = jnp.cos(pose[2]), jnp.sin(pose[2])
    if len(part.corners) == 1:
        center = pose[:2] if not part.corners.any() else pose[:2] + _turned(jnp.asarray(part.corners[0]), cos, sin)
        found = to_obstacles_m(obstacles, center)
    else:
        found = [_outline_to_boxes_m(part, boxes, pose), _outline_to_cylinders_m(part, cylinders, pose)]
        found += [_outline_to_prisms_m(part, prisms, pose)] if len(prisms) else []
    if not alone and np.isfinite(part.low_m):
        heights = [(boxes[:, 2], boxes[:, 5]), (cylinders[:, 2], cylinders[:, 4]), (prisms[:, 2], prisms[:, 3])]
        beside = [_beside(part, *each) for each in heights]
        found = [jnp.where(*kind, PARKING_M) for kind in zip(beside, found, strict=False)]
    return functools.reduce(jnp.minimum, [each.min() for each in found]) - part.radius_m


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


def _outline_to_prisms_m(part: HullPart, prisms: Prisms, pose: Float[jax.Array, "3"]) -> Float[Array, "prisms"]:
    cos, sin, own = jnp.cos(pose[2]), jnp.sin(pose[2]), jnp.asarray(part.corners, pose.dtype)
    outline = outline_of(prisms[:, 4:].T)
    # The part's corners beside each prism, and each prism's corners in the part's frame.
    placed = (pose[:2] + _turned(own, cos, sin))[None] - prisms[:, None, :2]
    whole = Outline(*jax.tree.map(lambda column: column[:, None], tuple(outline)))
    *_, squared, _ = from_border(whole, placed[..., 0], placed[..., 1])
    corners = prisms[:, None, :2] + prisms[:, 4:].reshape(-1, MOST_CORNERS, 2)
    to_edges, part_gap = _to_edges_m(part.corners, _turned(corners - pose[:2], cos, -sin))
    apart = jnp.minimum(jnp.sqrt(squared).min(axis=1), to_edges.min(axis=1))
    gap = part_gap.min(axis=1).max(axis=-1)
    for ((from_x, from_y), (to_x, to_y)), per_square in zip(_edges(whole.corners), whole.per_square, strict=True):
        beyond = ((to_y - from_y) * (placed[..., 0] - from_x) - (to_x - from_x) * (placed[..., 1] - from_y)).min(axis=1)
        known = per_square[:, 0] < 1.0 / _TINY_M2  # an edge without a length has no side
        gap = jnp.where(known, jnp.maximum(gap, beyond * jnp.sqrt(per_square[:, 0])), gap)
    return jnp.where(gap > 0.0, apart, gap)


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
