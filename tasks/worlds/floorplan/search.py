"""The search for layouts: all slicing plans judged roughly, the best refined and judged exactly, one of them drawn.

What is good depends on the template alone, so it is found once for all floor plans of a job; which good layout a floor
plan gets, mirrored how and stretched how far, is drawn from its stream.

Proposals are the most promising of all slicing plans, judged roughly. Stretching a plan along x and shrinking it along
y by the same factor keeps its areas and scales all aspects alike, so the best outline of a plan follows from one layout
of it in closed form.

Refinement moves the walls of many layouts at once until areas, shapes and connections are the best compromise. It is
damped Gauss-Newton on what ``tasks.worlds.floorplan.scoring`` counts smoothly, written out in elementary operations
rather than with a linear algebra library, whose last bits differ from machine to machine.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float, Int

from specs.errors import SimyardError
from specs.robomaker.failure_codes import WorldGenerationJobErrorCode
from tasks.worlds.floorplan.scoring import (
    AREA,
    AREA_LIMIT,
    AREA_OVER,
    AREA_TOLERANCE,
    ASPECT_TOLERANCE,
    CONNECTION,
    FOOTPRINT_LIMIT,
    HARD,
    SLIVER_M,
    START_SIDE_M,
    WALL_M,
    Demands,
    Layouts,
    common_walls,
    demands_of,
    doorway_width,
    join_layouts,
    score,
    skew,
)
from tasks.worlds.floorplan.slicing import Shape, labelings, lay_out, shapes
from tasks.worlds.resolved_template import ResolvedTemplate

_ROUNDS = 6
_DAMPING = 1e-3
# Aspects this near to the tolerance count this much more in the second half: over 23 templates 57 % of wishes for 1:1
# and 86 % of the others are met with it, 54 and 76 % without.
_NEAR_WALL, _EFFORT = (0.5, 1.5), 4.0
# A room keeps this share of its width in one round.
_KEPT = 0.5
# Limits are kept with this to spare, for rounding to the centimetre; to miss one by so much costs 1.
_SPARE_M, _LIMIT_M, _HARD_M = 0.015, 0.01, 0.001
Residuals = Float[np.ndarray, "rows layouts"]
Slopes = Float[np.ndarray, "rows lines layouts"]
_SHORTLIST = 3000
# What a wished pair costs that does not touch, and a metre of wall that it lacks, in units of squared skew.
_APART, _SHORT = 1e4, 25.0
_PROPOSALS = 256
# Layouts are good that cost little more than the best, by so much or by this share; and so many for variety's sake, if
# they cost no more than _FAR for each room above it.
_NEAR, _NEAR_SHARE, _MANY, _FAR = 4.0, 0.4, 6, 1.6
# A drawn layout is stretched by up to this share along x and shrunk along y: the first of so many tries, the last of
# which leaves it as it is, that does not cost more by this.
_STRETCH, _STRETCH_SLACK, _STRETCHES = 0.08, 0.5, 12


class WorldRejected(SimyardError):  # noqa: N818 - a state, like StageFailed
    """A world cannot be generated; a job records it and goes on with the next.

    Attributes:
        code: RoboMaker's WorldGenerationJobErrorCode.
        reason: What stands in the way, for a person.
    """

    def __init__(self, code: WorldGenerationJobErrorCode, reason: str) -> None:
        self.code: WorldGenerationJobErrorCode = code
        self.reason = reason
        super().__init__(f"{code}: {reason}")


@dataclass(frozen=True)
class _Frame:
    """What does not change from round to round.

    Attributes:
        spread: How each room's width and height depend on the lines.
        least_m: What each room must measure, for the robot and in one of them for the start.
        facing: For each pair, the axis along which its common wall runs, -1 for none.
        weight: How much each aspect counts.
    """

    spread: Float[np.ndarray, "2 rooms lines layouts"]
    least_m: Float[np.ndarray, "rooms layouts"]
    facing: Int[np.ndarray, "pairs layouts"]
    weight: Float[np.ndarray, "rooms layouts"]


def refine(layouts: Layouts, demands: Demands) -> Layouts:
    """Returns the layouts with their lines where the score is best, in whole centimetres."""
    frame, found = _make_frame(layouts, demands), [np.round(layouts.lines, 2)]
    for _ in range(2):
        for _ in range(_ROUNDS):
            layouts = layouts.moved(_improve_lines(layouts, demands, frame))
        found.append(np.round(layouts.lines, 2))
        frame = replace(frame, weight=_sharpen_weights(layouts, demands))
    best = np.argmin([np.round(score(layouts.moved(lines), demands), 4) for lines in found], axis=0)
    return layouts.moved(np.take_along_axis(np.stack(found), best[None, None], axis=0)[0])


def _make_frame(layouts: Layouts, demands: Demands) -> _Frame:
    ids = np.arange(len(layouts.lines))[:, None]
    at = layouts.sides.transpose(1, 0, 2)[:, :, None] == ids
    cells = layouts.cells()
    rooms, start = np.arange(len(at[0]))[:, None], np.argmax((cells[2:] - cells[:2]).min(axis=0), axis=0)
    a, b = layouts.sides[demands.pairs[0]], layouts.sides[demands.pairs[1]]
    beside = (a[:, :2] == b[:, 2:]) | (b[:, :2] == a[:, 2:])
    return _Frame(
        spread=at[2:].astype(float) - at[:2],
        least_m=np.where(rooms == start, max(START_SIDE_M, demands.narrow_m), demands.narrow_m),
        facing=np.where(beside[:, 0], 1, np.where(beside[:, 1], 0, -1)),
        weight=np.broadcast_to(demands.weight[:, None], (len(rooms), len(start))),
    )


def _sharpen_weights(layouts: Layouts, demands: Demands) -> Float[np.ndarray, "rooms layouts"]:
    """Returns the weights of aspects, higher for those that a little effort can get or keep within the tolerance."""
    cells = layouts.cells()
    width, height = cells[2:] - cells[:2] - WALL_M
    missed = np.abs(skew(width / height / demands.aspect[:, None])) / ASPECT_TOLERANCE
    near = (missed > _NEAR_WALL[0]) & (missed < _NEAR_WALL[1])
    return demands.weight[:, None] * np.where(near, _EFFORT, 1.0)


def _improve_lines(layouts: Layouts, demands: Demands, frame: _Frame) -> Float[np.ndarray, "lines layouts"]:
    """Returns where the lines lie after one round."""
    terms = list(_terms(layouts, demands, frame))
    rows = np.concatenate([term[0] for term in terms])
    slopes = np.concatenate([term[1] for term in terms])
    free = slopes[:, 2:]  # the outline's lower left corner stays
    normal = np.stack([(free * free[:, n, None]).sum(axis=0) for n in range(free.shape[1])])
    step = np.zeros_like(layouts.lines)
    step[2:] = _solve(normal, -(free * rows[:, None]).sum(axis=0))
    extent = (frame.spread * layouts.lines).sum(axis=2)
    shrinking = np.maximum(-(frame.spread * step).sum(axis=2) / extent, 1e-9)
    return layouts.lines + np.minimum(_KEPT / shrinking.max(axis=(0, 1)), 1.0) * step


def _terms(layouts: Layouts, demands: Demands, frame: _Frame) -> Iterator[tuple[Residuals, Slopes]]:
    """Yields what is missed, as the score counts it, with its slopes: areas, aspects, outline, widths, connections."""
    spread = frame.spread
    extent = np.maximum((spread * layouts.lines).sum(axis=2) - WALL_M, 1e-2)
    relative = spread / extent[:, :, None]
    area = extent[0] * extent[1] / demands.areas_m2[:, None]
    scale = AREA**0.5 / AREA_TOLERANCE
    yield scale * (area - 1.0), scale * area[:, None] * (relative[0] + relative[1])
    ratio = extent[0] / extent[1] / demands.aspect[:, None]
    yield _skew_terms(ratio, relative[0] - relative[1], frame.weight)
    yield from _outline_terms(layouts, demands)
    for sign in (1.0, -1.0):
        yield _limit_terms(
            sign * (area - 1.0) - AREA_LIMIT, sign * area[:, None] * (relative[0] + relative[1]), AREA_OVER
        )
    for axis in (0, 1):
        yield _limit_terms(demands.slim_m[:, None] + _SPARE_M - extent[axis], -spread[axis], SLIVER_M)
        yield _limit_terms(frame.least_m + _SPARE_M - extent[axis], -spread[axis], _HARD_M)
    yield _connection_terms(layouts, demands, frame)


def _skew_terms(ratio: Residuals, relative: Slopes, weight: Residuals) -> tuple[Residuals, Slopes]:
    """Returns by how much aspects miss the wished ones."""
    scale = np.sqrt(weight) / ASPECT_TOLERANCE
    return scale * skew(ratio), (scale * (ratio + 1.0 / ratio) / 2.0)[:, None] * relative


def _outline_terms(layouts: Layouts, demands: Demands) -> Iterator[tuple[Residuals, Slopes]]:
    """Yields by how much the footprint misses its aspect, and the limit of what counts as met."""
    lines = layouts.lines[None]
    width, height = lines[:, 2] + WALL_M, lines[:, 3] + WALL_M
    relative = np.zeros_like(lines)
    relative[:, 2], relative[:, 3] = 1.0 / width, -1.0 / height
    ratio, weight = width / height / demands.footprint_aspect, np.full((1, 1), demands.footprint_weight)
    yield _skew_terms(ratio, relative, weight)
    missed, slopes = _skew_terms(ratio, relative, np.ones((1, 1)))
    sign = np.where(missed < 0.0, -1.0, 1.0)
    yield _limit_terms(sign * missed - FOOTPRINT_LIMIT, sign[:, None] * slopes, demands.footprint_over)


def _limit_terms(short: Residuals, slopes: Slopes, scale: float) -> tuple[Residuals, Slopes]:
    """Returns by how much limits are missed; those that are kept count nothing."""
    return np.maximum(short, 0.0) / scale, np.where(short > 0.0, 1.0, 0.0)[:, None] * slopes / scale


def _connection_terms(layouts: Layouts, demands: Demands, frame: _Frame) -> tuple[Residuals, Slopes]:
    """Returns by how much the walls between connected rooms are too short."""
    a, b = demands.pairs
    along = np.maximum(frame.facing, 0)[:, None]
    sides = [np.take_along_axis(layouts.sides[room], along + side, axis=1)[:, 0] for side in (0, 2) for room in (a, b)]
    here = [np.take_along_axis(layouts.lines, side, axis=0) for side in sides]
    low = np.where(here[0] > here[1], sides[0], sides[1])
    high = np.where(here[2] < here[3], sides[2], sides[3])
    length = np.minimum(here[2], here[3]) - np.maximum(here[0], here[1])
    short = np.where(frame.facing >= 0, demands.shared_m[:, None] + _SPARE_M - length, 0.0)
    ids = np.arange(len(layouts.lines))[:, None]
    slopes = (low[:, None] == ids).astype(float) - (high[:, None] == ids)
    return _limit_terms(short, slopes, _LIMIT_M)


def _solve(
    normal: Float[np.ndarray, "size size layouts"], right: Float[np.ndarray, "size layouts"]
) -> Float[np.ndarray, "size layouts"]:
    """Returns the solutions of symmetric positive systems, by elimination of all at once."""
    size = len(right)
    left = normal.copy()
    for n in range(size):
        left[n, n] += _DAMPING * (1.0 + left[n, n])
    right = right.copy()
    for n in range(size - 1):
        factor = left[n + 1 :, n] / left[n, n]
        left[n + 1 :, n:] -= factor[:, None] * left[n, n:]
        right[n + 1 :] -= factor * right[n]
    for n in reversed(range(size)):
        right[n] -= (left[n, n + 1 :] * right[n + 1 :]).sum(axis=0)
        right[n] /= left[n, n]
    return right


def propose(demands: Demands, count: int) -> Layouts:
    """Returns the best plans by their aspects and connections, wall thickness taken as that of square rooms."""
    rooms = len(demands.areas_m2)
    every = [_rough_costs(shape, demands) for shape in shapes(rooms)]
    cost = np.concatenate([each[0] for each in every])
    shortlist = np.sort(np.argsort(cost, kind="stable")[:_SHORTLIST])
    ends = np.cumsum([len(each[0]) for each in every])
    kept: list[Layouts] = []
    for shape, (costs, stretch), end in zip(shapes(rooms), every, ends, strict=True):
        first = end - len(costs)
        chosen = shortlist[(shortlist >= first) & (shortlist < end)] - first
        if chosen.size:
            kept.append(_shape_layouts(shape, chosen, stretch[chosen], demands))
    layouts, costs = join_layouts(kept), cost[shortlist]
    short = np.maximum(demands.shared_m[:, None] - common_walls(layouts.cells(), *demands.pairs), 0.0)
    return layouts[np.argsort(costs + _SHORT * (short * short).sum(axis=0), kind="stable")[:count]]


def _rough_costs(
    shape: Shape, demands: Demands
) -> tuple[Float[np.ndarray, " labelings"], Float[np.ndarray, " labelings"]]:
    """Returns what each labeling costs when it is stretched best, and by what factor its aspects are stretched."""
    order = labelings(shape)
    lines = lay_out(shape, _cell_areas(demands)[order])
    low, high = lines[shape.sides[:, :2].T], lines[shape.sides[:, 2:].T]
    ratio = (high[0] - low[0]) / ((high[1] - low[1]) * demands.aspect[order])
    square, weight = ratio * ratio, demands.weight[order]
    footprint, own = demands.footprint_aspect * demands.footprint_aspect, demands.footprint_weight
    wide = (weight * square).sum(axis=0) + own / footprint
    deep = (weight / square).sum(axis=0) + own * footprint
    cost = np.sqrt(wide * deep)
    if demands.pairs.size:
        cost += _APART * _count_apart(shape, order, demands)
    return cost, np.sqrt(np.sqrt(deep / wide))


def _cell_areas(demands: Demands) -> Float[np.ndarray, " rooms"]:
    side = np.sqrt(demands.areas_m2) + WALL_M
    return side * side


def _count_apart(
    shape: Shape, order: Int[np.ndarray, "places labelings"], demands: Demands
) -> Int[np.ndarray, " labelings"]:
    """Returns how many wished pairs have no line between them."""
    place = np.argsort(order, axis=0)
    apart: Bool[np.ndarray, "places places"] = ~shape.faces()
    return apart[place[demands.pairs[0]], place[demands.pairs[1]]].sum(axis=0)


def _shape_layouts(
    shape: Shape, chosen: Int[np.ndarray, " some"], stretch: Float[np.ndarray, " some"], demands: Demands
) -> Layouts:
    order = labelings(shape)[:, chosen]
    vertical = np.broadcast_to(shape.vertical[:, None], (len(shape.vertical), len(chosen)))
    by_x = np.sqrt(stretch)
    lines = lay_out(shape, _cell_areas(demands)[order]) * np.where(vertical, by_x, 1.0 / by_x)
    return Layouts(shape.sides[np.argsort(order, axis=0)].transpose(0, 2, 1), vertical, lines)


@dataclass(frozen=True)
class GoodLayouts:
    """The layouts to draw from, best first.

    Attributes:
        scores: What each costs.
        chance: How likely each is drawn; they add up to 1.
    """

    layouts: Layouts
    scores: Float[np.ndarray, " layouts"]
    chance: Float[np.ndarray, " layouts"]
    demands: Demands


@lru_cache(maxsize=16)
def good_layouts(resolved: ResolvedTemplate) -> GoodLayouts:
    """Returns the layouts that fulfil a template about as well as any.

    Raises:
        WorldRejected: InvalidInput, when no layout has a place for the start, or joins all rooms for the robot.
    """
    demands = demands_of(resolved)
    layouts = refine(propose(demands, _PROPOSALS), demands)
    # Equal layouts must be equal on every machine, to the last bit or not.
    scores = np.round(score(layouts, demands), 4)
    if scores.min() >= HARD:
        raise WorldRejected("InvalidInput", _hindrance(resolved, demands))
    best = np.argsort(scores, kind="stable")
    beyond = scores[best] - scores[best[0]]
    far = _FAR * len(resolved.rooms)
    limit = max(_NEAR, _NEAR_SHARE * float(scores[best[0]] % CONNECTION), min(float(beyond[:_MANY][-1]), far))
    best, beyond = best[beyond <= limit], beyond[beyond <= limit]
    weight = 1.0 / (1.0 + 2.0 * beyond / far)
    return GoodLayouts(layouts[best], scores[best], weight / weight.sum(), demands)


def draw_layout(rng: np.random.Generator, resolved: ResolvedTemplate) -> Layouts:
    """Returns one good layout (an axis of length 1), in whole centimetres.

    Raises:
        WorldRejected: As ``good_layouts`` says.
    """
    good = good_layouts(resolved)
    place, across, along = rng.random(3).tolist()
    chosen = min(int(np.searchsorted(np.cumsum(good.chance), place)), len(good.scores) - 1)
    layout = good.layouts[np.array([chosen])]
    for axis in [axis for axis, flipped in enumerate((across < 0.5, along < 0.5)) if flipped]:
        layout = _mirror(layout, axis)
    return _stretch(rng, layout, good.demands, float(good.scores[chosen]))


def _mirror(layout: Layouts, axis: int) -> Layouts:
    """Returns the mirror image with low and high changed along an axis."""
    low, high = axis, axis + 2
    columns, names = np.arange(4), np.arange(len(layout.lines))
    columns[[low, high]] = names[[low, high]] = high, low
    turned = (layout.vertical if axis == 0 else ~layout.vertical) & (names > 3)[:, None]
    lines = np.where(turned, np.round(layout.lines[high] - layout.lines, 2), layout.lines)
    return Layouts(names[layout.sides[:, columns]], layout.vertical, lines)


def _stretch(rng: np.random.Generator, layout: Layouts, demands: Demands, cost: float) -> Layouts:
    """Returns the layout with other proportions that are about as good."""
    by = 1.0 + _STRETCH * (2.0 * rng.random(_STRETCHES) - 1.0)
    by[-1] = 1.0
    many = layout[np.zeros(_STRETCHES, dtype=int)]
    many = many.moved(np.round(many.lines * np.where(many.vertical, by, 1.0 / by), 2))
    return many[np.flatnonzero(score(many, demands) <= cost + _STRETCH_SLACK)[:1]]


def _hindrance(resolved: ResolvedTemplate, demands: Demands) -> str:
    """Returns why no layout is usable, for a person."""
    rooms = sorted(resolved.rooms, key=lambda room: room.area_m2)
    small, large = rooms[0], rooms[-1]
    if math.sqrt(large.area_m2) < START_SIDE_M:
        return (
            f"the clear metre around the start needs a room at least {START_SIDE_M} m wide, and the largest, "
            f"{large.name}, has {large.area_m2:g} m2; make a room larger"
        )
    if math.sqrt(small.area_m2) < demands.narrow_m:
        return (
            f"a robot of {resolved.robot_radius_m:g} m radius needs rooms at least {demands.narrow_m:.2f} m wide, and "
            f"{small.name} has {small.area_m2:g} m2; make it larger or the robot smaller"
        )
    return (
        f"no layout of the {len(rooms)} rooms joins them all by doorways of {doorway_width(resolved):.2f} m and has "
        f"one at least {START_SIDE_M} m wide, which the clear metre around the start needs; make a room larger"
    )
