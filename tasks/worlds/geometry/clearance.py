"""Where a round robot can drive: a grid of distances to the nearest solid, and what hangs together at a radius.

Everything is on the safe side: a cell that a solid touches is taken whole, and distances are shortened by what a
grid can hide, so a radius found here is one that really passes.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Int, Int16

from specs.data.world import OccupancyMap, Solid
from tasks.worlds.geometry.boxes import Box, rounded
from tasks.worlds.geometry.overlaps import bounds

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
CROSS = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], dtype=bool)
"""Which of the cells around it a robot gets to from a cell."""


@dataclass(frozen=True)
class Clearance:
    """Distances on the grid.

    Attributes:
        origin: Lower left corner of the first cell (metres).
        touched: Cells that a solid in a robot's way touches.
        squared: For each cell (x, y), the square of the cells between its middle and that of the nearest touched one;
            as far as it matters for a robot of ``RADIUS_MAX_M``.
        covered: Cells whose centre is under or in a solid.
    """

    origin: tuple[float, float]
    touched: Bool[np.ndarray, "x y"]
    squared: Int16[np.ndarray, "x y"]
    covered: Bool[np.ndarray, "x y"]
    _floods: dict[int, Bool[np.ndarray, "x y"]] = field(default_factory=dict[int, Bool[np.ndarray, "x y"]])

    def cells(self, box: Box) -> tuple[slice, slice]:
        """Returns the cells whose centres lie in a box."""
        x, y = self.origin
        low_x, low_y = math.ceil((box.x_min - x) / CELL_M - 0.5), math.ceil((box.y_min - y) / CELL_M - 0.5)
        high_x, high_y = math.floor((box.x_max - x) / CELL_M + 0.5), math.floor((box.y_max - y) / CELL_M + 0.5)
        return slice(max(low_x, 0), max(high_x, 0)), slice(max(low_y, 0), max(high_y, 0))

    def reached(self, radius_m: float) -> Bool[np.ndarray, "x y"]:
        """Returns the cells that a robot of that radius gets to from (0, 0)."""
        needed = _needed(radius_m)
        if needed not in self._floods:
            self._floods[needed] = self._flood(needed)
        return self._floods[needed]

    def widest_radius(self, box: Box) -> float:
        """Returns the radius of the largest robot, up to ``RADIUS_MAX_M``, that can stand at some cell of a box."""
        cells = self.squared[self.cells(box)]
        return float(_RADII_M[int(cells.max())]) if cells.size else RADIUS_MAX_M

    def _flood(self, needed: int) -> Bool[np.ndarray, "x y"]:
        from scipy import ndimage  # noqa: PLC0415 - many runs make no worlds, and are not to wait for SciPy

        labels: Int[np.ndarray, "x y"] = np.empty(self.squared.shape, dtype=np.int32)
        ndimage.label(self.squared >= needed, structure=CROSS, output=labels)
        start = int(labels[int(-self.origin[0] // CELL_M), int(-self.origin[1] // CELL_M)])
        return labels == (start or -1)


def _needed(radius_m: float) -> int:
    """Returns the least square of cells to the nearest touched one at which a robot can stand."""
    return int(_RADII_M.searchsorted(radius_m))


def measure_clearance(footprint: Box, solids: Sequence[Solid]) -> Clearance:
    """Returns the distances inside a footprint, to solids that are in a robot's way."""
    footprint = Box(*(rounded(side) for side in footprint))
    size = (math.ceil(footprint.width / CELL_M), math.ceil(footprint.height / CELL_M))
    touched, covered = np.zeros(size, dtype=bool), np.zeros(size, dtype=bool)
    x, y = footprint.x_min, footprint.y_min
    boxes = bounds(solids)
    cells = (boxes[boxes[:, 2] < HEADROOM_M][:, [0, 1, 3, 4]] - [x, y, x, y]) / CELL_M
    outer = np.concatenate([np.floor(cells[:, :2]), np.ceil(cells[:, 2:])], axis=1).astype(int).clip(0)
    inner = np.concatenate([np.ceil(cells[:, :2] - 0.5), np.floor(cells[:, 2:] + 0.5)], axis=1).astype(int).clip(0)
    for x_min, y_min, x_max, y_max in outer.tolist():
        touched[x_min:x_max, y_min:y_max] = True
    for x_min, y_min, x_max, y_max in inner.tolist():
        covered[x_min:x_max, y_min:y_max] = True
    return Clearance((x, y), touched, _squared_distances(touched), covered)


def _squared_distances(touched: Bool[np.ndarray, "x y"]) -> Int16[np.ndarray, "x y"]:
    """Returns the squares of the distances to the nearest touched cell, in cells, at most ``_REACH`` squared.

    First along each column, then across: the least sum of two squares (Saito and Toriwaki 1994), as far as needed.
    """
    place = np.arange(touched.shape[1], dtype=np.int16)
    before = np.maximum.accumulate(np.where(touched, place, np.int16(-_REACH)), axis=1)
    after = np.minimum.accumulate(np.where(touched, place, place[-1] + np.int16(_REACH))[:, ::-1], axis=1)[:, ::-1]
    along = np.minimum(np.minimum(place - before, after - place), np.int16(_REACH))
    along *= along
    squared = along.copy()
    for across in range(1, min(_REACH, len(touched))):
        beside = along + np.int16(across * across)
        np.minimum(squared[across:], beside[:-across], out=squared[across:])
        np.minimum(squared[:-across], beside[across:], out=squared[:-across])
    return squared


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
    free = clearance.squared[cells] >= _needed(radius_m)
    return float(np.count_nonzero(reached[cells])) / max(int(np.count_nonzero(free)), 1)
