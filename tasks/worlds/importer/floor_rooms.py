"""Rooms of a floor that has none: what lies between its walls, parted where it is narrow as a door.

The floor that is farther from all walls than the middle of a door falls into the middles of rooms, from which the rest
is reached cell by cell, so that rooms meet in their doors (distance transform; Bormann et al., Room segmentation:
survey, implementation, and analysis, ICRA 2016).
"""

from typing import cast

import numpy as np
import shapely
from jaxtyping import Bool, Int
from scipy import ndimage
from shapely import Polygon

from specs.data.world import MOST_ZONE_CORNERS, FloorZone, Start
from tasks.worlds.geometry import CELL_M, connected, label_parts, rounded
from tasks.worlds.importer.mesh_sections import merged
from tasks.worlds.importer.own_floor import cell_at
from tasks.worlds.survey import ExactGrid

DOOR_M = 1.1
"""What is narrower parts two rooms: doors are 0.7 to 1 m wide."""
LEAST_ROOM_M2 = 2.0
MOST_ROOMS = 200
_CLEAR_SHARE = 0.8
_PASSABLE_M = 0.05
_STRAIGHTENED_M = 0.1


def found_rooms(grid: ExactGrid, start: Start) -> tuple[FloorZone, ...]:
    """Returns the rooms that can be told apart on a floor with walls alone; none where there are not two.

    A floor that leads out of the building is no room, and neither is what has no room for a person to lie down. Where
    that leaves less than ``_CLEAR_SHARE`` of the floor inside, the walls part it otherwise than in rooms.
    """
    cell = cell_at(grid, (start.x_m, start.y_m))
    if cell is None:
        return ()
    floor = _floor_from(grid, cell)
    parts = _parted(grid, floor)
    outside = np.unique(np.concatenate([parts[0], parts[-1], parts[:, 0], parts[:, -1]]))
    sizes = np.bincount(parts[parts > 0], minlength=1) * CELL_M**2
    sizes[[0, *outside[outside > 0]]] = 0.0
    kept = np.flatnonzero(sizes >= LEAST_ROOM_M2)
    inside = np.count_nonzero(floor & ~np.isin(parts, outside[outside > 0])) * CELL_M**2
    if not 2 <= len(kept) <= MOST_ROOMS or sizes[kept].sum() < _CLEAR_SHARE * inside:
        return ()
    outlines = sorted((_outline(grid, parts == number) for number in kept), key=lambda each: (-each.area, each.bounds))
    return tuple(
        FloorZone(name=f"room-{number}", outline_m=tuple((rounded(x), rounded(y)) for x, y in corners), found=True)
        for number, corners in enumerate((each.exterior.coords[:-1] for each in outlines), start=1)
    )


def _floor_from(grid: ExactGrid, cell: tuple[int, int]) -> Bool[np.ndarray, "x y"]:
    """Returns the floor that hangs together with a cell between the walls, up to the walls."""
    passable = connected(grid.free(_PASSABLE_M), cell)
    return ndimage.binary_dilation(passable, iterations=2, mask=~grid.covered) if passable.any() else passable


def _parted(grid: ExactGrid, floor: Bool[np.ndarray, "x y"]) -> Int[np.ndarray, "x y"]:
    """Returns the number of the part that each cell of a floor is in, from 1; 0 beside the floor."""
    padded = np.pad(label_parts(floor & (grid.distance_m > DOOR_M / 2)), 1)
    parts, left = padded.ravel(), np.pad(floor, 1).ravel() & (padded.ravel() == 0)
    # Only cells that were reached last have neighbours that are not: a long passage takes as long as it has cells.
    last = np.flatnonzero(parts)
    while len(last):
        found = list[Int[np.ndarray, " cells"]]()
        for step in (-padded.shape[1], -1, 1, padded.shape[1]):
            from_cells = last[left[last + step]]
            np.maximum.at(parts, from_cells + step, parts[from_cells])
            found.append(from_cells + step)
        last = np.unique(np.concatenate(found))
        left[last] = False
    return padded[1:-1, 1:-1]


def _outline(grid: ExactGrid, cells: Bool[np.ndarray, "x y"]) -> Polygon:
    """Returns the outline of a part of the floor, with few corners and without the holes in it."""
    edges = np.diff(cells.astype(np.int8), axis=1, prepend=0, append=0)
    (column, row), (_, end) = np.nonzero(edges > 0), np.nonzero(edges < 0)
    low_x, low_y = grid.origin
    boxes = shapely.box(
        low_x + CELL_M * column, low_y + CELL_M * row, low_x + CELL_M * (column + 1), low_y + CELL_M * end
    )
    whole = merged(list(boxes))
    largest = max(getattr(whole, "geoms", [whole]), key=lambda each: each.area)
    outline, straightened_m = Polygon(largest.exterior), _STRAIGHTENED_M
    while True:
        simple = cast("Polygon", outline.simplify(straightened_m))
        if len(simple.exterior.coords) <= MOST_ZONE_CORNERS:
            return simple
        straightened_m *= 2.0
