"""Where a round robot can drive: a grid of distances to the nearest solid, and what hangs together at a radius.

Everything is on the safe side: a cell that a solid touches is taken whole, and distances are shortened by what a
grid can hide, so a radius found here is one that really passes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from specs.data.world import OccupancyMap, Solid
from tasks.worlds.geometry.boxes import Box, rounded
from tasks.worlds.geometry.overlaps import bounds

CELL_M = 0.05
HEADROOM_M = 2.0
"""Solids that begin above this are in nobody's way: lintels."""
# A free cell's centre is this much nearer to a solid than to the centre of the cell that the solid touches, at most
# (half a diagonal), and a straight step between two centres comes nearer by half a cell at most.
_GRID_SLACK_M = CELL_M * (2**-0.5 + 0.5)


@dataclass(frozen=True)
class Clearance:
    """Distances on the grid.

    Attributes:
        origin: Lower left corner of the first cell (metres).
        touched: Cells that a solid in a robot's way touches.
        distance_m: For each cell (x, y), how large a robot's radius may be there.
        covered: Cells whose centre is under or in a solid.
    """

    origin: tuple[float, float]
    touched: Bool[np.ndarray, "x y"]
    distance_m: Float[np.ndarray, "x y"]
    covered: Bool[np.ndarray, "x y"]

    def cells(self, box: Box) -> tuple[slice, slice]:
        """Returns the cells whose centres lie in a box."""
        x, y = self.origin
        return (
            slice(
                max(int(np.ceil((box.x_min - x) / CELL_M - 0.5)), 0),
                max(int(np.floor((box.x_max - x) / CELL_M + 0.5)), 0),
            ),
            slice(
                max(int(np.ceil((box.y_min - y) / CELL_M - 0.5)), 0),
                max(int(np.floor((box.y_max - y) / CELL_M + 0.5)), 0),
            ),
        )

    def reached(self, radius_m: float) -> Bool[np.ndarray, "x y"]:
        """Returns the cells that a robot of that radius gets to from (0, 0)."""
        from scipy import ndimage  # noqa: PLC0415 - many runs make no worlds, and are not to wait for SciPy

        labels: Int[np.ndarray, "x y"] = np.zeros(self.distance_m.shape, dtype=np.int32)
        ndimage.label(self.distance_m >= radius_m, output=labels)
        start = labels[int(-self.origin[0] // CELL_M), int(-self.origin[1] // CELL_M)]
        return (labels == start) & (labels > 0)


def measure_clearance(footprint: Box, solids: Sequence[Solid]) -> Clearance:
    """Returns the distances inside a footprint, to solids that are in a robot's way."""
    footprint = Box(*(rounded(side) for side in footprint))
    size = (int(np.ceil(footprint.width / CELL_M)), int(np.ceil(footprint.height / CELL_M)))
    touched, covered = np.zeros(size, dtype=bool), np.zeros(size, dtype=bool)
    x, y = footprint.x_min, footprint.y_min
    boxes = np.array([bounds(solid) for solid in solids]).reshape(-1, 6)
    cells = (boxes[boxes[:, 2] < HEADROOM_M][:, [0, 1, 3, 4]] - [x, y, x, y]) / CELL_M
    outer = np.concatenate([np.floor(cells[:, :2]), np.ceil(cells[:, 2:])], axis=1).astype(int).clip(0)
    inner = np.concatenate([np.ceil(cells[:, :2] - 0.5), np.floor(cells[:, 2:] + 0.5)], axis=1).astype(int).clip(0)
    for x_min, y_min, x_max, y_max in outer.tolist():
        touched[x_min:x_max, y_min:y_max] = True
    for x_min, y_min, x_max, y_max in inner.tolist():
        covered[x_min:x_max, y_min:y_max] = True
    return Clearance((x, y), touched, _distances(touched) - _GRID_SLACK_M, covered)


def _distances(touched: Bool[np.ndarray, "x y"]) -> Float[np.ndarray, "x y"]:
    """Returns the distance from each cell's centre to that of the nearest touched one (metres)."""
    from scipy import ndimage  # noqa: PLC0415 - as above

    nearest: Int[np.ndarray, "2 x y"] = np.empty((2, *touched.shape), dtype=np.int32)
    ndimage.distance_transform_edt(~touched, return_distances=False, return_indices=True, indices=nearest)
    across = nearest[0] - np.arange(touched.shape[0], dtype=np.int32)[:, None]
    along = nearest[1] - np.arange(touched.shape[1], dtype=np.int32)
    return CELL_M * np.sqrt(across * across + along * along)


def occupancy(clearance: Clearance) -> OccupancyMap:
    """Returns the touched cells as the world's map."""
    flat = clearance.touched.T.ravel()
    changes = np.flatnonzero(np.diff(flat)) + 1
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
    free = clearance.distance_m[cells] >= radius_m
    return float(reached[cells].sum()) / max(int(free.sum()), 1)
