"""The straight ways that a disc has between a world's solids, exactly, seen from above."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int

from tasks.simulate.surroundings.obstacles import PARKING_M, Obstacles

Points = Float64[np.ndarray, "points 2"]
Pair = tuple[Float64[np.ndarray, "pairs"], Float64[np.ndarray, "pairs"]]
# Lines and solids are looked at in pieces of this size, which the processor's cache holds.
_PAIRS_TOGETHER = 100_000
_TOUCH_M = 1e-6
# Lines and solids that may meet are found in single precision: nothing within hundreds of metres is left out.
_SLACK_M = 1e-3


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
    if not len(solids.rim_m):
        return np.full(len(points), np.inf)
    step = max(1, _PAIRS_TOGETHER // len(solids.rim_m))
    some = [_nearest_m(solids, points[first : first + step]) for first in range(0, len(points), step)]
    return np.maximum(np.concatenate([np.empty(0), *some]), 0.0)


def _nearest_m(solids: Solids, points: Points) -> Float64[np.ndarray, "points"]:
    dx, dy = (points[:, axis] - solids.center_m[:, axis, None] for axis in (0, 1))
    cos, sin = solids.axis[:, :1], solids.axis[:, 1:]
    x, y = cos * dx + sin * dy, cos * dy - sin * dx
    beyond_x = np.maximum(np.abs(x) - solids.half_m[:, :1], 0.0)
    beyond_y = np.maximum(np.abs(y) - solids.half_m[:, 1:], 0.0)
    return (np.hypot(beyond_x, beyond_y) - solids.rim_m[:, None]).min(axis=0)


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
    step = max(1, _PAIRS_TOGETHER // max(len(solids.rim_m), 1))
    for first in range(0, len(starts), step):
        some = slice(first, first + step)
        line, solid = _near(solids, starts[some], ends[some], radius_m)
        line += first
        free[line[_blocks(solids, solid, starts[line], ends[line], radius_m)]] = False
    return free


def _near(
    solids: Solids, starts: Points, ends: Points, radius_m: float
) -> tuple[Int[np.ndarray, "pairs"], Int[np.ndarray, "pairs"]]:
    """Returns all pairs (line, solid) that may meet: whose extents along the line and across it overlap."""
    way = ends - starts
    length = np.maximum(np.hypot(way[:, 0], way[:, 1]), _TOUCH_M)
    along = way / length[:, None]
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    found = _overlap(solids, across, starts, np.full_like(length, radius_m))
    found &= _overlap(solids, along, (starts + ends) / 2, length / 2 + radius_m)
    line, solid = np.nonzero(found)
    return line, solid


def _overlap(
    solids: Solids, direction: Points, middle: Points, reach_m: Float64[np.ndarray, "lines"]
) -> Bool[np.ndarray, "lines solids"]:
    """Returns whether solids come within reach of a line's middle along a direction, in single precision and slack."""
    sideways = np.stack([-solids.axis[:, 1], solids.axis[:, 0]], axis=1)
    to, first, second = (
        direction.astype(np.float32) @ each.T.astype(np.float32) for each in (solids.center_m, solids.axis, sideways)
    )
    to -= np.sum(direction * middle, axis=1, keepdims=True).astype(np.float32)
    half = solids.half_m.astype(np.float32)
    extent = np.abs(first, out=first) * half[:, 0]
    extent += np.abs(second, out=second) * half[:, 1]
    extent += (solids.rim_m + _SLACK_M).astype(np.float32)
    extent += reach_m.astype(np.float32)[:, None]
    return np.abs(to, out=to) < extent


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
