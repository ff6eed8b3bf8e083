"""Upright solids of a mesh: as few boxes, cylinders and prisms as keep its surfaces within a tolerance."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from specs.data.world import MOST_CORNERS, OVERHEAD_M, is_convex
from tasks.worlds.importer.mesh_sections import (
    Component,
    Faces,
    Points,
    Slab,
    areas,
    components,
    merged,
    slabs,
    without,
)

TOLERANCE_M = 0.01
COARSE_M = 0.05
_MANY = 16
_WIDER = ((2.0, _MANY), (4.0, _MANY), (6.0, 4 * _MANY))
"""What more solids than this stand for may be off by multiples of the tolerance,"""
_LESS = 0.7
"""where that leaves this share of them."""
_MOST_CORNERS, _COARSEST_M = 3_000, 0.06
"""What has more corners is not tried as finely: a curtain with folds."""
_CARVED = 60
_STRAIGHT_M2 = 1e-9
_BORDER_M = 0.2
_BARE_M = 0.008
_MOST_LAYERS = 12
"""Of so many a common core is looked for: more are a round thing's, which has none."""
_SAME_M = 1e-5
_LEAST_M = 1e-3
"""Slivers narrower than this are no part of a piece."""

Corner = tuple[float, float]
Ring = tuple[Corner, ...]


class Upright(NamedTuple):
    """An upright solid: what a `Solid` is without its name and colour.

    Attributes:
        shape: A box, a cylinder or a prism.
        center_m: Centre.
        half_m: Half extents along its own axes.
        yaw_rad: Turn about z; 0 for cylinders and prisms.
        outline_m: A prism's corners from its centre, counter-clockwise; else none.
    """

    shape: Literal["box", "cylinder", "prism"]
    center_m: tuple[float, float, float]
    half_m: tuple[float, float, float]
    yaw_rad: float = 0.0
    outline_m: Ring | None = None


class Fit(NamedTuple):
    """A mesh as upright solids.

    Attributes:
        solids: What stands for it.
        off_m: How far surfaces below head height moved at most.
    """

    solids: tuple[Upright, ...]
    off_m: float


class _Footprint(NamedTuple):
    """A convex outline of a solid.

    Attributes:
        ring: Its corners, counter-clockwise; of a cylinder, of the circle's box.
        radius_m: A cylinder's radius; 0 for others.
    """

    ring: Ring
    radius_m: float = 0.0


class _Layer(NamedTuple):
    """Slabs above each other that have one outline.

    Attributes:
        low_m: Where the lowest begins.
        high_m: Where the highest ends.
        outline: What has to be filled.
        whole: What may be filled: the outline, and what is filled by others already.
        slabs: The slabs.
    """

    low_m: float
    high_m: float
    outline: BaseGeometry
    whole: BaseGeometry
    slabs: tuple[Slab, ...]


@np.errstate(divide="ignore", invalid="ignore")  # GEOS leaves the processor's flags behind
def upright_solids(
    points: Points,
    faces: Faces,
    tolerance_m: float = TOLERANCE_M,
    floor_m: float = -math.inf,
    head_m: float = OVERHEAD_M,
) -> Fit:
    """Returns as few upright solids as cover a mesh within a tolerance.

    Args:
        points: Corners.
        faces: Triangles.
        tolerance_m: How far surfaces may move.
        floor_m: What lies below this is left out.
        head_m: What begins above this is kept coarsely.
    """
    parts: list[list[Slab]] = []
    made: list[tuple[list[_Placed], float]] = []
    for part in components(points, faces):
        own = _own_prism(part, floor_m)
        parts.append([] if own else slabs(part, tolerance_m / 2, floor_m, head_m))
        made.append(([own], 0.0) if own else _within(parts[-1], tolerance_m, head_m))
    for wider, many in _WIDER:
        enough = sum(len(each) for each, _ in made) <= many
        for k, part in enumerate(parts):
            carved = math.isinf(made[k][1])
            if carved or (len(made[k][0]) > 2 and not enough):
                fewer = _within(part, tolerance_m * wider, head_m)
                made[k] = fewer if carved or len(fewer[0]) <= _LESS * len(made[k][0]) else made[k]
    solids = tuple(_solid(*each) for found, _ in made for each in found)
    return Fit(solids, max((off_m for _, off_m in made), default=0.0))


