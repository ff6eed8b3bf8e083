"""Where a round robot can drive: a grid of distances to the nearest solid, and what hangs together at a radius.

Everything is on the safe side: a cell that a solid touches is taken whole, and distances are shortened by what a
grid can hide, so a radius found here is one that really passes.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np
from jaxtyping import Bool

from specs.data.world import OccupancyMap, Solid
from tasks.worlds.geometry.boxes import Box, rounded
from tasks.worlds.geometry.floods import flood
from tasks.worlds.geometry.overlaps import bounds, solid_rows

CELL_M = 0.05
HEADROOM_M = 2.0
"""Solids that begin above this are in nobody's way: lintels."""
RADIUS_MAX_M = 1.0
"""No robot is larger, and no distance is measured further than one of this radius needs."""
# A free cell's centre is this much nearer to a solid than to the centre of the cell that the solid touches, at most
# (half a diagonal), and a straight step between two centres comes nearer by half a cell at most.
_GRID_SLACK_M = CELL_M * (2**-0.5 + 0.5)
_REACH = int((RADIUS_MAX_M + _GRID_SLACK_M) / CELL_M) + 2
_RADII_M = CELL_M * np.sqrt(np.arange(_REACH * _REACH + 1)) - _GRID_SLACK_M
"""How large a robot's radius may be at a cell, by the square of the cells to the nearest touched one."""


