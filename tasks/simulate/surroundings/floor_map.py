"""The map a robot plans on: clearance to the nearest solid, on a grid whose size follows from the world alone."""

import numpy as np
from jaxtyping import Float64

from specs.data.world import World
from tasks.simulate.application.contract import HostMap
from tasks.simulate.surroundings.obstacles import Obstacles

CELL_M = 0.1
_SIZES = (144, 192, 256, 384, 512)


def grid_cells(world: World) -> int:
    """Returns how many cells a side the world's grid has: one of five sizes, so that few array shapes exist."""
    return next((cells for cells in _SIZES if cells * CELL_M >= _extent_m(world)), _SIZES[-1])


def floor_map(world: World, obstacles: Obstacles) -> HostMap:
    """Returns the clearance map of a world, centred on it.

    Its size follows from the world alone and never from other worlds: applications may look at it
    (docs/decisions/0019-arrays-of-ones-own.md).

    Args:
        world: Gives the outer faces; outside them the clearance is 0. Where the largest grid does not cover them at
            10 cm, cells grow.
        obstacles: The solids in the robot's band of heights.
    """
    cells, outer = grid_cells(world), world.footprint
    bounds = np.array([outer.x_min_m, outer.y_min_m, outer.x_max_m, outer.y_max_m])
    cell_m = max(CELL_M, _extent_m(world) / cells)
    origin = (bounds[:2] + bounds[2:]) / 2 - cell_m * (cells - 1) / 2
    x, y = (origin[axis] + cell_m * np.arange(cells) for axis in (0, 1))
    columns, rows = (x >= bounds[0]) & (x <= bounds[2]), (y >= bounds[1]) & (y <= bounds[3])
    clearance = np.zeros((cells, cells), np.float32)
    clearance[np.ix_(rows, columns)] = np.maximum(_distance(x[columns], y[rows], obstacles), 0.0)
    return HostMap(clearance, origin.astype(np.float32), np.asarray(cell_m, np.float32), bounds.astype(np.float32))


def _distance(
    x: Float64[np.ndarray, "columns"], y: Float64[np.ndarray, "rows"], obstacles: Obstacles
) -> Float64[np.ndarray, "rows columns"]:
    """Returns the distance to the nearest obstacle, seen from above; 0 or less inside one."""
    squared = np.full((len(y), len(x)), np.inf)
    for box in obstacles.boxes.astype(np.float64):
        np.minimum(squared, _to_box_squared(x, y, box), out=squared)
    nearest = np.sqrt(squared)
    for cylinder in obstacles.cylinders.astype(np.float64):
        away = np.sqrt((x - cylinder[0]) ** 2 + ((y - cylinder[1]) ** 2)[:, None]) - cylinder[3]
        np.minimum(nearest, away, out=nearest)
    return nearest


def _to_box_squared(
    x: Float64[np.ndarray, "columns"], y: Float64[np.ndarray, "rows"], box: Float64[np.ndarray, "8"]
) -> Float64[np.ndarray, "rows columns"]:
    dx, dy, (half_x, half_y), (cos, sin) = x - box[0], (y - box[1])[:, None], box[3:5], box[6:8]
    # Most boxes stand upright: how far a cell is beyond their faces is known by its row and column alone.
    along, across = (dx, dy) if sin == 0.0 else (cos * dx + sin * dy, cos * dy - sin * dx)
    return np.maximum(np.abs(along) - half_x, 0.0) ** 2 + np.maximum(np.abs(across) - half_y, 0.0) ** 2


def _extent_m(world: World) -> float:
    outer = world.footprint
    return max(outer.x_max_m - outer.x_min_m, outer.y_max_m - outer.y_min_m)
