"""Follows the way on the map with wheels that must slip to turn: Dijkstra's way, in plain Python."""

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

jax = False

RADIUS_M, WHEEL_M, HALF_TRACK_M = 0.26, 0.065, 0.13
# Wheels that scrub turn the robot by 0.43 of what their speeds say (docs/guide/robots.md): ask for so much more.
SLIP = 2.3
TURN_GAIN, MOST_TURN_RAD_S, CELLS_AHEAD = 2.5, 1.5, 4
COMFORT_M, CROWDED, SLACK_M = 0.45, 6.0, 0.08


class Lidar(NamedTuple):
    rays: int = 9
    range_m: float = 5.0
    height_m: float = 0.13
    fov_rad: float = 1.6


class Follow:
    lidar = Lidar()

    def __init__(self, most_m_s):
        self._most_m_s = most_m_s

    def reset(self, floor, goals_m):
        self._floor, self._cells = floor, np.arange(floor.clearance_m.size).reshape(floor.clearance_m.shape)
        _, self._next = dijkstra(
            _prices(floor.clearance_m, self._cells), indices=self._cell(goals_m), return_predecessors=True
        )

    def step(self, observation):
        way = self._ahead(observation) - observation.pose[:2]
        error = np.arctan2(way[1], way[0]) - observation.pose[2]
        error = np.arctan2(np.sin(error), np.cos(error))
        free_m = max(observation.ranges_m.min() - RADIUS_M, 0.0)
        forward = min(self._most_m_s, 0.05 + free_m) * max(np.cos(error), 0.0) ** 2
        turn = np.clip(TURN_GAIN * error, -MOST_TURN_RAD_S, MOST_TURN_RAD_S)
        left, right = forward - SLIP * HALF_TRACK_M * turn, forward + SLIP * HALF_TRACK_M * turn
        return np.array([left, right, left, right]) / WHEEL_M

    def _ahead(self, observation):
        """Returns the point some cells ahead on the way; the goal itself where no way leads farther."""
        cell = self._cell(observation.pose[:2])
        for _ in range(CELLS_AHEAD):
            onward = self._next[observation.goal_index, cell]
            if onward < 0:  # this is the goal's cell, or no way leads from here
                return observation.goal_m
            cell = onward
        row, column = np.unravel_index(cell, self._cells.shape)
        return self._floor.origin_m + self._floor.cell_m * np.array([column, row])

    def _cell(self, points_m):
        column_row = np.round((points_m - self._floor.origin_m) / self._floor.cell_m).astype(int)
        rows, columns = self._cells.shape
        return self._cells[np.clip(column_row[..., 1], 0, rows - 1), np.clip(column_row[..., 0], 0, columns - 1)]


def _prices(clearance_m, cells):
    """Returns what it costs to go from each cell to each of its neighbours; near solids it costs more."""
    crowded = np.clip((COMFORT_M - clearance_m) / (COMFORT_M - RADIUS_M), 0.0, 2.0)
    price, free = 1.0 + CROWDED * crowded**2, clearance_m > RADIUS_M - SLACK_M
    sides = [(slice(0, -1), slice(1, None)), (slice(None), slice(None)), (slice(1, None), slice(0, -1))]
    links = []
    for up, (rows, to_rows) in enumerate(sides):
        for along, (columns, to_columns) in enumerate(sides):
            start, end = (rows, columns), (to_rows, to_columns)
            far = np.hypot(up - 1, along - 1)
            both = free[start] & free[end] & (far > 0.0)
            links.append((far * 0.5 * (price[start] + price[end])[both], cells[start][both], cells[end][both]))
    prices, starts, ends = (np.concatenate(each) for each in zip(*links, strict=True))
    return coo_matrix((prices, (starts, ends)), shape=(cells.size, cells.size)).tocsr()


def controller(environment):
    return Follow(environment.get("MAX_SPEED", 0.5))
