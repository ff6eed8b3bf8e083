"""The way that is left to a goal, from everywhere on a world's map: what a reward for progress is made of.

Lengths are those of ways over the map's cells, straight and diagonal (E. W. Dijkstra, A Note on Two Problems in
Connexion with Graphs, 1959): up to 8 % longer than the shortest way. Cells that a hull cannot stand in have the way
from the nearest one that it can, and how far that is.
"""

from collections.abc import Sequence
from typing import NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int, UInt16
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from tasks.simulate.application.contract import HostMap

# A robot may stand where a cell's centre has this much less than its radius: cells are 0.1 m wide.
_SLACK_M = 0.05
_MM_PER_M = 1000.0
# 65.5 m, kept in whole millimetres: half the memory of floats, and finer than any control step.
_MOST_MM = 2**16 - 1
# To the right, up, and both diagonals; the way back is the same.
_STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))
Nearest = tuple[Float[np.ndarray, "rows columns"], Int[np.ndarray, "2 rows columns"]]


class WayFields(NamedTuple):
    """The way left in each cell, for the goals of each episode of a pool.

    Attributes:
        left_mm: In millimetres; behind a grid's last row and column there is nothing that is looked at.
        origin_m, cell_m: The grids, as the maps'.
        cells: How many a side of each grid.
    """

    left_mm: UInt16[jax.Array, "episodes goals rows columns"]
    origin_m: Float[jax.Array, "episodes 2"]
    cell_m: Float[jax.Array, "episodes"]
    cells: Int[jax.Array, "episodes"]


def ways_left_mm(
    floor: HostMap, goals_m: Sequence[Float[np.ndarray, "2"]], radius_m: float
) -> UInt16[np.ndarray, "goals rows columns"]:
    """Returns the way that is left to each goal, in each cell of a map.

    Args:
        floor: The map.
        goals_m: Places (x, y).
        radius_m: Of the robot's hull.
    """
    free = floor.clearance_m >= max(radius_m - _SLACK_M, 1e-6)
    if not free.any():
        return np.full((len(goals_m), *free.shape), _MOST_MM, np.uint16)
    graph, node = _graph(free, float(floor.cell_m))
    starts = [_nearest_node(floor, free, node, goal_m) for goal_m in goals_m]
    found = np.atleast_2d(csgraph.dijkstra(graph, directed=False, indices=starts))
    return np.stack([_filled(free, lengths_m, float(floor.cell_m)) for lengths_m in found])


def way_left_m(
    ways: WayFields, episode: Int[jax.Array, ""], goal: Int[jax.Array, ""], place_m: Float[jax.Array, "2"]
) -> Float[jax.Array, ""]:
    """Returns the way that is left from a place, between the four cells around it.

    Args:
        ways: Of the pool.
        episode: Which of its episodes.
        goal: Which of its goals.
        place_m: The place (x, y).
    """
    at = (place_m - ways.origin_m[episode]) / ways.cell_m[episode]
    low = jnp.clip(jnp.floor(at), 0.0, ways.cells[episode] - 2.0)
    share = jnp.clip(at - low, 0.0, 1.0)
    column, row = low.astype(jnp.int32)

    def left(up: int, right: int) -> Float[jax.Array, ""]:
        return ways.left_mm[episode, goal, row + up, column + right].astype(jnp.float32) / _MM_PER_M

    below = left(0, 0) + share[0] * (left(0, 1) - left(0, 0))
    above = left(1, 0) + share[0] * (left(1, 1) - left(1, 0))
    return below + share[1] * (above - below)


def _graph(free: Bool[np.ndarray, "rows columns"], cell_m: float) -> tuple[sparse.csr_array, np.ndarray]:
    """Returns the graph of free cells, and the number of each cell's node."""
    node = np.full(free.shape, -1)
    node[free] = np.arange(np.count_nonzero(free))
    ends: list[np.ndarray] = []
    for up, right in _STEPS:
        rows, columns = free.shape
        one = node[: rows - up, max(0, -right) : columns - max(0, right)]
        other = node[up:, max(0, right) : columns - max(0, -right)]
        both = (one >= 0) & (other >= 0)
        length_m = cell_m * np.hypot(up, right)
        ends.append(np.stack([one[both], other[both], np.full(np.count_nonzero(both), length_m)]))
    one, other, length_m = np.concatenate(ends, axis=1)
    count = int(node.max()) + 1
    places = (one.astype(np.int32), other.astype(np.int32))
    return sparse.csr_array((length_m, places), shape=(count, count)), node


def _nearest_node(
    floor: HostMap, free: Bool[np.ndarray, "rows columns"], node: np.ndarray, goal_m: Float[np.ndarray, "2"]
) -> int:
    rows, columns = np.nonzero(free)
    column, row = (goal_m - floor.origin_m) / floor.cell_m
    nearest = int(np.argmin((rows - row) ** 2 + (columns - column) ** 2))
    return int(node[rows[nearest], columns[nearest]])


def _filled(
    free: Bool[np.ndarray, "rows columns"], lengths_m: Float[np.ndarray, "nodes"], cell_m: float
) -> UInt16[np.ndarray, "rows columns"]:
    """Returns the lengths on the grid; cells from which no way leads have that of the nearest one, and to there."""
    left_m = np.full(free.shape, np.inf)
    left_m[free] = lengths_m
    reached = np.isfinite(left_m)
    away, nearest = cast("Nearest", ndimage.distance_transform_edt(~reached, return_indices=True))
    whole_m = left_m[nearest[0], nearest[1]] + cell_m * away
    return np.minimum(np.rint(whole_m * _MM_PER_M), _MOST_MM).astype(np.uint16)
