"""A mesh as slabs: between two heights the outline of all that it fills there, from level cuts.

Whatever a mesh is built like, a robot meets what stands between two heights. Each connected component is cut between
the heights of its corners. What is inside of a cut is solid, counted as a fill rule of drawings counts (and by the
turns around a point, where all faces point outwards); what lies open becomes a thin sheet. Faces that lean widen the
outline of their slab by what they cross in it, so that an outline never lacks what the mesh has.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from shapely import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

Points = Float[np.ndarray, "points 3"]
Faces = Int[np.ndarray, "faces 3"]
Segments = Float[np.ndarray, "segments 2 2"]

_SAME_M = 1e-5
_LEVEL_M = 5e-4
_SHEET_M = 0.01
"""How thick a surface without anything behind it becomes."""
_TWICE = 1e-3
_MOST_LEVELS = 48
_MOST_SLABS = 64
_TUBE_M2 = 0.05
_ROOM_M, _ROOM_HEIGHT_M = 2.0, 1.5
_NOTHING = Polygon()


class Slab(NamedTuple):
    """What a component fills between two heights.

    Attributes:
        low_m: Where it begins.
        high_m: Where it ends.
        outline: All that the component has between them.
        section: The cut in the middle, which the outline holds: what surfaces are measured against.
    """

    low_m: float
    high_m: float
    outline: BaseGeometry
    section: BaseGeometry


class Component(NamedTuple):
    """A connected part of a mesh.

    Attributes:
        points: Corners.
        faces: Triangles, as indices of corners.
        is_closed: Whether every edge has a face on both sides, and all faces look to the same side.
        is_room: Whether its faces look inwards, and it is as large as a room: somebody made it to be seen from inside.
    """

    points: Points
    faces: Faces
    is_closed: bool
    is_room: bool


def components(points: Points, faces: Faces) -> list[Component]:
    """Returns the connected parts of a mesh; corners at the same place are one."""
    _, first, same = np.unique(
        np.round(points / _SAME_M).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    points, faces = points[first], same.reshape(-1)[faces]
    distinct = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    faces = faces[distinct]
    if not len(faces):
        return []
    ends = np.concatenate([faces[:, :2], faces[:, 1:]])
    graph = coo_array((np.ones(len(ends), dtype=bool), (ends[:, 0], ends[:, 1])), shape=(len(points), len(points)))
    _, label = connected_components(graph, directed=False)
    of_face = label[faces[:, 0]]
    order = np.argsort(of_face, kind="stable")
    parts = np.split(faces[order], np.flatnonzero(np.diff(of_face[order])) + 1)
    return [_component(points, part) for part in parts]


def _component(points: Points, faces: Faces) -> Component:
    used, local = np.unique(faces, return_inverse=True)
    points, faces = points[used], local.reshape(-1, 3)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    key, back = edges[:, 0] * len(points) + edges[:, 1], edges[:, 1] * len(points) + edges[:, 0]
    is_closed = len(np.unique(key)) == len(key) and bool(np.isin(key, back).all())
    a, b, c = points[faces].transpose(1, 0, 2)
    inwards = bool((a * np.cross(b, c)).sum() < 0.0)
    width_x, width_y, height = np.ptp(points, axis=0)
    large = min(width_x, width_y) > _ROOM_M and height > _ROOM_HEIGHT_M
    return Component(points, faces, is_closed, is_closed and inwards and bool(large))


def slabs(part: Component, tolerance_m: float, floor_m: float, head_m: float) -> list[Slab]:
    """Returns a component's slabs above the floor, from the lowest up; what is above head height is one.

    Args:
        part: The component.
        tolerance_m: How far an outline may reach beyond the surfaces.
        floor_m: What lies below this is left out.
        head_m: What begins above this is one slab, whatever its form.
    """
    heights = part.points[:, 2]
    low, high = float(heights.min()), float(heights.max())
    if high <= floor_m:
        return []
    if high - low < _LEVEL_M:
        flat = _projected(part.points[part.faces])
        return [Slab(max(low - _SHEET_M / 2, floor_m), high + _SHEET_M / 2, flat, flat)]
    found: list[Slab] = []
    below = _levels(part, max(low, floor_m), min(high, head_m))
    for bottom, top in _divided(part, below, tolerance_m):
        found += _slab(part, bottom, top)
    if high > head_m:
        bottom = max(low, head_m)
        crossed = _projected(_clipped(part, bottom, high))
        outline = merged([crossed, _filled(part, (bottom + high) / 2)])
        found += [] if outline.is_empty else [Slab(bottom, high, outline, outline)]
    return _with_plates(part, found, floor_m, head_m)


def _levels(part: Component, low: float, high: float) -> Float[np.ndarray, "levels"]:
    """Returns the heights that a component is cut at: its corners', or evenly spaced ones where these are too many."""
    if low >= high:
        return np.array([])
    inside = np.unique(part.points[:, 2])
    inside = inside[(inside > low + _LEVEL_M) & (inside < high - _LEVEL_M)]
    apart = np.concatenate([[True], np.diff(inside) > _LEVEL_M])[: len(inside)]
    inside = inside[apart]
    if len(inside) > _MOST_LEVELS:
        flat = _flat_heights(part)
        even = np.linspace(low, high, _MOST_LEVELS // 2)
        inside = np.unique(np.concatenate([flat[(flat > low) & (flat < high)][: _MOST_LEVELS // 2], even[1:-1]]))
    return np.concatenate([[low], inside, [high]])


def _flat_heights(part: Component) -> Float[np.ndarray, "levels"]:
    """Returns the heights of a component's level faces, the widest first."""
    corners = part.points[part.faces]
    level = np.ptp(corners[:, :, 2], axis=1) < _LEVEL_M
    area = np.abs(_doubled_areas(corners[level][:, :, :2]))
    height, of = np.unique(np.round(corners[level][:, 0, 2] / _LEVEL_M), return_inverse=True)
    total = np.bincount(of.reshape(-1), weights=area, minlength=len(height))
    return height[np.argsort(-total, kind="stable")] * _LEVEL_M


def _divided(part: Component, levels: Float[np.ndarray, "levels"], tolerance_m: float) -> list[tuple[float, float]]:
    """Returns the slabs between levels; one that faces lean across further than the tolerance is cut up."""
    corners = part.points[part.faces]
    low, high = corners[:, :, 2].min(axis=1), corners[:, :, 2].max(axis=1)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    run = np.abs(normal[:, 2]) / np.maximum(np.hypot(normal[:, 0], normal[:, 1]), 1e-12)
    found: list[tuple[float, float]] = []
    most = max(1, _MOST_SLABS // max(len(levels) - 1, 1))
    for bottom, top in pairwise(levels.tolist()):
        across = (low < top - _LEVEL_M / 2) & (high > bottom + _LEVEL_M / 2) & (high - low >= _LEVEL_M)
        height = top - bottom
        leans = min(float((run[across] * height).max(initial=0.0)), height)
        count = min(max(1, int(np.ceil(leans / tolerance_m - 1e-6))), most)
        steps = np.linspace(bottom, top, count + 1)
        found += pairwise(steps.tolist())
    return found


def _slab(part: Component, low: float, high: float) -> list[Slab]:
    section = _filled(part, (low + high) / 2)
    leaning = _projected(_clipped(part, low, high))
    outline = section if leaning.is_empty else merged([section, leaning])
    return [] if outline.is_empty else [Slab(low, high, outline, section if not section.is_empty else outline)]


def _with_plates(part: Component, found: list[Slab], floor_m: float, head_m: float) -> list[Slab]:
    """Returns the slabs with thin ones added, where a component that is open has level faces with nothing behind."""
    if part.is_closed and not part.is_room:
        return found
    corners = part.points[part.faces]
    level = (np.ptp(corners[:, :, 2], axis=1) < _LEVEL_M) & (corners[:, 0, 2] > floor_m) & (corners[:, 0, 2] < head_m)
    heights = np.round(corners[level][:, 0, 2] / _LEVEL_M)
    plates: list[Slab] = []
    for height in np.unique(heights):
        at = float(height * _LEVEL_M)
        beside = [each.outline for each in found if each.low_m < at + _LEVEL_M and each.high_m > at - _LEVEL_M]
        bare = _projected(corners[level][heights == height])
        bare = without(bare, merged(beside).buffer(_SHEET_M)) if beside else bare
        if not bare.is_empty:
            plates.append(Slab(max(at - _SHEET_M / 2, floor_m), at + _SHEET_M / 2, bare, bare))
    return found + plates


def _doubled_areas(corners: Float[np.ndarray, "faces 3 2"]) -> Float[np.ndarray, "faces"]:
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _projected(corners: Float[np.ndarray, "faces corners 3"]) -> BaseGeometry:
    """Returns the floor below convex faces that do not stand upright."""
    if not len(corners):
        return _NOTHING
    rings = np.atleast_1d(np.asarray(shapely.convex_hull(shapely.multipoints(corners[:, :, :2]))))
    wide = rings[shapely.area(rings) > 1e-8]
    return merged(wide) if len(wide) else _NOTHING


def _clipped(part: Component, low: float, high: float) -> Float[np.ndarray, "faces 9 3"]:
    """Returns the corners of the parts of leaning faces between two heights (some of them more than once)."""
    corners = part.points[part.faces]
    bottom, top = corners[:, :, 2].min(axis=1), corners[:, :, 2].max(axis=1)
    low, high = low + _LEVEL_M / 8, high - _LEVEL_M / 8
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    leaning = np.abs(normal[:, 2]) > 1e-4 * np.hypot(normal[:, 0], normal[:, 1])
    corners = corners[leaning & (bottom < high) & (top > low)]
    if not len(corners):
        return np.zeros((0, 9, 3))
    found = [corners]
    valid = [(corners[:, :, 2] >= low) & (corners[:, :, 2] <= high)]
    along = np.roll(corners, -1, axis=1) - corners
    rise = np.where(along[:, :, 2] == 0.0, 1.0, along[:, :, 2])
    for height in (low, high):
        share = (height - corners[:, :, 2]) / rise
        found.append(corners + share[:, :, None] * along)
        valid.append((along[:, :, 2] != 0.0) & (share >= 0.0) & (share <= 1.0))
    points, kept = np.concatenate(found, axis=1), np.concatenate(valid, axis=1)
    some = points[np.arange(len(points)), np.argmax(kept, axis=1)]
    return np.where(kept[:, :, None], points, some[:, None])


def _filled(part: Component, height: float) -> BaseGeometry:
    """Returns what a component fills at a height: what its cut encloses, and what lies open in it as thin sheets."""
    segments = _cut(part, height)
    if not len(segments):
        return _NOTHING
    strings = shapely.linestrings(segments)
    lines = shapely.union_all(strings)
    faces, bridges, dangles, _ = shapely.polygonize_full([lines])
    rings = list(faces.geoms)
    open_lines = [each for each in (*bridges.geoms, *dangles.geoms) if not each.is_empty]
    # A surface with a front and a back lies there twice, and an even number of lines is around what it holds.
    is_twice = not part.is_closed and 2.0 * lines.length <= (1.0 + _TWICE) * float(shapely.length(strings).sum())
    if open_lines or is_twice:
        segments = _ring_segments(rings)
    solid: list[BaseGeometry] = []
    if rings:
        inside = _inside(segments, shapely.point_on_surface(rings), signed=part.is_closed and not open_lines)
        solid = [ring for ring, is_in in zip(rings, inside, strict=True) if is_in and _is_solid(part, ring)]
        hollow = [ring for ring, is_in in zip(rings, inside, strict=True) if is_in and not _is_solid(part, ring)]
        open_lines += [shapely.boundary(ring) for ring in hollow]
    sheets = [shapely.buffer(each, _SHEET_M / 2, cap_style="square", join_style="mitre") for each in open_lines]
    return merged([*solid, *sheets])


def _cut(part: Component, height: float) -> Segments:
    """Returns the lines in which faces cross a height; where faces look outwards, the inside is on one side."""
    above = part.points[part.faces, 2] > height
    count = above.sum(axis=1)
    hit = (count == 1) | (count == 2)
    faces, above, count = part.faces[hit], above[hit], count[hit]
    lone = np.argmax(above == (count == 1)[:, None], axis=1)
    row = np.arange(len(faces))
    first, second, third = (faces[row, (lone + turn) % 3] for turn in range(3))
    ends = np.stack(
        [_crossing(part.points, first, second, height), _crossing(part.points, first, third, height)], axis=1
    )
    ends[count == 2] = ends[count == 2][:, ::-1]
    return ends[np.abs(ends[:, 0] - ends[:, 1]).max(axis=1) > 1e-9]


def _crossing(
    points: Points, one: Int[np.ndarray, "n"], other: Int[np.ndarray, "n"], height: float
) -> Float[np.ndarray, "n 2"]:
    """Returns where edges cross a height: of an edge that two faces share, the same number to the bit."""
    a, b = points[np.minimum(one, other)], points[np.maximum(one, other)]
    share = ((height - a[:, 2]) / (b[:, 2] - a[:, 2]))[:, None]
    return a[:, :2] + share * (b[:, :2] - a[:, :2])


def _ring_segments(rings: Sequence[BaseGeometry]) -> Segments:
    lines = shapely.union_all([shapely.boundary(ring) for ring in rings]) if rings else _NOTHING
    found = [np.stack([xy[:-1], xy[1:]], axis=1) for xy in map(shapely.get_coordinates, shapely.get_parts(lines))]
    return np.concatenate(found) if found else np.zeros((0, 2, 2))


def _inside(segments: Segments, points: "np.ndarray", *, signed: bool) -> Bool[np.ndarray, "points"]:
    """Returns which points are inside: an odd number of lines to one side, or, signed, more of one direction."""
    x, y = shapely.get_x(points)[:, None], shapely.get_y(points)[:, None]
    (ax, ay), (bx, by) = segments[:, 0].T, segments[:, 1].T
    crosses = (ay > y) != (by > y)
    rise = np.where(by == ay, 1.0, by - ay)
    right = crosses & (ax + (y - ay) / rise * (bx - ax) > x)
    odd = right.sum(axis=1) % 2 == 1
    turns = np.where(by > ay, 1, -1)
    return odd | ((right * turns).sum(axis=1) != 0) if signed else odd


def _is_solid(part: Component, ring: BaseGeometry) -> bool:
    """Returns whether what lies in a ring is solid: not in a room, nor in walls without roof and floor."""
    if part.is_room:
        return False
    if part.is_closed or ring.area < _TUBE_M2:
        return True
    inside = shapely.get_coordinates(ring.representative_point())[0]
    corners = part.points[part.faces][:, :, :2]
    sides = np.roll(corners, -1, axis=1) - corners
    to = inside - corners
    turn = sides[:, :, 0] * to[:, :, 1] - sides[:, :, 1] * to[:, :, 0]
    wide = np.abs(_doubled_areas(corners)) > 1e-9
    return bool((wide & ((turn >= 0.0).all(axis=1) | (turn <= 0.0).all(axis=1))).any())


def merged(geometries: "Sequence[BaseGeometry] | np.ndarray") -> BaseGeometry:
    """Returns the area that geometries cover together."""
    try:
        return areas(shapely.union_all(geometries))
    except shapely.GEOSException:  # of slivers: on a grid of micrometres they have no width
        return areas(shapely.union_all([shapely.buffer(each, 0.0) for each in geometries], grid_size=1e-6))


def without(one: BaseGeometry, other: BaseGeometry) -> BaseGeometry:
    """Returns what an area has that another one has not."""
    try:
        return areas(shapely.difference(one, other))
    except shapely.GEOSException:
        return areas(shapely.difference(shapely.buffer(one, 0.0), shapely.buffer(other, 0.0), grid_size=1e-6))


def areas(geometry: BaseGeometry) -> BaseGeometry:
    """Returns a geometry without its points and lines."""
    parts = [each for each in shapely.get_parts(geometry) if isinstance(each, Polygon) and each.area > 1e-9]
    whole = MultiPolygon(parts) if len(parts) != 1 else parts[0]
    return shapely.simplify(whole, _SAME_M)
