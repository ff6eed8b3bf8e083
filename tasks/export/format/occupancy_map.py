"""A world's floor as an occupancy grid that Nav2's and ROS 1's map_server load: a picture and a YAML file beside it.

Format: documentation of ROS map_server (wiki.ros.org/map_server, "Map format"), which nav2_map_server keeps.
"""

from typing import cast

import numpy as np
from jaxtyping import Bool, UInt8
from scipy import ndimage

from specs.data.world import OccupancyMap, Start, World, start_pose

MAP_FILE, PICTURE_FILE = "map.yaml", "map.pgm"
FREE, UNKNOWN, OCCUPIED = 254, 205, 0
"""Levels of grey, as map_server's own map_saver writes them."""
_FREE_THRESHOLD, _OCCUPIED_THRESHOLD = 0.196, 0.65


def map_files(world: World) -> dict[str, bytes]:
    """Returns the picture (PGM) and its description (YAML).

    Floor that no way leads to from the start, such as a gap behind a wardrobe, is unknown: a robot that mapped the
    apartment would not have seen it either. Doors are as they stand.
    """
    grid = world.map
    levels = map_levels(grid, start_pose(world))
    picture = b"P5\n%d %d\n255\n" % (grid.columns, grid.rows) + levels[::-1].tobytes()  # its first row is the upper one
    x_m, y_m = grid.origin_m
    lines = (
        f"image: {PICTURE_FILE}",
        "mode: trinary",
        f"resolution: {grid.resolution_m:g}",
        f"origin: [{x_m:g}, {y_m:g}, 0]",
        "negate: 0",
        f"occupied_thresh: {_OCCUPIED_THRESHOLD}",
        f"free_thresh: {_FREE_THRESHOLD}",
    )
    return {PICTURE_FILE: picture, MAP_FILE: ("\n".join(lines) + "\n").encode()}


def map_levels(grid: OccupancyMap, start: Start) -> UInt8[np.ndarray, "rows columns"]:
    """Returns each cell's level of grey, from the lowest y and x on."""
    occupied = occupied_cells(grid)
    low = grid.origin_m
    column, row = (int((at - low_m) / grid.resolution_m) for at, low_m in zip((start.x_m, start.y_m), low, strict=True))
    regions, _ = cast("tuple[np.ndarray, int]", ndimage.label(~occupied))
    reached = ~occupied & (regions == regions[row, column])
    return np.where(occupied, OCCUPIED, np.where(reached, FREE, UNKNOWN)).astype(np.uint8)


def occupied_cells(grid: OccupancyMap) -> Bool[np.ndarray, "rows columns"]:
    """Returns which cells something stands in, from the lowest y and x on."""
    values = np.arange(len(grid.runs)) % 2 == 1
    return np.repeat(values, grid.runs).reshape(grid.rows, grid.columns)