@dataclass(frozen=True)
class Clearance:
    """Where solids are on the grid, and where a robot can be between them.

    Attributes:
        origin: Lower left corner of the first cell (metres).
        touched: Cells that a solid in a robot's way touches.
        covered: Cells whose centre is under or in a solid.
    """

    origin: tuple[float, float]
    touched: Bool[np.ndarray, "x y"]
    covered: Bool[np.ndarray, "x y"]
    _known: dict[int, int] = field(default_factory=dict[int, int])
    _floods: dict[int, Bool[np.ndarray, "x y"]] = field(default_factory=dict[int, Bool[np.ndarray, "x y"]])

    def cells(self, box: Box) -> tuple[slice, slice]:
        """Returns the cells whose centres lie in a box."""
        x, y = self.origin
        low_x, low_y = math.ceil((box.x_min - x) / CELL_M - 0.5), math.ceil((box.y_min - y) / CELL_M - 0.5)
        high_x, high_y = math.floor((box.x_max - x) / CELL_M + 0.5), math.floor((box.y_max - y) / CELL_M + 0.5)
        return slice(max(low_x, 0), max(high_x, 0)), slice(max(low_y, 0), max(high_y, 0))

    def free(self, radius_m: float) -> Bool[np.ndarray, "x y"]:
        """Returns the cells at which a robot of that radius, at most ``RADIUS_MAX_M``, can stand."""
        return self._unpack(self._free(_needed(radius_m)))

    def widest_radius(self, box: Box) -> float:
        """Returns the radius of the largest robot, up to ``RADIUS_MAX_M``, that can stand at some cell of a box."""
        x, y = (
            slice(cells.start, min(cells.stop, most))
            for cells, most in zip(self.cells(box), self.touched.shape, strict=True)
        )
        if x.start >= x.stop or y.start >= y.stop:
            return RADIUS_MAX_M
        for around in (max(x.stop - x.start, y.stop - y.start) // 2 + 2, _REACH):
            low_x, low_y = max(x.start - around, 0), max(y.start - around, 0)
            window = self.touched[low_x : x.stop + around, low_y : y.stop + around]
            inner = (x.start - low_x, x.stop - low_x, y.start - low_y, y.stop - low_y)
            squared = _roomiest(window.tobytes(), window.shape, inner)
            if squared < around * around:
                return float(_RADII_M[squared])
        return float(_RADII_M[-1])

    def reached(self, radius_m: float) -> Bool[np.ndarray, "x y"]:
        """Returns the cells that a robot of that radius gets to from (0, 0)."""
        needed = _needed(radius_m)
        if needed not in self._floods:
            free = self._free(needed)
            self._floods[needed] = self._unpack(flood(self._start & free, free, self._row))
        return self._floods[needed]

    @cached_property
    def _start(self) -> int:
        """The cell of (0, 0), where that is on the grid."""
        x, y = (int(-low // CELL_M) for low in self.origin)
        rows, columns = self.touched.shape
        return 1 << x * self._row + y if 0 <= x < rows and 0 <= y < columns else 0

    @cached_property
    def _row(self) -> int:
        """How many bits a row of cells has: discs that reach beyond its ends do not reach into other rows."""
        return (self.touched.shape[1] + _REACH) // 8 * 8 + 8

    @cached_property
    def _grid(self) -> tuple[int, int]:
        """The touched cells, and all cells."""
        return self._pack(self.touched), self._pack(np.ones_like(self.touched))

    def _free(self, needed: int) -> int:
        """Returns the cells with no touched one so near, by the square of the cells between them."""
        if needed not in self._known:
            touched, cells = self._grid
            near, wide, aside = 0, touched, 0
            for rows in range(math.isqrt(needed - 1), -1, -1):
                reach = math.isqrt(needed - 1 - rows * rows)
                while aside < reach:
                    aside += 1
                    wide |= touched << aside | touched >> aside
                near |= wide << rows * self._row | wide >> rows * self._row
            self._known[needed] = cells & ~near
        return self._known[needed]

    def _pack(self, grid: Bool[np.ndarray, "x y"]) -> int:
        rows, columns = grid.shape
        bits = np.zeros((rows, self._row), dtype=np.bool_)
        bits[:, :columns] = grid
        return int.from_bytes(np.packbits(bits, bitorder="little").tobytes(), "little")

    def _unpack(self, cells: int) -> Bool[np.ndarray, "x y"]:
        rows, columns = self.touched.shape
        packed = np.frombuffer(cells.to_bytes(rows * self._row // 8, "little"), dtype=np.uint8)
        return np.unpackbits(packed, bitorder="little").view(np.bool_).reshape(rows, self._row)[:, :columns]


@lru_cache(maxsize=1024)
def _roomiest(window: bytes, shape: tuple[int, int], inner: tuple[int, int, int, int]) -> int:
    """Returns the greatest square of cells that one of a window's inner cells has to the nearest touched one.

    Interiors of a floor plan share it: nothing stands before a passage.

    Args:
        window: Which cells are touched, row by row.
        shape: Rows, and cells in each.
        inner: From which to which row, and from which to which cell of each.
    """
    touched = np.frombuffer(window, dtype=np.bool_).reshape(shape)
    free, beside = ~touched, np.zeros(shape, dtype=np.bool_)
    beside[1:] |= free[:-1]
    beside[:-1] |= free[1:]
    beside[:, 1:] |= free[:, :-1]
    beside[:, :-1] |= free[:, 1:]
    x, y = (touched & beside).nonzero()  # what is nearest to a free cell has a free one beside it
    own_x, own_y = free[inner[0] : inner[1], inner[2] : inner[3]].nonzero()
    own_x, own_y = own_x + inner[0], own_y + inner[2]
    # |a - b|^2 as |a|^2 + (|b|^2 - 2 ab): one product of whole numbers, exact in doubles, for all pairs of cells.
    own = np.stack([own_x, own_y, np.ones_like(own_x)], axis=1, dtype=np.float64)
    others = np.stack([-2 * x, -2 * y, x * x + y * y], dtype=np.float64)
    nearest = (own @ others).min(axis=1, initial=_REACH * _REACH) + own_x * own_x + own_y * own_y
    return min(int(nearest.max(initial=0)), _REACH * _REACH)


def _needed(radius_m: float) -> int:
    """Returns the least square of cells to the nearest touched one at which a robot can stand."""
    return int(_RADII_M.searchsorted(radius_m))


def measure_clearance(footprint: Box, solids: Sequence[Solid]) -> Clearance:
    """Returns the distances inside a footprint, to solids that are in a robot's way."""
    footprint = Box(*(rounded(side) for side in footprint))
    size = (math.ceil(footprint.width / CELL_M), math.ceil(footprint.height / CELL_M))
    touched, covered = np.zeros(size, dtype=bool), np.zeros(size, dtype=bool)
    x, y = footprint.x_min, footprint.y_min
    boxes = bounds(solid_rows(solids))
    cells = (boxes[boxes[:, 2] < HEADROOM_M][:, [0, 1, 3, 4]] - [x, y, x, y]) / CELL_M
    outer = np.concatenate([np.floor(cells[:, :2]), np.ceil(cells[:, 2:])], axis=1).astype(int).clip(0)
    inner = np.concatenate([np.ceil(cells[:, :2] - 0.5), np.floor(cells[:, 2:] + 0.5)], axis=1).astype(int).clip(0)
    for x_min, y_min, x_max, y_max in outer.tolist():
        touched[x_min:x_max, y_min:y_max] = True
    for x_min, y_min, x_max, y_max in inner.tolist():
        covered[x_min:x_max, y_min:y_max] = True
    return Clearance((x, y), touched, covered)


def occupancy(clearance: Clearance) -> OccupancyMap:
    """Returns the touched cells as the world's map."""
    flat = clearance.touched.T.ravel()
    changes = np.flatnonzero(flat[1:] != flat[:-1]) + 1
    borders = np.concatenate([[0] * (2 if flat[0] else 1), changes, [flat.size]])
    columns, rows = clearance.touched.shape
    return OccupancyMap(
        resolution_m=CELL_M,
        origin_m=(rounded(clearance.origin[0]), rounded(clearance.origin[1])),
        columns=columns,
        rows=rows,
        runs=tuple(np.diff(borders).tolist()),
    )


def reaches_room(reached: Bool[np.ndarray, "x y"], clearance: Clearance, floor: Box, radius_m: float) -> bool:
    """Returns whether a robot gets its whole disc into a room.

    Args:
        reached: The cells that the robot gets to.
        clearance: The grid of distances.
        floor: The room's floor.
        radius_m: The robot's radius.
    """
    return bool(reached[clearance.cells(floor.grown(-radius_m))].any())


def connected_share(reached: Bool[np.ndarray, "x y"], clearance: Clearance, floor: Box, radius_m: float) -> float:
    """Returns how much of a room's floor that is free for a robot can be reached, 0-1.

    Args:
        reached: The cells that the robot gets to.
        clearance: The grid of distances.
        floor: The room's floor.
        radius_m: The robot's radius.
    """
    cells = clearance.cells(floor)
    free = clearance.free(radius_m)[cells]
    return float(np.count_nonzero(reached[cells])) / max(int(np.count_nonzero(free)), 1)
