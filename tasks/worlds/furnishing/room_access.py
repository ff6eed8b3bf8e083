"""Whether a robot gets from each way into a room to every other, and to nearly all of its floor."""

from collections.abc import Sequence
from functools import lru_cache

from tasks.worlds.geometry.boxes import Box
from tasks.worlds.geometry.floods import flood

_CELL_M = 0.1
# What the clearance grid takes from a way at most: see GRID_SLACK there, and half of its cell.
_PLAY_M = 0.09
_CONNECTED = 0.78


def robot_gets_around(
    floor: Box, bodies: Sequence[Box], entries: Sequence[tuple[float, float]], radius_m: float
) -> bool:
    """Returns whether a robot gets around in a room.

    Args:
        floor: The room's floor.
        bodies: What stands on it.
        entries: Where a robot stands that has just come in, or starts.
        radius_m: The robot's radius.
    """
    room = floor.grown(-radius_m - _PLAY_M)
    rows, columns = int(room.width / _CELL_M) + 1, int(room.height / _CELL_M) + 1
    if min(rows, columns) < 2:
        return not bodies
    starts = _row_starts(rows, columns)
    free = starts[rows] * ((1 << columns) - 1)
    for body in bodies:
        free &= ~_covered(body, room, radius_m + _PLAY_M, rows, columns)
    if not entries:
        return _has_large_part(free, columns + 1)
    cells = [_cell(room, entry, rows, columns) for entry in entries]
    if not all(free & cell for cell in cells):
        return False
    part = flood(cells[0], free, columns + 1)
    return all(part & cell for cell in cells) and part.bit_count() >= _CONNECTED * free.bit_count()


@lru_cache(maxsize=256)
def _row_starts(rows: int, columns: int) -> tuple[int, ...]:
    """Returns the first cells of so many rows, for 0 to ``rows``; rows are a cell further apart than they are long."""
    starts = [0]
    for row in range(rows):
        starts.append(starts[-1] | 1 << row * (columns + 1))
    return tuple(starts)


def _covered(body: Box, room: Box, by_m: float, rows: int, columns: int) -> int:
    """Returns the cells from which a robot would touch a body.

    Args:
        body: The body.
        room: Where the robot's middle may be.
        by_m: How near it may come to the body.
        rows: How many cells there are along x.
        columns: How many cells there are along y.
    """
    x_min, y_min, x_max, y_max = body
    low_x = max(int((x_min - by_m - room.x_min) / _CELL_M) + 1, 0)
    high_x = min(max(int((x_max + by_m - room.x_min) / _CELL_M) + 1, 0), rows)
    low_y = max(int((y_min - by_m - room.y_min) / _CELL_M) + 1, 0)
    high_y = min(max(int((y_max + by_m - room.y_min) / _CELL_M) + 1, 0), columns)
    if high_x <= low_x or high_y <= low_y:
        return 0
    block = _row_starts(rows, columns)[high_x - low_x] * ((1 << high_y - low_y) - 1)
    return block << low_x * (columns + 1) + low_y


def _cell(room: Box, point: tuple[float, float], rows: int, columns: int) -> int:
    x = min(max(round((point[0] - room.x_min) / _CELL_M), 0), rows - 1)
    y = min(max(round((point[1] - room.y_min) / _CELL_M), 0), columns - 1)
    return 1 << x * (columns + 1) + y


def _has_large_part(free: int, row: int) -> bool:
    """Returns whether nearly all free cells hang together."""
    wanted, left = _CONNECTED * free.bit_count(), free
    while left and left.bit_count() >= wanted:
        part = flood(left & -left, left, row)
        if part.bit_count() >= wanted:
            return True
        left &= ~part
    return False
