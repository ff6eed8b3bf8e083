"""The search for layouts: all slicing plans judged roughly, the best refined and judged exactly, one of them drawn.

What is good depends on the brief alone, so it is found once for all floor plans of a job; which good layout a floor
plan gets, mirrored how and stretched how far, is drawn from its stream.

Proposals: the most promising of all slicing plans for a brief, judged roughly.

Stretching a plan along x and shrinking it along y by the same factor keeps its areas and scales all aspects alike, so
the best outline of a plan follows from one layout of it in closed form.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float, Int

from tasks.worlds.brief import Brief
from tasks.worlds.floorplan.refinement import refine
from tasks.worlds.floorplan.room_layouts import Layouts, common_walls, join_layouts
from tasks.worlds.floorplan.scoring import (
    CONNECTION,
    HARD,
    START_SIDE_M,
    WALL_M,
    Demands,
    demands_of,
    doorway_width,
    score,
)
from tasks.worlds.floorplan.slicing import Shape, labelings, lay_out, shapes
from tasks.worlds.rejection import WorldRejected

_SHORTLIST = 3000
# What a wished pair costs that does not touch, and a metre of wall that it lacks, in units of squared skew.
_APART, _SHORT = 1e4, 25.0


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


_PROPOSALS = 256
# Layouts are good that cost little more than the best, by so much or by this share; and so many for variety's sake, if
# they cost no more than _FAR for each room above it.
_NEAR, _NEAR_SHARE, _MANY, _FAR = 4.0, 0.4, 6, 1.6
# A drawn layout is stretched by up to this share along x and shrunk along y: the first of so many tries, the last of
# which leaves it as it is, that does not cost more by this.
_STRETCH, _STRETCH_SLACK, _STRETCHES = 0.08, 0.5, 12


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
def good_layouts(brief: Brief) -> GoodLayouts:
    """Returns the layouts that fulfil a brief about as well as any.

    Raises:
        WorldRejected: InvalidInput, when no layout has a place for the start, or joins all rooms for the robot.
    """
    demands = demands_of(brief)
    layouts = refine(propose(demands, _PROPOSALS), demands)
    # Equal layouts must be equal on every machine, to the last bit or not.
    scores = np.round(score(layouts, demands), 4)
    if scores.min() >= HARD:
        raise WorldRejected("InvalidInput", _hindrance(brief, demands))
    best = np.argsort(scores, kind="stable")
    beyond = scores[best] - scores[best[0]]
    far = _FAR * len(brief.rooms)
    limit = max(_NEAR, _NEAR_SHARE * float(scores[best[0]] % CONNECTION), min(float(beyond[:_MANY][-1]), far))
    best, beyond = best[beyond <= limit], beyond[beyond <= limit]
    weight = 1.0 / (1.0 + 2.0 * beyond / far)
    return GoodLayouts(layouts[best], scores[best], weight / weight.sum(), demands)


def draw_layout(rng: np.random.Generator, brief: Brief) -> Layouts:
    """Returns one good layout (an axis of length 1), in whole centimetres.

    Raises:
        WorldRejected: As ``good_layouts`` says.
    """
    good = good_layouts(brief)
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


def _hindrance(brief: Brief, demands: Demands) -> str:
    """Returns why no layout is usable, for a person."""
    rooms = sorted(brief.rooms, key=lambda room: room.area_m2)
    small, large = rooms[0], rooms[-1]
    if math.sqrt(large.area_m2) < START_SIDE_M:
        return (
            f"the clear metre around the start needs a room at least {START_SIDE_M} m wide, and the largest, "
            f"{large.name}, has {large.area_m2:g} m2; make a room larger"
        )
    if math.sqrt(small.area_m2) < demands.narrow_m:
        return (
            f"a robot of {brief.robot_radius_m:g} m radius needs rooms at least {demands.narrow_m:.2f} m wide, and "
            f"{small.name} has {small.area_m2:g} m2; make it larger or the robot smaller"
        )
    return (
        f"no layout of the {len(rooms)} rooms joins them all by doorways of {doorway_width(brief):.2f} m and has one "
        f"at least {START_SIDE_M} m wide, which the clear metre around the start needs; make a room larger"
    )
