"""The tangent graph of a world: the straight lines, from corner to corner, that a shortest path can take.

A shortest way of a disc among solids is made of straight lines that touch the rounded corners of the solids, grown by
the disc's radius, and of arcs around these corners (T. Lozano-Perez and M. Wesley, 1979; the reduced visibility graph
of J.-C. Latombe, Robot Motion Planning, 1991, chapter 4). Each arc is replaced by the corners of a polygon.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float64, Int
from scipy.sparse import coo_array, csr_array

from tasks.simulate.surroundings.ways.open_floor import OpenFloor, has_room, is_open, open_floor
from tasks.simulate.surroundings.ways.visibility import Points, Solids

# A turn by this much is one corner of the polygon.
_TURN_RAD = np.pi / 8
# Around a box's corner the polygon is drawn this much smaller than around the arc, so that it is as long as the arc.
_SHRINK = (_TURN_RAD / 2) / np.tan(_TURN_RAD / 2)
_CORNER = 1.0 / np.cos(_TURN_RAD / 2)
_TOLERANCE_M = 1e-4
_TOUCHING = np.sin(_TURN_RAD / 2) + 1e-6


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