def _own_prism(part: Component, floor_m: float) -> "_Placed | None":
    """Returns a component that is an upright convex prism of few corners as it is; None for another.

    It is where its corners lie at two heights, and it fills all of the outline around them.
    """
    z, corners = part.points[:, 2], part.points[part.faces]
    low, high = float(z.min()), float(z.max())
    if not part.is_closed or high - max(low, floor_m) <= _LEAST_M or np.minimum(z - low, high - z).max() > _SAME_M:
        return None
    ring = _ring(shapely.get_coordinates(shapely.convex_hull(shapely.multipoints(part.points[:, :2])))[:-1])
    if not (3 <= len(ring) <= MOST_CORNERS and is_convex(ring)) or _width(ring) <= _LEAST_M:
        return None
    volume_m3, whole = float((corners[:, 0] * np.cross(corners[:, 1], corners[:, 2])).sum()) / 6, Polygon(ring)
    fills = abs(whole.area - volume_m3 / (high - low)) <= _SAME_M * whole.length
    return (_Footprint(ring), max(low, floor_m), high) if fills else None


def _within(found: Sequence[Slab], tolerance_m: float, head_m: float) -> "tuple[list[_Placed], float]":
    """Returns the footprints and heights of a component, and how far surfaces below head height moved at most.

    That is infinitely far, and there are none, where the component has too many corners for so fine a tolerance.
    """
    layers = _layers(found, tolerance_m, head_m)
    corners = sum(shapely.get_num_coordinates(each.outline) for each in layers)
    if corners > _MOST_CORNERS and tolerance_m < _COARSEST_M:
        return [], math.inf
    near = [each for each in layers if each.low_m < head_m - 1e-9]
    made = _stack(near, tolerance_m / 2)
    off_m = _off(near, made)
    for each in layers:
        if each.low_m >= head_m - 1e-9:
            coarse = _coarse(each.outline)
            made += _stack([_Layer(each.low_m, each.high_m, coarse, coarse, ())], COARSE_M)
    return made, off_m


def _coarse(outline: BaseGeometry) -> BaseGeometry:
    wide = outline.buffer(COARSE_M, join_style="mitre").buffer(-COARSE_M, join_style="mitre")
    whole = areas(wide.simplify(COARSE_M))
    return outline if whole.is_empty else whole


def _layers(found: Sequence[Slab], tolerance_m: float, head_m: float) -> list[_Layer]:
    """Returns slabs above each other whose cuts agree with one outline within the tolerance as one layer each.

    So does what is no higher than the tolerance; what begins above head height only joins what is the same.
    """
    layers: list[_Layer] = []
    reach: list[BaseGeometry] = []
    for slab in sorted(found, key=lambda each: each[:2]):
        last = layers[-1] if layers else None
        margin_m = 1e-6 if slab.low_m >= head_m - 1e-9 else tolerance_m
        around = slab.section.buffer(margin_m, quad_segs=2)
        if last and abs(last.high_m - slab.low_m) < 1e-9:
            both = _union(last.outline, slab.outline)
            if slab.high_m - last.low_m <= tolerance_m or all(each.covers(both) for each in (around, *reach)):
                layers[-1] = _Layer(last.low_m, slab.high_m, both, both, (*last.slabs, slab))
                reach.append(around)
                continue
        layers.append(_Layer(slab.low_m, slab.high_m, slab.outline, slab.outline, (slab,)))
        reach = [around]
    return layers


def _union(one: BaseGeometry, other: BaseGeometry) -> BaseGeometry:
    return one if one.equals_exact(other, 1e-6) else merged([one, other])


_Placed = tuple[_Footprint, float, float]


def _off(layers: Sequence[_Layer], made: Sequence[_Placed]) -> float:
    """Returns how far the surfaces of solids are from those of the cuts at most, to the side or up and down."""
    off_m = 0.0
    for layer in layers:
        for slab in layer.slabs:
            middle = (slab.low_m + slab.high_m) / 2
            here = [_area(footprint) for footprint, low, high in made if low <= middle <= high]
            if here and not slab.section.is_empty:
                union = merged(here)
                aside_m = max(_beyond(union, slab.section), _beyond(slab.section, union))
                off_m = max(off_m, min(aside_m, layer.high_m - layer.low_m))
    return off_m


