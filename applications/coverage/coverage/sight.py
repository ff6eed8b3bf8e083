"""What is seen from where: the floor in squares, and for each of them which others are in sight."""

from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np
from jaxtyping import Bool, Float64, Int16, UInt32
from scipy import ndimage

if TYPE_CHECKING:
    from tasks.simulate.application.contract import HostMap

# As many squares, whatever the world: arrays of one shape, 128 KiB of sights an episode.
MOST_SQUARES = 1024
WORD_BITS = 32
_LEAST_SIDE_CELLS = 2
# Rows and columns of squares: those of a map of 192 cells, so that worlds up to 19 m share a shape, or of a larger one.
_SQUARES_A_SIDE = (96, 128, 256)
# A robot may stand where no square's floor is, close to a solid; it then sees what is seen from the nearest square.
_NEAREST_SQUARES = 2.0
_RAYS = 256
# A ray ends where the nearest solid is this near: half a cell of the map.
_END_M = 0.05
_LEAST_STEP_M = 0.05


class Squares(NamedTuple):
    """The floor that the robot gets to, in squares of whole cells of the map.

    Attributes:
        number: The square at each row and column of squares, or the nearest one; -1 where none is near.
        side_cells: How many of the map's cells a square is wide.
        points_m: For each square, the middle of the cell that stands for it.
        room_m: The clearance there.
    """

    number: Int16[np.ndarray, "rows columns"]
    side_cells: int
    points_m: Float64[np.ndarray, "squares 2"]
    room_m: Float64[np.ndarray, "squares"]


def squares_of(floor: "HostMap", reachable: Bool[np.ndarray, "_ _"]) -> Squares:
    """Returns the marked cells of a map in at most MOST_SQUARES squares, as small as that allows."""
    rows, columns = np.nonzero(reachable)
    side = _LEAST_SIDE_CELLS
    while len(np.unique(_keys(rows, columns, side))) > MOST_SQUARES:
        side += 1
    keys = _keys(rows, columns, side)
    off_centre = (2 * (rows % side) + 1 - side) ** 2 + (2 * (columns % side) + 1 - side) ** 2
    order = np.lexsort((off_centre, keys))
    _, first = np.unique(keys[order], return_index=True)
    row, column = rows[order[first]], columns[order[first]]
    needed = -(-max(reachable.shape) // _LEAST_SIDE_CELLS)
    number = np.full(2 * (next(size for size in _SQUARES_A_SIDE if size >= needed),), -1, np.int16)
    number[row // side, column // side] = np.arange(len(first))
    points_m = floor.origin_m.astype(np.float64) + float(floor.cell_m) * np.stack([column, row], axis=1)
    return Squares(_filled(number), side, points_m, floor.clearance_m[row, column].astype(np.float64))


def sights(
    floor: "HostMap", points_m: Float64[np.ndarray, "squares 2"], range_m: float
) -> Bool[np.ndarray, "squares squares"]:
    """Returns which points see each other: no farther than the range, and no solid between."""
    free_m = _free_m(floor, points_m, range_m)
    way = points_m[None] - points_m[:, None]
    distance_m = np.hypot(way[..., 0], way[..., 1])
    turn = np.round(np.arctan2(way[..., 1], way[..., 0]) * (_RAYS / (2 * np.pi)), 6)
    ray = np.rint(turn).astype(np.int32) % _RAYS
    seen = distance_m <= np.take_along_axis(free_m, ray, axis=1) + 1e-6
    return seen | seen.T | np.eye(len(points_m), dtype=bool)


def packed(seen: Bool[np.ndarray, "squares squares"]) -> UInt32[np.ndarray, "all words"]:
    """Returns the sights as words of 32 squares, filled up to MOST_SQUARES squares that see nothing."""
    bits = np.zeros((MOST_SQUARES, MOST_SQUARES // WORD_BITS, WORD_BITS), np.uint32)
    count = len(seen)
    bits.reshape(MOST_SQUARES, MOST_SQUARES)[:count, :count] = seen
    return (bits << np.arange(WORD_BITS, dtype=np.uint32)).sum(axis=-1, dtype=np.uint32)


def _keys(rows: np.ndarray, columns: np.ndarray, side: int) -> np.ndarray:
    return (rows // side) * (columns.max() + 1) + columns // side


def _filled(number: Int16[np.ndarray, "rows columns"]) -> Int16[np.ndarray, "rows columns"]:
    found = ndimage.distance_transform_edt(number < 0, return_indices=True)
    away, nearest = cast("tuple[np.ndarray, np.ndarray]", found)
    return np.where(away <= _NEAREST_SQUARES, number[tuple(nearest)], -1).astype(np.int16)


def _free_m(
    floor: "HostMap", points_m: Float64[np.ndarray, "squares 2"], range_m: float
) -> Float64[np.ndarray, "squares rays"]:
    """Returns how far one sees from each point in each direction, going on by as much as nothing is near."""
    angle = 2 * np.pi * np.arange(_RAYS) / _RAYS
    rays = np.round(np.stack([np.cos(angle), np.sin(angle)], axis=-1), 9)
    last = np.array(floor.clearance_m.shape) - 1
    free_m = np.zeros(len(points_m) * _RAYS)
    going = np.arange(len(free_m))
    while len(going):
        place = points_m[going // _RAYS] + free_m[going, None] * rays[going % _RAYS]
        column, row = np.rint((place - floor.origin_m) / floor.cell_m).astype(np.int32).T
        clearance_m = floor.clearance_m[np.clip(row, 0, last[0]), np.clip(column, 0, last[1])]
        ends = (clearance_m < _END_M) | (free_m[going] >= range_m)
        going, clearance_m = going[~ends], clearance_m[~ends]
        free_m[going] += np.maximum(clearance_m - _END_M, _LEAST_STEP_M)
    return np.minimum(free_m, range_m).reshape(-1, _RAYS)
