"""The shortest path of a disc on the floor, which a driven path is compared with.

Ways go at any angle and are exact but for the polygons that stand for arcs. A goal is a disc, too: where the robot has
arrived.
"""

import functools
import itertools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64, Int
from scipy.sparse.csgraph import dijkstra

from tasks.simulate.application.contract import Placement
from tasks.simulate.surroundings.obstacles import Obstacles
from tasks.simulate.surroundings.ways.open_floor import has_room
from tasks.simulate.surroundings.ways.tangent_graph import TangentGraph, distance_matrix, tangent_graph
from tasks.simulate.surroundings.ways.tour import RIM_UNITS, Lines, tour_lengths
from tasks.simulate.surroundings.ways.visibility import Points, solids_of

_NOWHERE = -9999  # SciPy's word for a node without predecessor
_numbers = itertools.count()


class Ways:
    """The ways of a disc about a world.

    Attributes:
        number: Of no other ways in this process, also after these are gone.
    """

    def __init__(self, touched: Obstacles, radius_m: float) -> None:
        """Begins; the ways are found when they are asked for first.

        Args:
            touched: The world's solids.
            radius_m: Of the disc.
        """
        self._touched, self._radius_m, self.number = touched, radius_m, next(_numbers)

    @functools.cached_property
    def graph(self) -> TangentGraph:
        """The straight ways between the corners of solids."""
        return tangent_graph(solids_of(self._touched), self._radius_m)


def shortest_paths_m(
    ways: Sequence[Ways], placements: Sequence[Placement], arrived_m: Sequence[float]
) -> Float64[np.ndarray, "lanes"]:
    """Returns each lane's shortest length from its start to all its goals in order; infinite where there is no way.

    Args:
        ways: Those of each lane's world; lanes of one world share theirs.
        placements: Start and goals.
        arrived_m: How near to a goal each lane's robot must come.
    """
    lengths = np.full(len(placements), np.inf)
    alike: dict[tuple[int, int], list[int]] = {}
    for lane, (world, placement) in enumerate(zip(ways, placements, strict=True)):
        alike.setdefault((id(world), len(placement.goals_m)), []).append(lane)
    for lanes in alike.values():
        near_m = np.array([arrived_m[lane] for lane in lanes])
        lengths[lanes] = _lengths(ways[lanes[0]].graph, [placements[lane] for lane in lanes], near_m)
    return lengths


def _lengths(
    graph: TangentGraph, placements: Sequence[Placement], arrived_m: Float64[np.ndarray, "tasks"]
) -> Float64[np.ndarray, "tasks"]:
    """Returns the shortest lengths in one world."""
    given = np.stack([np.vstack([each.start[:2], each.goals_m]) for each in placements])
    # A start that a disc has no room on is taken for the place beside it, a goal for where it counts as reached.
    near_m = np.repeat(arrived_m[:, None], given.shape[1], axis=1)
    near_m[:, 0] = graph.floor.radius_m
    stops = _onto_free_floor(graph, given.reshape(-1, 2), near_m.ravel()).reshape(given.shape)
    near_m = np.where(np.all(stops == given, axis=-1), near_m, 0.0)
    roomy = np.all(has_room(graph.floor, stops.reshape(-1, 2)).reshape(near_m.shape), axis=1)
    legs = _lines(graph, stops)
    found = np.flatnonzero(roomy & np.all([leg.counts > 0 for leg in legs], axis=0))
    lengths = np.full(len(placements), np.inf)
    if len(found):
        legs = [Lines(leg.corners_m[found], leg.counts[found]) for leg in legs]
        lengths[found] = tour_lengths(graph.floor, stops[found], near_m[found], legs)
    return lengths


def _onto_free_floor(graph: TangentGraph, points: Points, within_m: Float64[np.ndarray, "points"]) -> Points:
    """Returns the points, those where the disc has no room moved to a place beside them that has, if there is one."""
    moved = points.copy()
    for index in np.flatnonzero(~has_room(graph.floor, points)):
        rings = within_m[index] * np.arange(1, 5)[:, None, None] / 4 * RIM_UNITS
        places = (points[index] + rings).reshape(-1, 2)
        free = np.flatnonzero(has_room(graph.floor, places))
        if len(free):
            moved[index] = places[free[0]]
    return moved


def _lines(graph: TangentGraph, stops: Float64[np.ndarray, "tasks stops 2"]) -> list[Lines]:
    """Returns for each leg the shortest lines of all tasks from stop to stop; without corners where there is no way."""
    points, nodes = np.unique(stops.reshape(-1, 2), axis=0, return_inverse=True)
    nodes = nodes.reshape(stops.shape[:2])
    pairs = np.unique(np.stack([nodes[:, :-1].ravel(), nodes[:, 1:].ravel()]), axis=1)
    corners = len(graph.corners_m)
    sources = np.unique(nodes[:, :-1])
    ways = distance_matrix(graph, points, (pairs[0], pairs[1]))
    _, before = dijkstra(ways, indices=corners + sources, return_predecessors=True)
    row_of = np.zeros(len(points), int)
    row_of[sources] = np.arange(len(sources))
    places = np.vstack([graph.corners_m, points, points])

    def leg(starts: Int[np.ndarray, "tasks"], ends: Int[np.ndarray, "tasks"]) -> Lines:
        rows, here = row_of[starts], corners + len(points) + ends
        nowhere = (before[rows, here] == _NOWHERE) & (starts != ends)
        there = np.where(nowhere, here, corners + starts)
        passed = [here]
        while np.any(here != there):
            here = np.where((here == there) | (starts == ends), there, before[rows, here])
            passed.append(here)
        # Backwards until here: turned around, and the end repeated where a line has fewer corners than others.
        counts = 1 + np.sum(np.stack(passed[:-1]) != there, axis=0) if len(passed) > 1 else np.ones(len(here), int)
        order = np.maximum(counts[:, None] - 1 - np.arange(len(passed)), 0)
        return Lines(places[np.take_along_axis(np.stack(passed, axis=1), order, axis=1)], np.where(nowhere, 0, counts))

    return [leg(nodes[:, stop], nodes[:, stop + 1]) for stop in range(stops.shape[1] - 1)]
