"""Whether a robot gets from each way into a room to every other, and to nearly all of its floor."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Int

from tasks.worlds.geometry.boxes import Box
from tasks.worlds.geometry.clearance import CROSS

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
    from scipy import ndimage  # noqa: PLC0415 - many runs make no worlds, and are not to wait for SciPy

    room = floor.grown(-radius_m - _PLAY_M)
    size = (int(room.width / _CELL_M) + 1, int(room.height / _CELL_M) + 1)
    if min(size) < 2:
        return not bodies
    free = np.ones(size, dtype=np.int8)
    for body in bodies:
        x_min, y_min, x_max, y_max = body.grown(radius_m + _PLAY_M)
        rows = slice(max(int((x_min - room.x_min) / _CELL_M) + 1, 0), max(int((x_max - room.x_min) / _CELL_M) + 1, 0))
        columns = slice(
            max(int((y_min - room.y_min) / _CELL_M) + 1, 0), max(int((y_max - room.y_min) / _CELL_M) + 1, 0)
        )
        free[rows, columns] = 0
    labels: Int[np.ndarray, "x y"] = np.zeros(size, dtype=np.int32)
    ndimage.label(free, structure=CROSS, output=labels)
    found = {_label(labels, room, entry) for entry in entries}
    sizes = np.bincount(labels.ravel())[1:]
    if not entries:
        return sizes.size > 0 and int(sizes.max()) >= _CONNECTED * int(sizes.sum())
    return len(found) == 1 and 0 not in found and int(sizes[min(found) - 1]) >= _CONNECTED * int(sizes.sum())


def _label(labels: Int[np.ndarray, "x y"], room: Box, point: tuple[float, float]) -> int:
    x = min(max(round((point[0] - room.x_min) / _CELL_M), 0), labels.shape[0] - 1)
    y = min(max(round((point[1] - room.y_min) / _CELL_M), 0), labels.shape[1] - 1)
    return int(labels[x, y])
