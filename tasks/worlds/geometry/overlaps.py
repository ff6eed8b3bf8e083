"""Which solids of different things intersect: bounding boxes first, then separating axes."""

import struct
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from specs.data.world import Furniture, Solid

_TOUCH_M = 1e-4
"""Things that touch, or are rounded into each other by less than this, do not overlap."""


Rows = Float[np.ndarray, "solids 7"]
"""Centre, half extents and yaw of each solid."""


def count_overlaps(
    furniture: Sequence[Furniture], walls: Sequence[Solid], leaves: Sequence[Solid] = (), rows: Rows | None = None
) -> int:
    """Returns how many pairs of pieces or door leaves, or of one of these and a wall, intersect.

    A cylinder counts as the square around it, which can only find more.

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
    if a.yaw_rad == 0.0 and b.yaw_rad == 0.0:
        return True
    corners_a, corners_b = _corners(a), _corners(b)
    for yaw in (a.yaw_rad, b.yaw_rad):
        axes = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        on_a, on_b = corners_a @ axes, corners_b @ axes
        apart = (on_a.max(axis=0) <= on_b.min(axis=0) + _TOUCH_M) | (on_b.max(axis=0) <= on_a.min(axis=0) + _TOUCH_M)
        if apart.any():
            return False
    return True


def _corners(solid: Solid) -> Float[np.ndarray, "4 2"]:
    half_x, half_y, _ = solid.half_extents_m
    cos, sin = np.cos(solid.yaw_rad), np.sin(solid.yaw_rad)
    local = np.array([[-half_x, -half_y], [half_x, -half_y], [half_x, half_y], [-half_x, half_y]])
    return local @ np.array([[cos, sin], [-sin, cos]]) + np.array(solid.center_m[:2])
