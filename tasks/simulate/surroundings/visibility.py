"""The straight ways that a disc has between a world's solids, exactly, seen from above."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int

from tasks.simulate.surroundings.obstacles import PARKING_M, Obstacles

Points = Float64[np.ndarray, "points 2"]
Pair = tuple[Float64[np.ndarray, "pairs"], Float64[np.ndarray, "pairs"]]
# Solids near enough to a line to matter are looked at in pieces of this size, so that memory stays small.
_PAIRS_TOGETHER = 2_000_000
_TOUCH_M = 1e-6


class Solids(NamedTuple):
    """Outlines of what the hull can touch: boxes (a circle is one without extent) with rounded rims.

    Attributes:
        center_m, half_m: Middle and half extents.
        axis: Cosine and sine of the yaw.
        rim_m: Radius around the box that belongs to it: a cylinder's, else 0.
    """

    center_m: Float64[np.ndarray, "solids 2"]
    half_m: Float64[np.ndarray, "solids 2"]
    axis: Float64[np.ndarray, "solids 2"]
    rim_m: Float64[np.ndarray, "solids"]


def solids_of(touched: Obstacles) -> Solids:
    """Returns the outlines of obstacles without those that are parked, the cylinders last."""
    boxes, cylinders = (each[np.abs(each[:, 0]) < PARKING_M].astype(np.float64) for each in touched)
    flat = np.zeros((len(cylinders), 2))
    return Solids(
        center_m=np.concatenate([boxes[:, :2], cylinders[:, :2]]),
        half_m=np.concatenate([boxes[:, 3:5], flat]),
        axis=np.concatenate([boxes[:, 6:8], np.tile([1.0, 0.0], (len(cylinders), 1))]),
        rim_m=np.concatenate([np.zeros(len(boxes)), cylinders[:, 3]]),
    )


def clearance_m(solids: Solids, points: Points) -> Float64[np.ndarray, "points"]:
    """Returns each point's distance to the nearest solid; 0 inside a box."""
    nearest = np.full(len(points), np.inf)
    for center, half, axis, rim in zip(*solids, strict=True):
        x, y = _local(points, center, axis)
        distance = np.hypot(np.maximum(np.abs(x) - half[0], 0.0), np.maximum(np.abs(y) - half[1], 0.0)) - rim
        np.minimum(nearest, distance, out=nearest)
    return np.maximum(nearest, 0.0)


def is_free(solids: Solids, starts: Points, ends: Points, radius_m: float) -> Bool[np.ndarray, "points"]:
    """Returns whether a disc gets straight from each start to its end without touching a solid.

    Both ends must be free themselves.

    Args:
        solids: What is in the way.
        starts: Where each line begins.
        ends: Where it ends.
        radius_m: The disc's.
    """
    free = np.ones(len(starts), bool)
    reach = np.hypot(*solids.half_m.T) + solids.rim_m + radius_m
    step = max(1, _PAIRS_TOGETHER // max(len(starts), 1))
    for first in range(0, len(reach), step):
        some = slice(first, first + step)
        line, solid = _near(solids.center_m[some], reach[some], starts, ends)
        solid += first
        open_line = free[line]
        line, solid = line[open_line], solid[open_line]
        free[line[_blocks(solids, solid, starts[line], ends[line], radius_m)]] = False
    return free


def _near(
    centers: Float64[np.ndarray, "solids 2"], reach: Float64[np.ndarray, "solids"], starts: Points, ends: Points
) -> tuple[Int[np.ndarray, "pairs"], Int[np.ndarray, "pairs"]]:
    """Returns the pairs (line, solid) where the circle around the solid, grown by the disc, meets the line."""
    way = ends - starts
    length = np.maximum(np.hypot(way[:, 0], way[:, 1]), _TOUCH_M)
    unit = way / length[:, None]
    to_x, to_y = centers[:, 0] - starts[:, :1], centers[:, 1] - starts[:, 1:]
    along = unit[:, :1] * to_x + unit[:, 1:] * to_y
    across = unit[:, :1] * to_y - unit[:, 1:] * to_x
    line, solid = np.nonzero((np.abs(across) < reach) & (along > -reach) & (along < length[:, None] + reach))
    return line, solid


def _blocks(
    solids: Solids, solid: Int[np.ndarray, "pairs"], starts: Points, ends: Points, radius_m: float
) -> Bool[np.ndarray, "pairs"]:
    """Returns whether a line comes nearer to its solid than the radius: it crosses it, or passes a corner too near."""
    center, half, axis = solids.center_m[solid], solids.half_m[solid], solids.axis[solid]
    allowed = solids.rim_m[solid] + radius_m - _TOUCH_M
    start, end = _local(starts, center.T, axis.T), _local(ends, center.T, axis.T)
    way = end[0] - start[0], end[1] - start[1]
    blocked = _crosses(start, way, half)
    for side_x, side_y in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        blocked |= _to_segment((side_x * half[:, 0], side_y * half[:, 1]), start, way) < allowed
    return blocked


def _crosses(start: Pair, way: Pair, half: Points) -> Bool[np.ndarray, "pairs"]:
    """Returns whether a segment meets the box around the origin (slab method)."""
    dx, dy = (np.where(each == 0.0, _TOUCH_M**2, each) for each in way)
    middle_x, middle_y = -start[0] / dx, -start[1] / dy
    reach_x, reach_y = np.abs(half[:, 0] / dx), np.abs(half[:, 1] / dy)
    entry = np.maximum(np.maximum(middle_x - reach_x, middle_y - reach_y), 0.0)
    leave = np.minimum(np.minimum(middle_x + reach_x, middle_y + reach_y), 1.0)
    return entry <= leave


def _to_segment(point: Pair, start: Pair, way: Pair) -> Float64[np.ndarray, "pairs"]:
    """Returns the distance of a point to a segment."""
    x, y = point[0] - start[0], point[1] - start[1]
    along = (x * way[0] + y * way[1]) / np.maximum(way[0] ** 2 + way[1] ** 2, _TOUCH_M**2)
    along = np.minimum(np.maximum(along, 0.0), 1.0)
    return np.hypot(x - along * way[0], y - along * way[1])


def _local(points: Points, center: Float64[np.ndarray, "..."], axis: Float64[np.ndarray, "..."]) -> Pair:
    """Returns points in a solid's own axes."""
    dx, dy = points[:, 0] - center[0], points[:, 1] - center[1]
    return axis[0] * dx + axis[1] * dy, axis[0] * dy - axis[1] * dx
