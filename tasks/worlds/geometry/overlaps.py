"""Which solids of different things intersect: bounding boxes first, then separating axes."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from specs.data.world import Furniture, Solid

_TOUCH_M = 1e-4
"""Things that touch, or are rounded into each other by less than this, do not overlap."""


def count_overlaps(furniture: Sequence[Furniture], walls: Sequence[Solid], leaves: Sequence[Solid] = ()) -> int:
    """Returns how many pairs of pieces or door leaves, or of one of these and a wall, intersect.

    A cylinder counts as the square around it, which can only find more.
    """
    solids = [*(solid for piece in furniture for solid in piece.solids), *leaves, *walls]
    owner = [number for number, piece in enumerate(furniture) for _ in piece.solids]
    things = len(furniture) + len(leaves)
    owner += range(len(furniture), things + len(walls))
    pairs = {
        (owner[a], owner[b])
        for a, b in np.argwhere(_near(solids, owner, things)).tolist()
        if _overlap(solids[a], solids[b])
    }
    return len(pairs)


def _near(solids: Sequence[Solid], owner: Sequence[int], pieces: int) -> Bool[np.ndarray, "solids solids"]:
    """Returns the pairs (each once) of different owners, not both walls, whose bounding boxes overlap."""
    boxes = np.array([bounds(solid) for solid in solids]).reshape(-1, 6)
    low, high = boxes[:, :3], boxes[:, 3:]
    near = ((low[:, None] < high[None] - _TOUCH_M) & (low[None] < high[:, None] - _TOUCH_M)).all(axis=2)
    owners = np.array(owner)
    return near & (owners[:, None] < owners[None]) & (owners[:, None] < pieces)


def bounds(solid: Solid) -> tuple[float, float, float, float, float, float]:
    """Returns the axis-aligned bounding box: x_min, y_min, z_min, x_max, y_max, z_max."""
    half_x, half_y, half_z = solid.half_extents_m
    if solid.yaw_rad != 0.0:
        cos, sin = abs(np.cos(solid.yaw_rad)), abs(np.sin(solid.yaw_rad))
        half_x, half_y = half_x * cos + half_y * sin, half_x * sin + half_y * cos
    x, y, z = solid.center_m
    return x - half_x, y - half_y, z - half_z, x + half_x, y + half_y, z + half_z


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
