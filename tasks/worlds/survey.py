"""A finished world's floor, measured on the exact outlines of its solids: the map, and how far away the next solid is.

Turned boxes, round things and prisms count as what they are. What is found is on the safe side by at most one cell: a
robot of the radius that is found passes, and none passes that is larger by more than a cell's side.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from specs.data.world import Door, Furniture, OccupancyMap, Passage, Room, Solid, corners_m
from tasks.worlds.floorplan.doors import open_leaves
from tasks.worlds.floorplan.scoring import WALL_M
from tasks.worlds.geometry import (
    CELL_M,
    HEADROOM_M,
    RADIUS_MAX_M,
    Box,
    FloorGrid,
    bounding_box,
    bounds,
    grid_of,
    half_planes,
    room_box,
    rounded,
    solid_rows,
    touched_by_bounds,
)
from tasks.worlds.resolved_template import FULLY_OPEN

# Documents round angles to a millionth: such sines are those of quarter turns.
_STRAIGHT = 1e-5


class ExactGrid(FloorGrid):
    """A floor with the distance from the centre of each cell to the nearest solid.

    Attributes:
        most_radius_m: Distances are known as far as a robot of this radius needs them.
        distance_m: To the nearest solid that is not above head height: 0 in it.
        touched: Cells that a solid shares more than a border with.
        centers_m: Where the middles of the cells are, along x and along y.
    """

    def __init__(
        self,
        origin: tuple[float, float],
        most_radius_m: float,
        distance_m: Float[np.ndarray, "x y"],
        touched: Bool[np.ndarray, "x y"],
    ) -> None:
        super().__init__(origin, (touched.shape[0], touched.shape[1]))
        self.most_radius_m, self.distance_m, self.touched = most_radius_m, distance_m, touched
        self.centers_m = [
            low + CELL_M * (np.arange(cells) + 0.5) for low, cells in zip(origin, self.shape, strict=True)
        ]

    @property
    def covered(self) -> Bool[np.ndarray, "x y"]:
        """Cells whose centre is under or in a solid."""
        return self.distance_m <= 0.0

    # A robot that goes straight from one centre to the next is never further than half a cell from one of them, and
    # what is as near to its way as that is off to the side: Pythagoras.
    def _find_free(self, radius_m: float) -> Bool[np.ndarray, "x y"]:
        return self.distance_m >= math.hypot(radius_m, CELL_M / 2)

    def widest_radius(self, box: Box) -> float:
        """Returns the radius of the largest robot, up to the most, that can stand at some cell of a box."""
        distances = self.distance_m[self.cells(box)]
        furthest = float(distances.max(initial=0.0)) if distances.size else math.inf
        return min(math.sqrt(max(furthest**2 - (CELL_M / 2) ** 2, 0.0)), self.most_radius_m)

    def with_solids(self, solids: Sequence[Solid]) -> "ExactGrid":
        """Returns the floor with more solids on it."""
        grid = ExactGrid(self.origin, self.most_radius_m, self.distance_m.copy(), self.touched.copy())
        solids = [solid for solid in solids if solid.center_m[2] - solid.half_extents_m[2] < HEADROOM_M]
        rows = solid_rows(solids)
        boxes = bounds(rows)
        turned = (np.abs(np.sin(rows[:, 6])) > _STRAIGHT) & (np.abs(np.cos(rows[:, 6])) > _STRAIGHT)
        round_ones, prisms = (
            np.array([solid.shape == shape for solid in solids], dtype=bool) for shape in ("cylinder", "prism")
        )
        straight = ~turned & ~round_ones & ~prisms
        outer = _outermost(boxes[:, [0, 1, 3, 4]], straight)
        windows = _windows(grid, boxes)
        _draw_straight(grid, boxes[straight & outer], [windows[each] for each in np.flatnonzero(straight & outer)])
        for number in np.flatnonzero(outer & prisms).tolist():
            _draw_prism(grid, windows[number], solids[number])
        for number in np.flatnonzero(outer & ~straight & ~prisms).tolist():
            draw = _draw_circle if round_ones[number] else _draw_turned
            draw(grid, windows[number], rows[number].tolist())
        return grid

    def occupancy(self) -> OccupancyMap:
        """Returns the touched cells as the world's map."""
        flat = self.touched.T.ravel()
        changes = np.flatnonzero(flat[1:] != flat[:-1]) + 1
        borders = np.concatenate([[0] * (2 if flat[0] else 1), changes, [flat.size]])
        return OccupancyMap(
            resolution_m=CELL_M,
            origin_m=(rounded(self.origin[0]), rounded(self.origin[1])),
            columns=self.shape[0],
            rows=self.shape[1],
            runs=tuple(np.diff(borders).tolist()),
        )


