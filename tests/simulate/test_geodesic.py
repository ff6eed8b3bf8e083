"""Shortest ways are those of the grid, found by another method in the test."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from tasks.simulate.contract import HostMap, Placement
from tasks.simulate.geodesic import shortest_paths_m

SIDE, CELL_M, RADIUS_M = 12, 0.5, 0.2  # the radius is below the grid's rounding: only solid cells are closed


def grid(blocked: np.ndarray) -> HostMap:
    clearance = np.where(blocked, 0.0, 1.0).astype(np.float32)
    origin, bounds = np.zeros(2, np.float32), np.array([0, 0, 6, 6], np.float32)
    return HostMap(clearance, origin, np.asarray(CELL_M, np.float32), bounds)


def by_dijkstra(blocked: np.ndarray, start: int, goal: int) -> float:
    cells = np.arange(SIDE * SIDE).reshape(SIDE, SIDE)
    edges: list[tuple[int, int, float]] = []
    for (row, column), here in np.ndenumerate(cells):
        for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1)):
            r, c = row + dr, column + dc
            if r < SIDE and 0 <= c < SIDE and not blocked[row, column] and not blocked[r, c]:
                edges.append((int(here), int(cells[r, c]), float(np.hypot(dr, dc))))
    if not edges:
        return 0.0 if start == goal else np.inf
    rows, columns, lengths = zip(*edges, strict=True)
    graph = csr_array((lengths, (rows, columns)), shape=(cells.size, cells.size))
    return float(dijkstra(graph, directed=False, indices=start)[goal]) * CELL_M


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.45))
def test_lengths_are_those_of_dijkstra(seed: int, share: float):
    rng = np.random.default_rng(seed)
    blocked = rng.random((SIDE, SIDE)) < share
    start, goal = rng.integers(SIDE * SIDE, size=2)
    blocked.flat[[start, goal]] = False
    ends = [np.array([k % SIDE, k // SIDE]) * CELL_M for k in (start, goal)]
    placement = Placement(np.array([*ends[0], 0.0]), ends[1][None])
    found = shortest_paths_m([grid(blocked)], [placement], RADIUS_M)[0]
    assert found == pytest.approx(by_dijkstra(blocked, start, goal), rel=1e-5)


def test_legs_add_up_in_order():
    free = np.zeros((SIDE, SIDE), bool)
    placement = Placement(np.array([0.0, 0.0, 1.0]), np.array([[2.0, 0.0], [2.0, 3.0], [2.0, 0.0]]))
    assert shortest_paths_m([grid(free)], [placement], RADIUS_M)[0] == pytest.approx(2.0 + 3.0 + 3.0)


def test_a_goal_behind_a_wall_is_infinitely_far():
    walled = np.zeros((SIDE, SIDE), bool)
    walled[:, 6] = True
    placement = Placement(np.zeros(3), np.array([[5.0, 1.0]]))
    assert shortest_paths_m([grid(walled)], [placement], RADIUS_M)[0] == np.inf
