"""The shortest path of a disc on the floor, which a driven path is compared with.

The tangent graph of a world has the straight lines, from corner to corner, that a shortest path can take. Each goal of
a tour counts as reached from near: corners are cut there.
"""

import functools
import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

from tasks.simulate.application.contract import Placement
from tasks.simulate.geometry.free_floor import OpenFloor, Points, Solids, has_room, is_open, open_floor, solids_of
from tasks.simulate.geometry.obstacles import Obstacles

# A turn by this much is one corner of the polygon.
_TURN_RAD = np.pi / 8
# Around a box's corner the polygon is drawn this much smaller than around the arc, so that it is as long as the arc.
_SHRINK = (_TURN_RAD / 2) / np.tan(_TURN_RAD / 2)
_CORNER = 1.0 / np.cos(_TURN_RAD / 2)
_TOLERANCE_M = 1e-4
_TOUCHING = np.sin(_TURN_RAD / 2) + 1e-6


# A shortest way of a disc among solids is made of straight lines that touch the rounded corners of the solids, grown
# by the disc's radius, and of arcs around these corners (T. Lozano-Perez and M. Wesley, 1979; the reduced visibility
# graph of J.-C. Latombe, Robot Motion Planning, 1991, chapter 4). Each arc is replaced by the corners of a polygon.
class TangentGraph(NamedTuple):
    """Corners that ways bend at, and the straight ways between them.

    Attributes:
        floor: What the ways keep clear of, and by how much: the disc's radius, or a hair less, as arcs are shrunk to
            polygons.
        corners_m: Where ways bend.
        outward: Unit vectors away from the solid at each corner.
        starts, ends: Corners that a straight way joins, each pair once.
        lengths_m: How long it is.
    """

    floor: OpenFloor
    corners_m: Points
    outward: Points
    starts: Int[np.ndarray, "ways"]
    ends: Int[np.ndarray, "ways"]
    lengths_m: Float64[np.ndarray, "ways"]


def tangent_graph(solids: Solids, radius_m: float) -> TangentGraph:
    """Returns the ways of a disc around solids."""
    corners, outward = _corners(solids, radius_m)
    floor = open_floor(solids, radius_m * _SHRINK - _TOLERANCE_M)
    free = has_room(floor, corners)
    corners, outward = corners[free], outward[free]
    # Entry (i, j): how far corner j lies outwards of corner i.
    outwards_m = outward @ corners.T - np.sum(outward * corners, axis=1)[:, None]
    apart_m = np.hypot(*(corners[None, :, axis] - corners[:, None, axis] for axis in (0, 1)))
    touches = np.abs(outwards_m) <= _TOUCHING * apart_m
    starts, ends = np.nonzero(np.triu(touches & touches.T, 1))
    open_ways = is_open(floor, corners[starts], corners[ends])
    starts, ends = starts[open_ways], ends[open_ways]
    return TangentGraph(floor, corners, outward, starts, ends, apart_m[starts, ends])


def ways_from(graph: TangentGraph, points: Points) -> tuple[Int[np.ndarray, "ways"], Int[np.ndarray, "ways"]]:
    """Returns which points have a straight way to which corners, as pairs of indices."""
    # No matrix product: how it rounds may hang on how many points there are.
    outwards_m = points[:, :1] * graph.outward[:, 0] + points[:, 1:] * graph.outward[:, 1]
    outwards_m -= np.sum(graph.outward * graph.corners_m, axis=1)
    apart_m = np.hypot(*(points[:, None, axis] - graph.corners_m[None, :, axis] for axis in (0, 1)))
    point, corner = np.nonzero(np.abs(outwards_m) <= _TOUCHING * apart_m)
    open_ways = is_open(graph.floor, points[point], graph.corners_m[corner])
    return point[open_ways], corner[open_ways]


def distance_matrix(
    graph: TangentGraph, points: Points, pairs: tuple[Int[np.ndarray, "pairs"], Int[np.ndarray, "pairs"]]
) -> csr_array:
    """Returns lengths from node to node: all corners, then points as places to leave, then points as places to reach.

    No way leads through a point: it would hang on which other points were asked about.

    Args:
        graph: The ways around the solids.
        points: Places (x, y).
        pairs: Which points may be joined by a straight way: from the one to the other.
    """
    corners, count = len(graph.corners_m), len(points)
    point, corner = ways_from(graph, points)
    one, other = pairs
    straight = is_open(graph.floor, points[one], points[other])
    one, other = one[straight], other[straight]
    leave, reach = corners, corners + count
    starts = np.concatenate([graph.starts, graph.ends, leave + point, corner, leave + one])
    ends = np.concatenate([graph.ends, graph.starts, corner, reach + point, reach + other])
    to_corners = np.hypot(*(points[point] - graph.corners_m[corner]).T)
    to_points = np.hypot(*(points[one] - points[other]).T)
    lengths = np.concatenate([graph.lengths_m, graph.lengths_m, to_corners, to_corners, to_points])
    size = corners + 2 * count
    # A length of 0 would be no way at all to SciPy.
    return coo_array((np.maximum(lengths, 1e-12), (starts, ends)), shape=(size, size)).tocsr()