def _beyond(one: BaseGeometry, other: BaseGeometry) -> float:
    """Returns how far an area reaches beyond another one."""
    border = shapely.get_coordinates(shapely.segmentize(one, _BORDER_M))
    return float(shapely.distance(shapely.points(border), other).max(initial=0.0))


def _area(footprint: _Footprint) -> BaseGeometry:
    if footprint.radius_m:
        (x0, y0), _, (x1, y1), _ = footprint.ring
        return shapely.Point((x0 + x1) / 2, (y0 + y1) / 2).buffer(footprint.radius_m, quad_segs=32)
    return Polygon(footprint.ring)


def _stack(layers: Sequence[_Layer], tolerance_m: float) -> list[_Placed]:
    """Returns footprints and heights that fill layers: of each alone, or of a common core and the rest, if fewer."""
    alone = [(each, layer.low_m, layer.high_m) for layer in layers for each in _fewest(layer, tolerance_m)]
    touching = all(abs(a.high_m - b.low_m) < 1e-9 for a, b in pairwise(layers))
    if not 2 <= len(layers) <= _MOST_LAYERS or len(alone) <= 2 or not touching:
        return alone
    core = layers[0].outline
    for layer in layers[1:]:
        core = without(core, without(core, layer.outline))
    core = _opened(core)
    if core.is_empty:
        return alone
    made = [(each, layers[0].low_m, layers[-1].high_m) for each in _footprints(core, tolerance_m)]
    run: list[_Layer] = []
    for layer in (*layers, None):
        rest = _opened(without(layer.outline, core)) if layer else Polygon()
        if layer and not rest.is_empty:
            run.append(_Layer(layer.low_m, layer.high_m, rest, layer.whole, ()))
        elif run:
            made += _stack(run, tolerance_m)
            run = []
        if len(made) >= len(alone):
            return alone
    return made


def _opened(outline: BaseGeometry) -> BaseGeometry:
    """Returns an outline without slivers."""
    narrow = outline.buffer(-_LEAST_M, join_style="mitre")
    return areas(narrow.buffer(_LEAST_M, join_style="mitre")) if not narrow.is_empty else Polygon()


def _fewest(layer: _Layer, tolerance_m: float) -> list[_Footprint]:
    found = _footprints(layer.outline, tolerance_m)
    if layer.whole is layer.outline or len(found) == 1:
        return found
    return min(found, _footprints(layer.whole, tolerance_m), key=len)


def _footprints(outline: BaseGeometry, tolerance_m: float) -> list[_Footprint]:
    """Returns the convex pieces of an outline."""
    found = [each for part in shapely.get_parts(outline) for each in _pieces(part, tolerance_m)]
    return [each for each in found if each.radius_m or _width(each.ring) > _LEAST_M] or _thin(outline)


def _thin(outline: BaseGeometry) -> list[_Footprint]:
    """Returns what stands for an outline of slivers alone: the rectangle around it, wide enough to be met."""
    if outline.is_empty:
        return []
    around = outline.buffer(_LEAST_M, join_style="mitre").minimum_rotated_rectangle
    return [_Footprint(_ring(shapely.get_coordinates(around)[:-1]))]


def _pieces(outline: Polygon, tolerance_m: float) -> list[_Footprint]:
    """Returns the convex pieces of one area: its own, or fewer that differ from it by no more than a tolerance."""
    corners = shapely.get_num_coordinates(outline)
    whole = convex_parts(outline) if corners <= MOST_CORNERS + 1 else []
    if len(whole) == 1:
        return [_Footprint(whole[0])]
    around = _circle(outline, tolerance_m) or _hull(outline, tolerance_m)
    if around:
        return [around]
    # What has many corners is round, or carved: its own pieces are no fewer than those of what it is simplified to.
    best = whole or (convex_parts(outline) if corners <= _CARVED else [])
    simple = [shapely.simplify(outline, tolerance_m)]
    if not best or len(best) > _MANY // 2:
        grown = outline.buffer(tolerance_m, join_style="mitre", mitre_limit=1.5)
        simple.append(shapely.simplify(grown, tolerance_m / 2))
    for each in simple:
        parts = [ring for part in shapely.get_parts(each) if not part.is_empty for ring in convex_parts(part)]
        if parts and (not best or len(parts) < len(best)) and _cover(parts, outline, tolerance_m):
            best = parts
    return [_Footprint(each) for each in best or convex_parts(outline)]


