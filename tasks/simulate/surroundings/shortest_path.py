"""The shortest path of a disc on the floor, which a driven path is compared with.

Ways go at any angle and are exact but for the polygons that stand for arcs. A goal is a disc, too: where the robot has
arrived.
"""

import functools
import itertools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float64
from scipy.sparse.csgraph import dijkstra

from tasks.simulate.application.contract import Placement
from tasks.simulate.surroundings.obstacles import Obstacles
from tasks.simulate.surroundings.tangent_graph import TangentGraph, distance_matrix, is_free_place, tangent_graph
from tasks.simulate.surroundings.visibility import Points, is_free, solids_of

_GRAPHS_KEPT = 512
# Places on the rim of a goal's disc that a way may bend at.
_RIM = 24
_RIM_RAD = 2 * np.pi * np.arange(_RIM) / _RIM
_RIM_UNITS = np.stack([np.cos(_RIM_RAD), np.sin(_RIM_RAD)], axis=-1)
Point = Float64[np.ndarray, "2"]
Line = Float64[np.ndarray, "_ 2"]
_NOWHERE = -9999  # SciPy's word for a node without predecessor


def shortest_paths_m(
    touched: Sequence[Obstacles], placements: Sequence[Placement], hull_radius_m: float, arrived_m: Sequence[float]
) -> Float64[np.ndarray, "lanes"]:
    """Returns each lane's shortest length from its start to all its goals in order; infinite where there is no way.

    Args:
        touched: The solids of each lane's world.
        placements: Start and goals.
        hull_radius_m: Of the disc that is moved.
        arrived_m: How near to a goal each lane's robot must come.
    """
    lengths = np.full(len(placements), np.inf)
    alike: dict[tuple[bytes, bytes, int], list[int]] = {}
    for lane, (each, placement) in enumerate(zip(touched, placements, strict=True)):
        key = (each.boxes.tobytes(), each.cylinders.tobytes(), len(placement.goals_m))
        alike.setdefault(key, []).append(lane)
    for (boxes, cylinders, _), lanes in alike.items():
        graph = _graph(boxes, cylinders, hull_radius_m)
        lengths[lanes] = _lengths(graph, [placements[lane] for lane in lanes], np.array([arrived_m[k] for k in lanes]))
    return lengths


@functools.lru_cache(maxsize=_GRAPHS_KEPT)
def _graph(boxes: bytes, cylinders: bytes, radius_m: float) -> TangentGraph:
    """Returns the ways around a world's solids; kept, since many chunks drive in the same worlds."""
    touched = Obstacles(
        np.frombuffer(boxes, np.float32).reshape(-1, 8), np.frombuffer(cylinders, np.float32).reshape(-1, 5)
    )
    return tangent_graph(solids_of(touched), radius_m)


def _lengths(
    graph: TangentGraph, placements: Sequence[Placement], arrived_m: Float64[np.ndarray, "tasks"]
) -> Float64[np.ndarray, "tasks"]:
    """Returns the shortest lengths in one world."""
    given = np.stack([np.vstack([each.start[:2], each.goals_m]) for each in placements])
    # A start that a disc has no room on is taken for the place beside it, a goal for where it counts as reached.
    near_m = np.repeat(arrived_m[:, None], given.shape[1], axis=1)
    near_m[:, 0] = graph.radius_m
    stops = _onto_free_floor(graph, given.reshape(-1, 2), near_m.ravel()).reshape(given.shape)
    near_m = np.where(np.all(stops == given, axis=-1), near_m, 0.0)
    roomy = np.all(is_free_place(graph, stops.reshape(-1, 2)).reshape(near_m.shape), axis=1)
    lines = _lines(graph, stops)
    found = [task for task, legs in enumerate(lines) if roomy[task] and all(len(leg) for leg in legs)]
    lengths = np.full(len(placements), np.inf)
    if found:
        lengths[found] = _tour_lengths(graph, stops[found], near_m[found], [lines[task] for task in found])
    return lengths


def _onto_free_floor(graph: TangentGraph, points: Points, within_m: Float64[np.ndarray, "points"]) -> Points:
    """Returns the points, those where the disc has no room moved to a place beside them that has, if there is one."""
    moved = points.copy()
    for index in np.flatnonzero(~is_free_place(graph, points)):
        rings = within_m[index] * np.arange(1, 5)[:, None, None] / 4 * _RIM_UNITS
        places = (points[index] + rings).reshape(-1, 2)
        free = np.flatnonzero(is_free_place(graph, places))
        if len(free):
            moved[index] = places[free[0]]
    return moved


