"""The map a robot plans on: clearance to the nearest solid, on a grid of one size for all worlds."""

import numpy as np
from jaxtyping import Float64

from specs.world import World
from tasks.simulate.contract import HostMap
from tasks.simulate.obstacles import Obstacles

CELL_M = 0.1
_LEAST_CELLS = 128
_MOST_CELLS = 512


def grid_cells(world: World) -> int:
    """Returns how many cells a side the world's grid has: 128, 256 or 512, so that few array shapes exist."""
    cells = _LEAST_CELLS
    while cells < _MOST_CELLS and cells * CELL_M < _extent_m(world):
        cells *= 2
    return cells


def floor_map(world: World, obstacles: Obstacles, cells: int) -> HostMap:
    """Returns the clearance map of a world, centred on it.

    Args:
        world: Gives the outer faces; outside them the clearance is 0.
        obstacles: The solids in the robot's band of heights.
        cells: Cells a side; where they do not cover the world at 10 cm they grow.
    """
    outer = world.footprint
    bounds = np.array([outer.x_min_m, outer.y_min_m, outer.x_max_m, outer.y_max_m])
    cell_m = max(CELL_M, _extent_m(world) / cells)
    origin = (bounds[:2] + bounds[2:]) / 2 - cell_m * (cells - 1) / 2
    x, y = np.meshgrid(*(origin[axis] + cell_m * np.arange(cells) for axis in (0, 1)))
    outside = (x < bounds[0]) | (x > bounds[2]) | (y < bounds[1]) | (y > bounds[3])
    clearance = np.where(outside, 0.0, np.maximum(_distance(x, y, obstacles), 0.0))
    return HostMap(
        clearance.astype(np.float32),
        origin.astype(np.float32),
        np.asarray(cell_m, np.float32),
        bounds.astype(np.float32),
    )


def _distance(
    x: Float64[np.ndarray, "rows columns"], y: Float64[np.ndarray, "rows columns"], obstacles: Obstacles
) -> Float64[np.ndarray, "rows columns"]:
    """Returns the distance to the nearest obstacle, seen from above; 0 or less inside one."""
    nearest = np.full(x.shape, np.inf)
    for box in obstacles.boxes.astype(np.float64):
        nearest = np.minimum(nearest, _to_box(x, y, box))
    for cylinder in obstacles.cylinders.astype(np.float64):
        nearest = np.minimum(nearest, np.hypot(x - cylinder[0], y - cylinder[1]) - cylinder[3])
    return nearest


def _to_box(
    x: Float64[np.ndarray, "rows columns"], y: Float64[np.ndarray, "rows columns"], box: Float64[np.ndarray, "8"]
) -> Float64[np.ndarray, "rows columns"]:
    dx, dy = x - box[0], y - box[1]
    beyond_x = np.maximum(np.abs(box[6] * dx + box[7] * dy) - box[3], 0.0)
    beyond_y = np.maximum(np.abs(box[6] * dy - box[7] * dx) - box[4], 0.0)
    return np.hypot(beyond_x, beyond_y)


def _extent_m(world: World) -> float:
    outer = world.footprint
    return max(outer.x_max_m - outer.x_min_m, outer.y_max_m - outer.y_min_m)


def cell_of(floor: HostMap, point_m: Float64[np.ndarray, "2"]) -> tuple[int, int]:
    """Returns the (row, column) of the cell that holds a point, clipped to the grid."""
    column, row = np.rint((point_m - floor.origin_m) / floor.cell_m).astype(int)
    rows, columns = floor.clearance_m.shape
    return int(np.clip(row, 0, rows - 1)), int(np.clip(column, 0, columns - 1))