def _cover(rings: Sequence[Ring], outline: BaseGeometry, tolerance_m: float) -> bool:
    """Returns whether rings leave nothing of an outline bare but what is within a tolerance of them.

    However coarse solids may be, they are so on the safe side.
    """
    margin_m = min(tolerance_m, _BARE_M)
    return merged([Polygon(ring) for ring in rings]).buffer(margin_m).covers(outline)


def _circle(outline: Polygon, tolerance_m: float) -> _Footprint | None:
    if len(outline.interiors):
        return None
    corners = shapely.get_coordinates(outline)[:-1]
    x, y = (corners.min(axis=0) + corners.max(axis=0)) / 2
    radius = float(np.hypot(corners[:, 0] - x, corners[:, 1] - y).max())
    if not outline.buffer(tolerance_m, quad_segs=4).covers(shapely.Point(x, y).buffer(radius, quad_segs=32)):
        return None
    low, high = (x - radius, y - radius), (x + radius, y + radius)
    return _Footprint((low, (high[0], low[1]), high, (low[0], high[1])), radius)


def _hull(outline: Polygon, tolerance_m: float) -> _Footprint | None:
    hull, wide = shapely.convex_hull(outline), outline.buffer(tolerance_m, quad_segs=4)
    for whole in (hull, shapely.simplify(hull, tolerance_m), shapely.minimum_rotated_rectangle(hull)):
        ring = _ring(shapely.get_coordinates(whole)[:-1])
        if 3 <= len(ring) <= MOST_CORNERS and wide.covers(Polygon(ring)) and _cover([ring], outline, tolerance_m):
            return _Footprint(ring)
    return None


def convex_parts(outline: Polygon) -> list[Ring]:
    """Returns convex outlines of at most eight corners that fill an area.

    Triangles of its corners are joined over their longest common sides for as long as they stay convex (Hertel and
    Mehlhorn, 1983: at most four times as many as the fewest).
    """
    whole = _ring(shapely.get_coordinates(outline.exterior)[:-1])
    if not len(outline.interiors) and len(whole) <= MOST_CORNERS and len(whole) >= 3 and is_convex(whole):
        return [whole]
    triangles = [shapely.get_coordinates(each)[:3] for each in _triangles(outline)]
    rings: dict[int, list[Corner]] = {}
    side: dict[tuple[Corner, Corner], int] = {}
    for k, triangle in enumerate(triangles):
        ring = [(float(x), float(y)) for x, y in triangle]
        rings[k] = ring if _turn(*ring) > 0 else ring[::-1]
        side |= dict.fromkeys(_sides(rings[k]), k)
    inner = sorted((pair for pair in side if pair[::-1] in side and pair[0] < pair[1]), key=_longest_first)
    for a, b in inner:
        one, other = side[a, b], side[b, a]
        if one == other:
            continue
        joined = _joined(rings[one], rings[other], a, b)
        at, back = joined.index(a), joined.index(b)
        bent = any(_turn(joined[k - 1], joined[k], joined[(k + 1) % len(joined)]) < -_STRAIGHT_M2 for k in (at, back))
        tidy = _ring(joined) if not bent else ()
        if 3 <= len(tidy) <= MOST_CORNERS and is_convex(tidy):
            rings[one] = joined
            del rings[other]
            side |= dict.fromkeys(_sides(joined), one)
    found = [_ring(ring) for ring in rings.values()]
    return [ring for ring in found if len(ring) >= 3 and is_convex(ring)]


def _triangles(outline: Polygon) -> list[BaseGeometry]:
    """Returns triangles of an outline's corners; where GEOS finds none, of one that is wider by a hair."""
    for wider_m in (0.0, 1e-6, 1e-4):
        try:
            whole = outline.buffer(wider_m, join_style="mitre") if wider_m else outline
            return list(shapely.get_parts(shapely.constrained_delaunay_triangles(whole)))
        except shapely.GEOSException:
            continue
    return list(shapely.get_parts(shapely.constrained_delaunay_triangles(shapely.convex_hull(outline))))