_Window = tuple[slice, slice]


def _windows(grid: ExactGrid, boxes: Float[np.ndarray, "solids 6"]) -> list[_Window]:
    """Returns the cells that are as near to each bounding box as a robot needs to know."""
    reach = math.hypot(grid.most_radius_m, CELL_M / 2)
    first = np.floor((boxes[:, :2] - reach - grid.origin) / CELL_M).astype(int).clip(0, grid.shape)
    last = np.ceil((boxes[:, 3:5] + reach - grid.origin) / CELL_M).astype(int).clip(0, grid.shape)
    return [
        (slice(low_x, high_x), slice(low_y, high_y))
        for low_x, low_y, high_x, high_y in np.concatenate([first, last], axis=1).tolist()
    ]


def _outermost(
    boxes: Float[np.ndarray, "solids 4"], straight: Bool[np.ndarray, "solids"]
) -> Bool[np.ndarray, "solids"]:
    """Returns which solids do not lie within a straight one, seen from above; of equal ones the first."""
    x_min, y_min, x_max, y_max = boxes.T
    within = (x_min[:, None] >= x_min) & (y_min[:, None] >= y_min)
    within &= (x_max[:, None] <= x_max) & (y_max[:, None] <= y_max) & straight
    within &= ~within.T | np.tri(len(boxes), k=-1, dtype=bool)
    return ~within.any(axis=1)


def _draw_straight(grid: ExactGrid, boxes: Float[np.ndarray, "solids 6"], windows: Sequence[_Window]) -> None:
    grid.touched |= touched_by_bounds(grid.origin, grid.shape, boxes)
    columns, rows = (
        np.maximum(np.maximum(low[:, None] - centers, centers - high[:, None]), 0.0) ** 2
        for low, high, centers in ((boxes[:, axis], boxes[:, 3 + axis], grid.centers_m[axis]) for axis in (0, 1))
    )
    for (x, y), beyond_x, beyond_y in zip(windows, columns, rows, strict=True):
        _keep_nearest(grid, (x, y), np.sqrt(beyond_x[x, None] + beyond_y[y]))


def _keep_nearest(grid: ExactGrid, window: _Window, distance_m: Float[np.ndarray, "x y"]) -> None:
    kept = grid.distance_m[window]
    np.minimum(kept, distance_m, out=kept)


def _draw_circle(grid: ExactGrid, window: _Window, row: list[float]) -> None:
    x, y, _, radius, *_ = row
    dx, dy = np.abs(grid.centers_m[0][window[0]] - x)[:, None], np.abs(grid.centers_m[1][window[1]] - y)
    _keep_nearest(grid, window, np.maximum(np.sqrt(dx * dx + dy * dy) - radius, 0.0))
    into_x, into_y = np.maximum(dx - CELL_M / 2, 0.0), np.maximum(dy - CELL_M / 2, 0.0)  # of the cell's square
    grid.touched[window] |= into_x * into_x + into_y * into_y < radius * radius


def _draw_turned(grid: ExactGrid, window: _Window, row: list[float]) -> None:
    x, y, _, half_x, half_y, _, yaw = row
    cos, sin = math.cos(yaw), math.sin(yaw)
    dx, dy = grid.centers_m[0][window[0]][:, None] - x, grid.centers_m[1][window[1]] - y
    along, across = np.abs(cos * dx + sin * dy), np.abs(cos * dy - sin * dx)
    beyond_x, beyond_y = np.maximum(along - half_x, 0.0), np.maximum(across - half_y, 0.0)
    _keep_nearest(grid, window, np.sqrt(beyond_x * beyond_x + beyond_y * beyond_y))
    # Two rectangles meet where no side of either has the other one beyond it.
    half_cell = CELL_M / 2 * (abs(cos) + abs(sin))
    extent_x, extent_y = (
        CELL_M / 2 + abs(cos) * half_x + abs(sin) * half_y, CELL_M / 2 + abs(sin) * half_x + abs(cos) * half_y
    )  # fmt: skip
    meet = (along < half_x + half_cell) & (across < half_y + half_cell)
    grid.touched[window] |= meet & (np.abs(dx) < extent_x) & (np.abs(dy) < extent_y)


