"""Geometry of the floor: boxes, overlaps of pieces, and the widest robot that gets from the start into each room."""

import math
import struct
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from specs.data.world import Furniture, Room, Solid, corners_m

EPSILON_M = 1e-6
QUARTER_TURN_RAD = 1.5707963267948966
_TOUCH_M = 1e-4
"""Things that touch, or are rounded into each other by less than this, do not overlap."""
Rows = Float[np.ndarray, "solids 7"]
"""Centre, half extents and yaw of each solid."""
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
"""How large a robot may be at a cell of ``BoundsGrid``, by the square of the cells to the nearest touched one."""


class Box(NamedTuple):
    """An axis-aligned rectangle on the floor, by its corners (metres)."""

    x_min: float
    y_min: float
    x_max: float
    y_max: float

    @property
    def width(self) -> float:
        """Extent along x (metres)."""
        return self.x_max - self.x_min

    @property
    def height(self) -> float:
        """Extent along y (metres)."""
        return self.y_max - self.y_min

    @property
    def area(self) -> float:
        """Area (square metres)."""
        return self.width * self.height

    @property
    def center(self) -> tuple[float, float]:
        """The middle (metres)."""
        return (self.x_min + self.x_max) / 2, (self.y_min + self.y_max) / 2

    def grown(self, by_m: float) -> "Box":
        """Returns the box with each side moved outwards (inwards when negative)."""
        return Box(self.x_min - by_m, self.y_min - by_m, self.x_max + by_m, self.y_max + by_m)

    def shifted(self, dx_m: float, dy_m: float) -> "Box":
        """Returns the box moved."""
        return Box(self.x_min + dx_m, self.y_min + dy_m, self.x_max + dx_m, self.y_max + dy_m)

    def meets(self, other: "Box") -> bool:
        """Returns whether the two share more than a border."""
        return (
            self.x_min < other.x_max - EPSILON_M
            and other.x_min < self.x_max - EPSILON_M
            and self.y_min < other.y_max - EPSILON_M
            and other.y_min < self.y_max - EPSILON_M
        )


def bounding_box(boxes: Iterable[Box]) -> Box:
    """Returns the smallest box that holds all of them."""
    low_x, low_y, high_x, high_y = zip(*boxes, strict=True)
    return Box(min(low_x), min(low_y), max(high_x), max(high_y))


def room_box(room: Room) -> Box:
    """Returns a room's floor."""
    floor = room.floor
    return Box(floor.x_min_m, floor.y_min_m, floor.x_max_m, floor.y_max_m)


def rounded(value: float, digits: int = 6) -> float:
    """Returns a number as a document holds it: rounded, and never a negative zero."""
    return round(float(value), digits) + 0.0


def count_overlaps(
    furniture: Sequence[Furniture], walls: Sequence[Solid], leaves: Sequence[Solid] = (), rows: Rows | None = None
) -> int:
    """Returns how many pairs of pieces or door leaves, or of one of these and a wall, intersect.

    A cylinder counts as the square around it, which can only find more; a prism as what it is.

    Args:
        furniture: The pieces.
        walls: The walls.
        leaves: The door leaves.
        rows: The rows of the solids of furniture, leaves and walls, in this order, where they are known already.
    """
    pieces = [piece.solids for piece in furniture if piece.solids]
    things = [*pieces, *((leaf,) for leaf in leaves), *((wall,) for wall in walls)]
    parts = bounds(solid_rows([solid for thing in things for solid in thing]) if rows is None else rows)
    first = np.cumsum([0, *[len(thing) for thing in things]])
    around = np.concatenate(
        [np.minimum.reduceat(parts[:, :3], first[:-1]), np.maximum.reduceat(parts[:, 3:], first[:-1])], axis=1
    )
    movable = len(pieces) + len(leaves)
    pairs = [(a, b) for a, b in np.argwhere(_near(around[:movable], around)).tolist() if a < b]
    return sum(
        any(
            _overlap(things[a][m], things[b][n])
            for m, n in np.argwhere(_near(parts[first[a] : first[a + 1]], parts[first[b] : first[b + 1]])).tolist()
        )
        for a, b in pairs
    )


def _near(some: Float[np.ndarray, "some 6"], others: Float[np.ndarray, "others 6"]) -> Bool[np.ndarray, "some others"]:
    """Returns which bounding boxes overlap which others."""
    low, high, others_low, others_high = some[:, None, :3], some[:, None, 3:], others[:, :3], others[:, 3:]
    return np.logical_and.reduce((low < others_high - _TOUCH_M) & (others_low < high - _TOUCH_M), axis=2)


