"""Where a disc has room on a world's floor, cell by cell, so that few places and lines need to be measured.

A cell says of all places in it at once that they have room, or that they have none, or that they must be measured. What
the cells do not settle is measured exactly: the answers are those of ``visibility``, and only come sooner.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int, UInt8

from tasks.simulate.surroundings.ways.visibility import Points, Solids, clearance_m, is_free

_CELL_M = 0.05
_MOST_CELLS = 256
ROOM, UNSURE, SHUT = 0, 1, 2
# Far more than rounding, and more than what a line may be nearer than the radius.
_SURE_M = 1e-5
# Where lines are looked at first: most of those that are shut cross a wall, and a few looks find it.
_FEW = (np.arange(6) + 0.5) / 6
_MANY = (np.arange(30) + 0.5) / 30
Lines = Bool[np.ndarray, "lines"]


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
    for center, half, axis, rim in zip(*solids, strict=True):
        _mark(floor, center, half, axis, float(rim))
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


def _mark(
    floor: OpenFloor, center: Float64[np.ndarray, "2"], half: Float64[np.ndarray, "2"], axis: Float64[np.ndarray, "2"],
    rim_m: float,
) -> None:  # fmt: skip
    """Marks the cells around a solid."""
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
    near_m, shut_m = rim_m + floor.radius_m + away_m, rim_m + floor.radius_m - away_m
    np.maximum(cells, squared < near_m**2, out=cells)
    if shut_m > 0.0:
        cells[squared < shut_m**2] = SHUT
