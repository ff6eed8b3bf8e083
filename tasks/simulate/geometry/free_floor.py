"""Where a disc has room on a world's floor, and the straight ways that it has between the solids, exactly.

Cells that are known to be open, or shut, leave few places and lines to be measured.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int, UInt8

from specs.data.world import MOST_CORNERS
from tasks.simulate.geometry.hull_outline import inner_distance_m
from tasks.simulate.geometry.obstacles import PARKING_M, Obstacles

Points = Float64[np.ndarray, "points 2"]
Pair = tuple[Float64[np.ndarray, "pairs"], Float64[np.ndarray, "pairs"]]
# Lines and solids are looked at in pieces of this size, which the processor's cache holds.
_PAIRS_TOGETHER = 100_000
_TOUCH_M = 1e-6
# Lines and solids that may meet are found in single precision: nothing within hundreds of metres is left out.
_SLACK_M = 1e-3


class Solids(NamedTuple):
    """Outlines of what the hull can touch: boxes (a circle is one without extent) with rounded rims, and prisms.

    Attributes:
        center_m, half_m: Middle and half extents; of a prism, of the upright box around it.
        axis: Cosine and sine of the yaw.
        rim_m: Radius around the box that belongs to it: a cylinder's, else 0.
        corners_m: Of the prisms, which come last, counter-clockwise; the last one repeated where there are fewer.
    """

    center_m: Float64[np.ndarray, "solids 2"]
    half_m: Float64[np.ndarray, "solids 2"]
    axis: Float64[np.ndarray, "solids 2"]
    rim_m: Float64[np.ndarray, "solids"]
    corners_m: Float64[np.ndarray, "prisms corners 2"]

    @property
    def round_or_square(self) -> "Solids":
        """Returns the boxes and circles alone."""
        count = len(self.rim_m) - len(self.corners_m)
        return Solids(*(each[:count] for each in self[:-1]), corners_m=self.corners_m[:0])

    @property
    def prism_bounds(self) -> tuple[Points, Points]:
        """Returns the middles and half extents of the upright boxes around prisms."""
        first = len(self.rim_m) - len(self.corners_m)
        return self.center_m[first:], self.half_m[first:]


def solids_of(touched: Obstacles) -> Solids:
    """Returns the outlines of obstacles without those that are parked: boxes, then cylinders, then prisms."""
    boxes, cylinders, prisms = (each[np.abs(each[:, 0]) < PARKING_M].astype(np.float64) for each in touched)
    corners = prisms[:, None, :2] + prisms[:, 4:].reshape(-1, MOST_CORNERS, 2)
    low, high = corners.min(axis=1), corners.max(axis=1)
    return Solids(
        center_m=np.concatenate([boxes[:, :2], cylinders[:, :2], (low + high) / 2]),
        half_m=np.concatenate([boxes[:, 3:5], np.zeros((len(cylinders), 2)), (high - low) / 2]),
        axis=np.concatenate([boxes[:, 6:8], np.tile([1.0, 0.0], (len(cylinders) + len(prisms), 1))]),
        rim_m=np.concatenate([np.zeros(len(boxes)), cylinders[:, 3], np.zeros(len(prisms))]),
        corners_m=corners,
    )


def clearance_m(solids: Solids, points: Points) -> Float64[np.ndarray, "points"]:
    """Returns each point's distance to the nearest solid; 0 inside a box or a prism."""
    if not len(solids.rim_m):
        return np.full(len(points), np.inf)
    step = max(1, _PAIRS_TOGETHER // len(solids.rim_m))
    others = solids.round_or_square
    some = [_nearest_m(others, points[first : first + step]) for first in range(0, len(points), step)]
    nearest = np.concatenate([np.empty(0), *some])
    for corners, center, half in zip(solids.corners_m, *solids.prism_bounds, strict=True):
        # A prism is no nearer than the upright box around it.
        near = np.hypot(*np.maximum(np.abs(points - center) - half, 0.0).T) < nearest
        nearest[near] = np.minimum(nearest[near], inner_distance_m(corners, points[near]))
    return np.maximum(nearest, 0.0)


def _nearest_m(solids: Solids, points: Points) -> Float64[np.ndarray, "points"]:
    dx, dy = (points[:, axis] - solids.center_m[:, axis, None] for axis in (0, 1))
    cos, sin = solids.axis[:, :1], solids.axis[:, 1:]
    x, y = cos * dx + sin * dy, cos * dy - sin * dx
    beyond_x = np.maximum(np.abs(x) - solids.half_m[:, :1], 0.0)
    beyond_y = np.maximum(np.abs(y) - solids.half_m[:, 1:], 0.0)
    return (np.hypot(beyond_x, beyond_y) - solids.rim_m[:, None]).min(axis=0, initial=np.inf)


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
    first = len(solids.rim_m) - len(solids.corners_m)
    blocked, prism = np.zeros(len(solid), bool), solid >= first
    for pairs, blocks, among in (
        (~prism, _box_blocks, solid), (prism, _prism_blocks, solid - first)
    ):  # fmt: skip
        blocked[pairs] = blocks(solids, among[pairs], starts[pairs], ends[pairs], radius_m)
    return blocked


def _prism_blocks(
    solids: Solids, prism: Int[np.ndarray, "pairs"], starts: Points, ends: Points, radius_m: float
) -> Bool[np.ndarray, "pairs"]:
    corners, way = solids.corners_m[prism], ends - starts
    along = np.roll(corners, -1, axis=1) - corners
    from_corner = starts[:, None] - corners
    # How far right of each edge a line begins, and how much further it ends (Cyrus and Beck, 1978): right is outside.
    right = along[..., 1] * from_corner[..., 0] - along[..., 0] * from_corner[..., 1]
    further = along[..., 1] * way[:, None, 0] - along[..., 0] * way[:, None, 1]
    known = np.where(further == 0.0, _TOUCH_M**2, further)
    passes = np.where(further == 0.0, np.where(right > 0.0, np.inf, -np.inf), -right / known)
    entry = np.where(further <= 0.0, passes, 0.0).max(axis=1, initial=0.0)
    leave = np.where(further > 0.0, passes, 1.0).min(axis=1, initial=1.0)
    blocked = entry <= leave
    for corner in np.moveaxis(corners, 1, 0):
        beside = _to_segment((corner[:, 0], corner[:, 1]), (starts[:, 0], starts[:, 1]), (way[:, 0], way[:, 1]))
        blocked |= beside < radius_m - _TOUCH_M
    return blocked


def _box_blocks(
    solids: Solids, solid: Int[np.ndarray, "pairs"], starts: Points, ends: Points, radius_m: float
) -> Bool[np.ndarray, "pairs"]:
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


_CELL_M = 0.05
_MOST_CELLS = 256
ROOM, UNSURE, SHUT = 0, 1, 2
# Far more than rounding, and more than what a line may be nearer than the radius.
_SURE_M = 1e-5
# Where lines are looked at first: most of those that are shut cross a wall, and a few looks find it.
_FEW = (np.arange(6) + 0.5) / 6
_MANY = (np.arange(30) + 0.5) / 30
Lines = Bool[np.ndarray, "lines"]


# A cell says of all places in it at once that they have room, or that they have none, or that they must be measured.
# What the cells do not settle is measured exactly: the answers are those of ``visibility``, and only come sooner.
class OpenFloor(NamedTuple):
    """A world's floor, for a disc.

    Attributes:
        solids: What the disc keeps clear of.
        radius_m: By how much.
        low_m: Where the first cell begins (x, y).
        cell_m: The cells' side.
        cells: What is known of the places in each; the outermost ones, and whatever lies beyond, must be measured.
    """

    solids: Solids
    radius_m: float
    low_m: Float64[np.ndarray, "2"]
    cell_m: float
    cells: UInt8[np.ndarray, "rows columns"]


def open_floor(solids: Solids, radius_m: float) -> OpenFloor:
    """Returns the floor among solids, for a disc of that radius."""
    if not len(solids.rim_m) or radius_m <= 0.0:
        return OpenFloor(solids, radius_m, np.zeros(2), _CELL_M, np.full((3, 3), UNSURE, np.uint8))
    reach = (np.hypot(*solids.half_m.T) + solids.rim_m + radius_m)[:, None]
    low, high = (solids.center_m - reach).min(axis=0), (solids.center_m + reach).max(axis=0)
    cell_m = max(_CELL_M, float((high - low).max()) / _MOST_CELLS)
    columns, rows = np.ceil((high - low) / cell_m).astype(int) + 2
    floor = OpenFloor(solids, radius_m, low - cell_m, cell_m, np.full((rows, columns), ROOM, np.uint8))
    first = len(solids.rim_m) - len(solids.corners_m)
    for number in range(len(solids.rim_m)):
        _mark(floor, number, None if number < first else solids.corners_m[number - first])
    floor.cells[[0, -1]] = UNSURE
    floor.cells[:, [0, -1]] = UNSURE
    return floor


def has_room(floor: OpenFloor, points: Points) -> Bool[np.ndarray, "points"]:
    """Returns where the disc can stand."""
    known = floor.cells.ravel()[_cells_at(floor, points[:, 0], points[:, 1])]
    room = known == ROOM
    unsure = np.flatnonzero(known == UNSURE)
    if len(unsure):
        room[unsure] = clearance_m(floor.solids, points[unsure]) >= floor.radius_m
    return room


def is_open(floor: OpenFloor, starts: Points, ends: Points) -> Lines:
    """Returns whether the disc gets straight from each start to its end; it must have room at both."""
    found = np.zeros(len(starts), bool)
    left = np.arange(len(starts))
    for shares in (_FEW, _MANY):
        left = left[~_meets_shut(floor, starts[left], ends[left], shares)]
    found[left] = is_free(floor.solids, starts[left], ends[left], floor.radius_m)
    return found


def _meets_shut(floor: OpenFloor, starts: Points, ends: Points, shares: Float64[np.ndarray, "looks"]) -> Lines:
    """Returns which lines lead through a cell without room, of those at some shares of the way."""
    x, y = (starts[:, axis, None] + (ends - starts)[:, axis, None] * shares for axis in (0, 1))
    return (floor.cells.ravel()[_cells_at(floor, x, y)] == SHUT).any(axis=1)


def _cells_at(floor: OpenFloor, x: Float64[np.ndarray, "..."], y: Float64[np.ndarray, "..."]) -> Int[np.ndarray, "..."]:
    """Returns the places of cells in their order, row by row."""
    rows, columns = floor.cells.shape
    column = np.clip((x - floor.low_m[0]) / floor.cell_m, 0, columns - 1).astype(np.intp)
    row = np.clip((y - floor.low_m[1]) / floor.cell_m, 0, rows - 1).astype(np.intp)
    return row * columns + column


def _mark(floor: OpenFloor, number: int, corners_m: Float64[np.ndarray, "corners 2"] | None) -> None:
    """Marks the cells around a solid, which is a prism if there are corners."""
    center, half, axis = (each[number] for each in floor.solids[:3])
    rim_m = float(floor.solids.rim_m[number])
    away_m = floor.cell_m * np.sqrt(0.5) + _SURE_M
    cos, sin = np.abs(axis)
    extent = np.array([cos * half[0] + sin * half[1], sin * half[0] + cos * half[1]]) + rim_m + floor.radius_m + away_m
    first = np.maximum(np.floor((center - extent - floor.low_m) / floor.cell_m), 0).astype(int)
    last = np.ceil((center + extent - floor.low_m) / floor.cell_m).astype(int)
    cells = floor.cells[first[1] : last[1] + 1, first[0] : last[0] + 1]
    x, y = (
        floor.low_m[k] + floor.cell_m * (first[k] + np.arange(cells.shape[1 - k]) + 0.5) - center[k] for k in (0, 1)
    )
    along, across = axis[0] * x + axis[1] * y[:, None], axis[0] * y[:, None] - axis[1] * x
    beyond_x, beyond_y = np.maximum(np.abs(along) - half[0], 0.0), np.maximum(np.abs(across) - half[1], 0.0)
    squared = beyond_x**2 + beyond_y**2
    if corners_m is not None:
        places = np.stack(np.broadcast_arrays(x + center[0], y[:, None] + center[1]), axis=-1)
        to_prism = inner_distance_m(corners_m, places.reshape(-1, 2)).reshape(squared.shape)
        squared = np.maximum(to_prism, 0.0) ** 2
    near_m, shut_m = rim_m + floor.radius_m + away_m, rim_m + floor.radius_m - away_m
    np.maximum(cells, squared < near_m**2, out=cells)
    if shut_m > 0.0:
        cells[squared < shut_m**2] = SHUT