def _corners(solids: Solids, radius_m: float) -> tuple[Points, Points]:
    """Returns the corners of polygons around all solids grown by the radius, and which way is out there."""
    places, outward = _corners_of_boxes(solids.round_or_square, radius_m)
    around = [_corners_of_prism(corners, radius_m) for corners in solids.corners_m]
    return np.concatenate([places, *(each[0] for each in around)]), np.concatenate(
        [outward, *(each[1] for each in around)]
    )


def _corners_of_prism(corners: Float64[np.ndarray, "corners 2"], radius_m: float) -> tuple[Points, Points]:
    """Returns the same for a prism: each of its corners is turned around in equal steps, of a box's corner at most.

    What is drawn around it keeps one distance from all faces, with which the arcs' length is right in all.
    """
    along = np.roll(corners, -1, axis=0) - corners
    edges = np.hypot(*along.T) > 0.0
    normals_rad = np.arctan2(-along[edges, 0], along[edges, 1])
    # Before each corner is the edge that ends there; of repeated corners, the last one has an edge.
    turns_rad = (normals_rad - np.roll(normals_rad, 1)) % (2 * np.pi)
    steps = np.maximum(np.ceil(turns_rad / _TURN_RAD - 1e-9), 1).astype(int)
    half_rad = np.repeat(turns_rad / steps / 2, steps)
    first = np.repeat(np.cumsum(steps) - steps, steps)
    ways_rad = np.repeat(normals_rad - turns_rad, steps) + (2 * (np.arange(len(first)) - first) + 1) * half_rad
    outward = np.stack([np.cos(ways_rad), np.sin(ways_rad)], axis=1)
    height_m = 2 * np.pi * radius_m / (2 * np.tan(half_rad)).sum()
    return np.repeat(corners[edges], steps, axis=0) + (height_m / np.cos(half_rad))[:, None] * outward, outward


def _corners_of_boxes(solids: Solids, radius_m: float) -> tuple[Points, Points]:
    turns = _TURN_RAD * (np.arange(round(2 * np.pi / _TURN_RAD)) + 0.5)
    cos, sin = np.cos(turns), np.sin(turns)
    # In the solid's own axes: the box's corner of that quadrant, then away from it.
    local = np.stack([np.sign(cos), np.sign(sin)], axis=-1) * solids.half_m[:, None, :]
    grown = (solids.rim_m + radius_m * _SHRINK) * _CORNER
    x, y = (local[..., axis] + grown[:, None] * each for axis, each in enumerate((cos, sin)))
    axis_x, axis_y = solids.axis[:, :1], solids.axis[:, 1:]
    corners = np.stack([axis_x * x - axis_y * y, axis_y * x + axis_x * y], axis=-1) + solids.center_m[:, None, :]
    outward = np.stack([axis_x * cos - axis_y * sin, axis_y * cos + axis_x * sin], axis=-1)
    return corners.reshape(-1, 2), outward.reshape(-1, 2)


# Places on the rim of a goal's disc that a way may bend at.
_RIM = 24
_RIM_RAD = 2 * np.pi * np.arange(_RIM) / _RIM
RIM_UNITS = np.stack([np.cos(_RIM_RAD), np.sin(_RIM_RAD)], axis=-1)
# Of the places that a way may bend at, so many of the best are looked at together.
_BEST = (2, 8, _RIM + 2)
# NumPy adds up fewer numbers one after the other.
_FEW = 8
Metres = Float64[np.ndarray, "tasks"]


class Lines(NamedTuple):
    """Lines, one for each task.

    Attributes:
        corners_m: Where each begins, bends and ends; the end again where it has fewer corners than others.
        counts: How many corners it has, begin and end included; 0 where there is no line.
    """

    corners_m: Float64[np.ndarray, "tasks corners 2"]
    counts: Int[np.ndarray, "tasks"]


def tour_lengths(
    floor: OpenFloor,
    stops: Float64[np.ndarray, "tasks stops 2"],
    near_m: Float64[np.ndarray, "tasks stops"],
    legs: Sequence[Lines],
) -> Metres:
    """Returns how long the tours are.

    Args:
        floor: Where the disc has room.
        stops: Start and goals of each task.
        near_m: From how far each counts as reached.
        legs: The shortest lines from stop to stop.
    """
    total, line = np.zeros(len(stops)), legs[0]
    for stop, leg in enumerate(legs[1:], start=1):
        driven, end, _ = _until_near(line, stops[:, stop], near_m[:, stop])
        total += driven
        onward = _first_beyond(leg, stops[:, stop], near_m[:, stop])
        here = _bends(floor, end, onward.corners_m[:, 0], stops[:, stop], near_m[:, stop])
        total += np.hypot(*(here - end).T)
        line = Lines(np.concatenate([here[:, None], onward.corners_m], axis=1), onward.counts + 1)
    driven, _, rest = _until_near(line, stops[:, -1], near_m[:, -1])
    return total + (driven + rest)