def _draw_prism(grid: ExactGrid, window: _Window, prism: Solid) -> None:
    corners = np.array(corners_m(prism))
    x, y = grid.centers_m[0][window[0]][:, None], grid.centers_m[1][window[1]]
    squared = np.full((x.size, y.size), np.inf)
    inside, meet = np.ones(squared.shape, dtype=bool), np.ones(squared.shape, dtype=bool)
    sides = half_planes(prism)
    for (normal_x, normal_y, out), begin, end in zip(sides, corners, np.roll(corners, -1, axis=0), strict=True):
        beyond = normal_x * x + normal_y * y - out
        passed = normal_x * (y - begin[1]) - normal_y * (x - begin[0])
        past = passed - passed.clip(0.0, math.hypot(*(end - begin)))
        np.minimum(squared, beyond * beyond + past * past, out=squared)
        inside &= beyond <= 0.0
        # The square and the prism meet where no side of either has the other one beyond it.
        meet &= beyond < CELL_M / 2 * (abs(normal_x) + abs(normal_y))
    _keep_nearest(grid, window, np.where(inside, 0.0, np.sqrt(squared)))
    (low_x, low_y), (high_x, high_y) = corners.min(axis=0) - CELL_M / 2, corners.max(axis=0) + CELL_M / 2
    meet &= (x > low_x) & (x < high_x) & (y > low_y) & (y < high_y)
    grid.touched[window] |= meet


def exact_grid(footprint: Box, solids: Sequence[Solid], most_radius_m: float = RADIUS_MAX_M) -> ExactGrid:
    """Returns the floor inside a footprint, with the solids that are in a robot's way.

    Args:
        footprint: The floor and the walls around it.
        solids: What stands on it.
        most_radius_m: Of the largest robot that anybody asks for.
    """
    origin, size = grid_of(footprint)
    furthest = math.hypot(most_radius_m, CELL_M / 2)
    empty = ExactGrid(origin, most_radius_m, np.full(size, furthest), np.zeros(size, dtype=bool))
    return empty.with_solids(solids)


@dataclass(frozen=True)
class Survey:
    """Where a robot can drive.

    Attributes:
        opened: With all doors fully open.
        as_set: With the doors as they stand.
    """

    opened: ExactGrid
    as_set: ExactGrid


def survey(
    rooms: Sequence[Room],
    passages: Sequence[Passage],
    walls: Sequence[Solid],
    furniture: Sequence[Furniture],
    doors: Sequence[Door] = (),
    *,
    radius_m: float,
) -> Survey:
    """Returns the floors of a finished world.

    Args:
        rooms: All rooms.
        passages: The ways between them.
        walls: All walls.
        furniture: All furniture.
        doors: All doors, as they stand.
        radius_m: Of the robot that the world is for.
    """
    area = bounding_box([room_box(room) for room in rooms]).grown(WALL_M)
    most_m = max(radius_m, most_through(rooms, passages, [passage.width_m / 2 for passage in passages]))
    empty = exact_grid(area, [*walls, *(solid for piece in furniture for solid in piece.solids)], most_m)
    opened = empty.with_solids(open_leaves(doors, passages)) if doors else empty
    if all(door.open_percent == FULLY_OPEN for door in doors):
        return Survey(opened, opened)
    return Survey(opened, empty.with_solids([door.leaf for door in doors]))


def most_through(rooms: Sequence[Room], passages: Sequence[Passage], through_m: Sequence[float]) -> float:
    """Returns a radius that no robot exceeds which gets into every room: each has to be entered by one of its passages.

    Args:
        rooms: All rooms.
        passages: The ways between them.
        through_m: The largest radius that gets through each passage.
    """
    starts = {
        room.name
        for room in rooms
        if room.floor.x_min_m < 0 < room.floor.x_max_m and room.floor.y_min_m < 0 < room.floor.y_max_m
    }
    widest = [
        max((most for most, passage in zip(through_m, passages, strict=True) if room.name in passage.rooms), default=0)
        for room in rooms
        if room.name not in starts
    ]
    return min([*widest, RADIUS_MAX_M])
