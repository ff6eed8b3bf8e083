"""Fewer points for the same line."""

import numpy as np
from jaxtyping import Bool, Float


def simplified(line_m: Float[np.ndarray, "points 2"], tolerance_m: float) -> Float[np.ndarray, "kept 2"]:
    """Returns the first, the last, and as few points between them as keep all others near the line that they make.

    After Douglas and Peucker (1973, Cartographica 10:112): the farthest point from a chord is kept if it is farther
    than the tolerance, and both halves are treated likewise.

    Args:
        line_m: Points (x, y) in order.
        tolerance_m: How far a point that is left out may be from the chord that replaces it.
    """
    if len(line_m) < 3:
        return line_m
    keep = np.zeros(len(line_m), bool)
    keep[[0, -1]] = True
    _mark(line_m, keep, tolerance_m)
    return line_m[keep]


def fitted(line_m: Float[np.ndarray, "points 2"], tolerance_m: float, most: int) -> Float[np.ndarray, "kept 2"]:
    """Returns the line with as few points as `simplified` leaves, coarser where those were more than ``most``."""
    kept = simplified(line_m, tolerance_m)
    while len(kept) > max(2, most):
        tolerance_m *= 2.0
        kept = simplified(kept, tolerance_m)
    return kept


def _mark(line_m: Float[np.ndarray, "points 2"], keep: Bool[np.ndarray, " points"], tolerance_m: float) -> None:
    waiting = [(0, len(line_m) - 1)]
    while waiting:
        first, last = waiting.pop()
        if last - first < 2:
            continue
        away_m = _distances(line_m[first + 1 : last], line_m[first], line_m[last])
        farthest = int(np.argmax(away_m))
        if away_m[farthest] > tolerance_m:
            middle = first + 1 + farthest
            keep[middle] = True
            waiting += [(first, middle), (middle, last)]


def _distances(
    points_m: Float[np.ndarray, "points 2"], begin_m: Float[np.ndarray, "2"], end_m: Float[np.ndarray, "2"]
) -> Float[np.ndarray, " points"]:
    """Returns how far points are from a segment, which may be one point."""
    along = end_m - begin_m
    length2 = float(along @ along)
    share = np.clip((points_m - begin_m) @ along / length2, 0.0, 1.0) if length2 else np.zeros(len(points_m))
    nearest = begin_m + share[:, None] * along
    return np.hypot(*(points_m - nearest).T)
