"""A tour of viewpoints that show the whole floor, for robots that go where they are sent."""

import numpy as np
from jaxtyping import Bool, Float64, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from .sight import Squares

# A viewpoint has this much more room than the hull needs, where such a place shows as much.
_ROOM_M = 0.1
Order = Int[np.ndarray, "viewpoints"]


def tour(squares: Squares, seen: Bool[np.ndarray, "squares squares"], start: int, hull_radius_m: float) -> Order:
    """Returns the squares to look from, in an order that makes for a short way from the start."""
    chosen = viewpoints(seen, squares.room_m >= hull_radius_m + _ROOM_M, start)
    return shortened(_ways_m(squares, [start, *chosen]), np.array([start, *chosen]))[1:]


def viewpoints(seen: Bool[np.ndarray, "squares squares"], roomy: Bool[np.ndarray, "squares"], start: int) -> list[int]:
    """Returns squares that show, besides the start, all others: the one that shows most that is new, again and again.

    That is at most a logarithm more squares than the fewest (Chvatal, A greedy heuristic for the set-covering problem,
    1979). The roomy ones are chosen first, the others for what is left then.
    """
    missing, chosen = ~seen[start], []
    for allowed in (roomy, np.ones_like(roomy)):
        while True:
            gain = np.where(allowed, (seen & missing).sum(axis=1), 0)
            best = int(np.argmax(gain))
            if gain[best] == 0:
                break
            chosen.append(best)
            missing &= ~seen[best]
    return chosen or [start]


def shortened(ways_m: Float64[np.ndarray, "places places"], places: Order) -> Order:
    """Returns places in the order of a short tour from the first: always the nearest, then exchanges (2-opt)."""
    order, left = [0], list(range(1, len(places)))
    while left:
        nearest = min(left, key=lambda each: (ways_m[order[-1], each], each))
        order.append(nearest)
        left.remove(nearest)
    while (better := _exchanged(ways_m, order)) is not None:
        order = better
    return places[order]


def _exchanged(ways_m: Float64[np.ndarray, "places places"], order: list[int]) -> list[int] | None:
    """Returns the order with one part turned round that shortens it, or None."""
    for first in range(1, len(order) - 1):
        for last in range(first + 1, len(order)):
            gain_m = ways_m[order[first - 1], order[first]] - ways_m[order[first - 1], order[last]]
            if last + 1 < len(order):
                gain_m += ways_m[order[last], order[last + 1]] - ways_m[order[first], order[last + 1]]
            if gain_m > 1e-6:
                return order[:first] + order[first : last + 1][::-1] + order[last + 1 :]
    return None


def _ways_m(squares: Squares, places: list[int]) -> Float64[np.ndarray, "places places"]:
    """Returns how long the ways between places are, going from square to square."""
    grid, count = squares.number.astype(np.int64), len(squares.points_m)
    pairs = [
        np.stack([one.ravel(), other.ravel()])
        for one, other in (
            (grid[:, :-1], grid[:, 1:]),
            (grid[:-1], grid[1:]),
            (grid[:-1, :-1], grid[1:, 1:]),
            (grid[:-1, 1:], grid[1:, :-1]),
        )
    ]
    joined = np.unique(np.sort(np.concatenate(pairs, axis=1), axis=0), axis=1)
    joined = joined[:, (joined[0] >= 0) & (joined[0] != joined[1])]
    lengths_m = np.round(np.hypot(*(squares.points_m[joined[0]] - squares.points_m[joined[1]]).T), 6)
    graph = coo_array((lengths_m, tuple(joined)), shape=(count, count)).tocsr()
    found_m = dijkstra(graph, directed=False, indices=places)[:, places]
    return np.where(np.isfinite(found_m), found_m, 1e6)