def _turn(a: Corner, b: Corner, c: Corner) -> float:
    """Returns twice the area of a triangle; below 0 where it turns to the right."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _sides(ring: Sequence[Corner]) -> list[tuple[Corner, Corner]]:
    return list(pairwise([*ring, ring[0]]))


def _longest_first(pair: tuple[Corner, Corner]) -> tuple[float, tuple[Corner, Corner]]:
    return -math.dist(*pair), pair


def _joined(one: list[Corner], other: list[Corner], a: Corner, b: Corner) -> list[Corner]:
    """Returns two rings as one, across the side that the first has from a to b and the second from b to a."""
    at, back = one.index(b), other.index(a)
    return one[at:] + one[:at] + (other[back:] + other[:back])[1:-1]


def _width(ring: Ring) -> float:
    """Returns about how wide an outline is where it is narrow."""
    area = abs(sum(ax * by - ay * bx for (ax, ay), (bx, by) in _sides(ring))) / 2
    return area / math.hypot(*(max(axis) - min(axis) for axis in zip(*ring, strict=True)))


def _ring(corners: "Sequence[Corner] | np.ndarray") -> Ring:
    """Returns corners counter-clockwise, in micrometres, without those on a line between their neighbours."""
    ring = [(round(float(x), 6), round(float(y), 6)) for x, y in corners]
    if sum(ax * by - ay * bx for (ax, ay), (bx, by) in _sides(ring)) < 0:
        ring.reverse()
    k = 0
    while len(ring) > 3 and k < len(ring):
        before, after = ring[k - 1], ring[(k + 1) % len(ring)]
        if abs(_turn(before, ring[k], after)) <= 2e-5 * max(math.dist(before, after), 1e-6):
            del ring[k]
            k = max(k - 1, 0)
        else:
            k += 1
    return tuple(ring)


def _solid(footprint: _Footprint, low_m: float, high_m: float) -> Upright:
    """Returns the solid of a footprint between two heights."""
    ring = footprint.ring
    z, half_z = (low_m + high_m) / 2, (high_m - low_m) / 2
    if footprint.radius_m:
        (x0, y0), _, (x1, y1), _ = ring
        return Upright("cylinder", ((x0 + x1) / 2, (y0 + y1) / 2, z), (footprint.radius_m, footprint.radius_m, half_z))
    box = _box(ring)
    if box:
        (x, y), (half_x, half_y), yaw = box
        return Upright("box", (x, y, z), (half_x, half_y, half_z), yaw)
    xs, ys = zip(*ring, strict=True)
    x, y = (min(xs) + max(xs)) / 2, (min(ys) + max(ys)) / 2
    half = ((max(xs) - min(xs)) / 2, (max(ys) - min(ys)) / 2, half_z)
    return Upright("prism", (x, y, z), half, 0.0, tuple((px - x, py - y) for px, py in ring))


def _box(ring: Ring) -> tuple[Corner, Corner, float] | None:
    """Returns centre, half extents and turn of a rectangle; None for another outline."""
    if len(ring) != 4:
        return None
    a, b, c, d = ring
    skew = math.dist(((a[0] + c[0]) / 2, (a[1] + c[1]) / 2), ((b[0] + d[0]) / 2, (b[1] + d[1]) / 2))
    if skew > 2e-4 or abs(math.dist(a, c) - math.dist(b, d)) > 4e-4:
        return None
    along, beside = math.dist(a, b) / 2 + math.dist(c, d) / 2, math.dist(b, c) / 2 + math.dist(d, a) / 2
    yaw = math.atan2(b[1] - a[1] + c[1] - d[1], b[0] - a[0] + c[0] - d[0])
    turns = round(yaw / (math.pi / 2))
    half = (along / 2, beside / 2) if turns % 2 == 0 else (beside / 2, along / 2)
    center = (sum(x for x, _ in ring) / 4, sum(y for _, y in ring) / 4)
    return center, half, yaw - turns * math.pi / 2