def _lines(graph: TangentGraph, stops: Float64[np.ndarray, "tasks stops 2"]) -> list[list[Line]]:
    """Returns for each task the shortest lines from stop to stop; an empty one where there is no way."""
    points, nodes = np.unique(stops.reshape(-1, 2), axis=0, return_inverse=True)
    nodes = nodes.reshape(stops.shape[:2])
    pairs = np.unique(np.stack([nodes[:, :-1].ravel(), nodes[:, 1:].ravel()]), axis=1)
    corners = len(graph.corners_m)
    sources = np.unique(nodes[:, :-1])
    ways = distance_matrix(graph, points, (pairs[0], pairs[1]))
    _, before = dijkstra(ways, indices=corners + sources, return_predecessors=True)
    places = np.vstack([graph.corners_m, points, points])
    rows = {int(node): before[row] for row, node in enumerate(sources)}

    def line(start: int, end: int) -> Line:
        if start == end:
            return points[[start, end]]
        reached = [corners + len(points) + end]
        while reached[-1] != corners + start:
            previous = int(rows[start][reached[-1]])
            if previous == _NOWHERE:
                return np.empty((0, 2))
            reached.append(previous)
        return places[reached[::-1]]

    return [[line(int(one), int(other)) for one, other in itertools.pairwise(row)] for row in nodes]


def _tour_lengths(
    graph: TangentGraph,
    stops: Float64[np.ndarray, "tasks stops 2"],
    near_m: Float64[np.ndarray, "tasks stops"],
    lines: list[list[Line]],
) -> Float64[np.ndarray, "tasks"]:
    """Returns how long the lines are when each stop counts as reached from near: corners are cut there."""
    tasks, last = len(stops), stops.shape[1] - 1
    total, here = np.zeros(tasks), stops[:, 0].copy()
    for stop in range(1, last + 1):
        ends = []
        for task in range(tasks):
            line = np.vstack([here[task], lines[task][stop - 1][1:]])
            driven, end, rest = _until_near(line, stops[task, stop], near_m[task, stop])
            total[task] += driven + (rest if stop == last else 0.0)
            ends.append(end)
        if stop == last:
            break
        onward = [_first_beyond(lines[task][stop], stops[task, stop], near_m[task, stop]) for task in range(tasks)]
        before, after = np.stack(ends), np.stack([line[0] for line in onward])
        here = _bends(graph, before, after, stops[:, stop], near_m[:, stop])
        total += np.hypot(*(here - before).T)
        for task, line in enumerate(onward):
            lines[task][stop] = np.vstack([here[task], line])
    return total


def _until_near(line: Line, goal: Point, near_m: float) -> tuple[float, Point, float]:
    """Returns a line's length to its last corner before it comes near a goal, that corner, and what is left to go."""
    way = np.diff(line, axis=0)
    length = np.hypot(*way.T)
    unit = way / np.maximum(length, 1e-12)[:, None]
    to_goal = goal - line[:-1]
    along = np.sum(to_goal * unit, axis=1)
    across = to_goal[:, 0] * unit[:, 1] - to_goal[:, 1] * unit[:, 0]
    half_chord = np.sqrt(np.maximum(near_m**2 - across**2, 0.0))
    enters = (np.abs(across) <= near_m) & (along + half_chord >= 0.0) & (along - half_chord <= length)
    enters[-1] = True
    first = int(np.argmax(enters))
    rest = float(np.clip(along[first] - half_chord[first], 0.0, length[first]))
    return float(length[:first].sum()), line[first], rest


def _first_beyond(line: Line, goal: Point, near_m: float) -> Line:
    """Returns what follows of a line after its corners near a goal; at least its end."""
    far = np.hypot(*(line - goal).T) > near_m
    far[-1] = True
    return line[int(np.argmax(far)) :]


def _bends(
    graph: TangentGraph, before: Points, after: Points, goals: Points, near_m: Float64[np.ndarray, "points"]
) -> Points:
    """Returns where a way between two corners best touches its goal's disc; the goal itself where all else is shut."""
    way = after - before
    share = np.sum((goals - before) * way, axis=1) / np.maximum(np.sum(way**2, axis=1), 1e-12)
    passing = before + np.clip(share, 0.0, 1.0)[:, None] * way
    beside = passing - goals
    beside *= np.minimum(1.0, near_m / np.maximum(np.hypot(*beside.T), 1e-12))[:, None]
    rim = goals[:, None] + near_m[:, None, None] * _RIM_UNITS
    places = np.concatenate([rim, (goals + beside)[:, None], goals[:, None]], axis=1)
    lengths = np.hypot(*np.moveaxis(places - before[:, None], -1, 0)) + np.hypot(
        *np.moveaxis(places - after[:, None], -1, 0)
    )
    flat = places.reshape(-1, 2)
    each = places.shape[1]
    free = is_free_place(graph, flat)
    for corner in (before, after):
        free[free] = is_free(graph.solids, flat[free], np.repeat(corner, each, axis=0)[free], graph.radius_m)
    lengths = np.where(free.reshape(lengths.shape), lengths, np.inf)
    lengths[:, -1] = np.minimum(lengths[:, -1], 1e9)
    return places[np.arange(len(places)), np.argmin(lengths, axis=1)]