def _until_near(line: Lines, goals: Points, near_m: Metres) -> tuple[Metres, Points, Metres]:
    """Returns a line's length to its last corner before it comes near a goal, that corner, and what is left to go."""
    tasks = np.arange(len(goals))
    begins = line.corners_m[:, :-1]
    way = np.diff(line.corners_m, axis=1)
    length = np.hypot(way[..., 0], way[..., 1])
    unit = way / np.maximum(length, 1e-12)[..., None]
    to_goal = goals[:, None] - begins
    along = np.sum(to_goal * unit, axis=2)
    across = to_goal[..., 0] * unit[..., 1] - to_goal[..., 1] * unit[..., 0]
    near = near_m[:, None]
    half_chord = np.sqrt(np.maximum(near**2 - across**2, 0.0))
    enters = (np.abs(across) <= near) & (along + half_chord >= 0.0) & (along - half_chord <= length)
    enters[tasks, line.counts - 2] = True
    first = np.argmax(enters, axis=1)
    rest = np.clip((along - half_chord)[tasks, first], 0.0, length[tasks, first])
    return _sum_of_first(length, first), begins[tasks, first], rest


def _sum_of_first(length: Float64[np.ndarray, "tasks corners"], count: Int[np.ndarray, "tasks"]) -> Metres:
    """Returns the sums of each row's first numbers, the bits that NumPy's sum of them has."""
    sums = np.concatenate([np.zeros((len(length), 1)), np.cumsum(length[:, : _FEW - 1], axis=1)], axis=1)
    found = sums[np.arange(len(length)), np.minimum(count, sums.shape[1] - 1)]
    for task in np.flatnonzero(count >= _FEW):
        found[task] = length[task, : count[task]].sum()
    return found


def _first_beyond(line: Lines, goals: Points, near_m: Metres) -> Lines:
    """Returns what follows of a line after its corners near a goal; at least its end."""
    away = line.corners_m - goals[:, None]
    far = np.hypot(away[..., 0], away[..., 1]) > near_m[:, None]
    far[np.arange(len(goals)), line.counts - 1] = True
    first = np.argmax(far, axis=1)
    kept = np.minimum(first[:, None] + np.arange(line.corners_m.shape[1]), line.counts[:, None] - 1)
    return Lines(np.take_along_axis(line.corners_m, kept[..., None], axis=1), line.counts - first)


def _bends(floor: OpenFloor, before: Points, after: Points, goals: Points, near_m: Metres) -> Points:
    """Returns where a way between two corners best touches its goal's disc; the goal itself where all else is shut."""
    way = after - before
    share = np.sum((goals - before) * way, axis=1) / np.maximum(np.sum(way**2, axis=1), 1e-12)
    passing = before + np.clip(share, 0.0, 1.0)[:, None] * way
    beside = passing - goals
    beside *= np.minimum(1.0, near_m / np.maximum(np.hypot(*beside.T), 1e-12))[:, None]
    rim = goals[:, None] + near_m[:, None, None] * RIM_UNITS
    places = np.concatenate([rim, (goals + beside)[:, None], goals[:, None]], axis=1)
    lengths = np.hypot(*np.moveaxis(places - before[:, None], -1, 0)) + np.hypot(
        *np.moveaxis(places - after[:, None], -1, 0)
    )
    order = np.argsort(lengths, axis=1, kind="stable")
    chosen = np.full(len(places), places.shape[1] - 1)
    left, first = np.arange(len(places)), 0
    for last in _BEST:
        open_ = _can_bend(floor, before[left], after[left], places[left[:, None], order[left, first:last]])
        found = open_.any(axis=1)
        chosen[left[found]] = order[left[found], first + np.argmax(open_[found], axis=1)]
        left, first = left[~found], last
    return places[np.arange(len(places)), chosen]


def _can_bend(
    floor: OpenFloor, before: Points, after: Points, places: Float64[np.ndarray, "tasks places 2"]
) -> Bool[np.ndarray, "tasks places"]:
    """Returns whether the disc has room at places, and straight ways from the one corner and to the other."""
    each, flat = places.shape[1], places.reshape(-1, 2)
    free = has_room(floor, flat)
    for corner in (before, after):
        free[free] = is_open(floor, flat[free], np.repeat(corner, each, axis=0)[free])
    return free.reshape(places.shape[:2])


_NOWHERE = -9999  # SciPy's word for a node without predecessor
_numbers = itertools.count()


# Ways go at any angle and are exact but for the polygons that stand for arcs. A goal is a disc, too: where the robot
# has arrived.
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
    legs = shortest_lines(graph, stops)
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


def shortest_lines(graph: TangentGraph, stops: Float64[np.ndarray, "tasks stops 2"]) -> list[Lines]:
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