def solid_rows(solids: Sequence[Solid]) -> Rows:
    """Returns the row of each solid."""
    numbers: list[float] = []
    for solid in solids:
        numbers += solid.center_m
        numbers += solid.half_extents_m
        numbers.append(solid.yaw_rad)
    packed = struct.pack(f"{len(numbers)}d", *numbers)  # a third of the time that NumPy takes to look at each number
    return np.frombuffer(packed, dtype=np.float64).reshape(-1, 7)


def bounds(rows: Rows) -> Float[np.ndarray, "solids 6"]:
    """Returns the axis-aligned bounding boxes: x_min, y_min, z_min, x_max, y_max, z_max."""
    center, half, yaw = rows[:, :3], rows[:, 3:6], rows[:, 6]
    turned = yaw.nonzero()[0]
    if turned.size:
        half = half.copy()
        cos, sin = np.abs(np.cos(yaw[turned])), np.abs(np.sin(yaw[turned]))
        half_x, half_y = half[turned, 0], half[turned, 1]
        half[turned, 0], half[turned, 1] = half_x * cos + half_y * sin, half_x * sin + half_y * cos
    return np.concatenate([center - half, center + half], axis=1)


def _overlap(a: Solid, b: Solid) -> bool:
    """Returns whether two upright solids, whose bounding boxes overlap, do (separating axis theorem in the plane)."""
    if a.yaw_rad == 0.0 and b.yaw_rad == 0.0 and not (a.outline_m or b.outline_m):
        return True
    corners_a, corners_b = np.array(corners_m(a)), np.array(corners_m(b))
    for axes in (_axes(a), _axes(b)):
        on_a, on_b = corners_a @ axes, corners_b @ axes
        apart = (on_a.max(axis=0) <= on_b.min(axis=0) + _TOUCH_M) | (on_b.max(axis=0) <= on_a.min(axis=0) + _TOUCH_M)
        if apart.any():
            return False
    return True


def _axes(solid: Solid) -> Float[np.ndarray, "2 axes"]:
    """Returns the directions in which one of a solid's sides faces, or the opposite one."""
    if solid.outline_m:
        normals = half_planes(solid)[:, :2]
        return normals.T
    cos, sin = np.cos(solid.yaw_rad), np.sin(solid.yaw_rad)
    return np.array([[cos, -sin], [sin, cos]])


def half_planes(prism: Solid) -> Float[np.ndarray, "sides 3"]:
    """Returns the sides of a prism, each as its outward normal (x, y) and how far out it is from (0, 0)."""
    corners = np.array(corners_m(prism))
    along = np.roll(corners, -1, axis=0) - corners
    normals = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.hypot(*along.T)[:, None]
    return np.column_stack([normals, np.sum(normals * corners, axis=1)])


def label_parts(free: Bool[np.ndarray, "x y"]) -> Int[np.ndarray, "x y"]:
    """Returns a number for each free cell, 1 or more and the same for all that hang together; 0 for the others.

    What hangs together is what a walk reaches that goes to the four neighbours of a cell.
    """
    from scipy import ndimage  # noqa: PLC0415 - commands that make no worlds start without SciPy

    labels = np.zeros(free.shape, dtype=np.int32)
    ndimage.label(free, output=labels)
    return labels


def connected(free: Bool[np.ndarray, "x y"], cell: tuple[int, int]) -> Bool[np.ndarray, "x y"]:
    """Returns the free cells that hang together with one of them; none where that one is not free."""
    labels = label_parts(free)
    return (labels == labels[cell]) & free


class FloorGrid(ABC):
    """A floor in cells, and where a robot can be on it.

    Attributes:
        origin: Lower left corner of the first cell (metres).
        shape: How many cells there are along x and y.
    """

    def __init__(self, origin: tuple[float, float], shape: tuple[int, int]) -> None:
        self.origin, self.shape = origin, shape
        self._reached: dict[float, Bool[np.ndarray, "x y"]] = {}
        self._free: dict[float, Bool[np.ndarray, "x y"]] = {}

    @abstractmethod
    def _find_free(self, radius_m: float) -> Bool[np.ndarray, "x y"]:
        """Returns the cells at which a robot of that radius can stand, and between which it can move."""

    def free(self, radius_m: float) -> Bool[np.ndarray, "x y"]:
        """Returns the cells at which a robot of that radius can stand.

        It also gets from each of them to any of the four beside it that is free: a way on the grid is a way on the
        floor.

        Args:
            radius_m: At most ``RADIUS_MAX_M``.
        """
        if radius_m not in self._free:
            self._free[radius_m] = self._find_free(radius_m)
        return self._free[radius_m]

    def reached(self, radius_m: float) -> Bool[np.ndarray, "x y"]:
        """Returns the cells that a robot of that radius gets to from (0, 0)."""
        if radius_m not in self._reached:
            self._reached[radius_m] = self._walk(self.free(radius_m))
        return self._reached[radius_m]

    def _walk(self, free: Bool[np.ndarray, "x y"]) -> Bool[np.ndarray, "x y"]:
        """Returns the free cells that a walk from (0, 0) reaches."""
        x, y = (int(-low // CELL_M) for low in self.origin)
        rows, columns = free.shape
        return connected(free, (x, y)) if 0 <= x < rows and 0 <= y < columns else np.zeros_like(free)

    def cells(self, box: Box) -> tuple[slice, slice]:
        """Returns the cells whose centres lie in a box."""
        x, y = self.origin
        low_x, low_y = math.ceil((box.x_min - x) / CELL_M - 0.5), math.ceil((box.y_min - y) / CELL_M - 0.5)
        high_x, high_y = math.floor((box.x_max - x) / CELL_M + 0.5), math.floor((box.y_max - y) / CELL_M + 0.5)
        return slice(max(low_x, 0), max(high_x, 0)), slice(max(low_y, 0), max(high_y, 0))


class BoundsGrid(FloorGrid):
    """A floor on which each solid takes all cells that its bounding box touches: quick, and on the safe side.

    Furniture is tried with it. A finished world is measured exactly (``tasks.worlds.survey``).

    Attributes:
        touched: Cells that the bounding box of a solid in a robot's way touches.
    """

    def __init__(self, origin: tuple[float, float], touched: Bool[np.ndarray, "x y"]) -> None:
        super().__init__(origin, (touched.shape[0], touched.shape[1]))
        self.touched = touched

    def _find_free(self, radius_m: float) -> Bool[np.ndarray, "x y"]:
        """Returns the cells that are far enough from touched ones."""
        return ~_spread(self.touched, int(_RADII_M.searchsorted(radius_m)) - 1)


def _spread(touched: Bool[np.ndarray, "x y"], squared: int) -> Bool[np.ndarray, "x y"]:
    """Returns the cells with a touched one so near, by the square of the cells between them.

    A disc is spread row by row: its rows get longer towards its middle.
    """
    near, wide, aside, last = np.zeros_like(touched), touched.copy(), 0, len(touched)
    for rows in range(math.isqrt(squared), -1, -1):
        while aside < math.isqrt(squared - rows * rows):
            aside += 1
            wide[:, aside:] |= touched[:, :-aside]
            wide[:, :-aside] |= touched[:, aside:]
        near[rows:] |= wide[: max(last - rows, 0)]
        near[: max(last - rows, 0)] |= wide[rows:]
    return near


def grid_of(footprint: Box) -> tuple[tuple[float, float], tuple[int, int]]:
    """Returns the lower left corner of a footprint's grid, and how many cells it has along x and y."""
    footprint = Box(*(rounded(side) for side in footprint))
    size = (math.ceil(footprint.width / CELL_M), math.ceil(footprint.height / CELL_M))
    return (footprint.x_min, footprint.y_min), size


def touched_by_bounds(
    origin: tuple[float, float], size: tuple[int, int], boxes: Float[np.ndarray, "solids 6"]
) -> Bool[np.ndarray, "x y"]:
    """Returns the cells of a grid that bounding boxes share more than a border with."""
    touched = np.zeros(size, dtype=bool)
    cells = (boxes[:, [0, 1, 3, 4]] - [*origin, *origin]) / CELL_M
    outer = np.concatenate([np.floor(cells[:, :2]), np.ceil(cells[:, 2:])], axis=1).astype(int).clip(0)
    for x_min, y_min, x_max, y_max in outer.tolist():
        touched[x_min:x_max, y_min:y_max] = True
    return touched


def bounds_grid(footprint: Box, solids: Sequence[Solid]) -> BoundsGrid:
    """Returns the floor inside a footprint, with the bounding boxes of the solids that are in a robot's way."""
    origin, size = grid_of(footprint)
    boxes = bounds(solid_rows(solids))
    return BoundsGrid(origin, touched_by_bounds(origin, size, boxes[boxes[:, 2] < HEADROOM_M]))


def reaches_room(reached: Bool[np.ndarray, "x y"], grid: FloorGrid, floor: Box, radius_m: float) -> bool:
    """Returns whether a robot gets its whole disc into a room.

    Args:
        reached: The cells that the robot gets to.
        grid: The floor.
        floor: The room's floor.
        radius_m: The robot's radius.
    """
    return bool(reached[grid.cells(floor.grown(-radius_m))].any())


def connected_share(reached: Bool[np.ndarray, "x y"], grid: FloorGrid, floor: Box, radius_m: float) -> float:
    """Returns how much of a room's floor that is free for a robot can be reached, 0-1.

    Args:
        reached: The cells that the robot gets to.
        grid: The floor.
        floor: The room's floor.
        radius_m: The robot's radius.
    """
    cells = grid.cells(floor)
    free = grid.free(radius_m)[cells]
    return float(np.count_nonzero(reached[cells])) / max(int(np.count_nonzero(free)), 1)
