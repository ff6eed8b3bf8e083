"""Proposals: the most promising of all slicing plans for a brief, judged roughly.

Stretching a plan along x and shrinking it along y by the same factor keeps its areas and scales all aspects alike, so
the best outline of a plan follows from one layout of it in closed form.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from tasks.worlds.layouts import Layouts, common_walls, joined
from tasks.worlds.scoring import WALL_M, Demands
from tasks.worlds.slicing import Shape, labelings, lay_out, shapes

_SHORTLIST = 3000
# What a wished pair costs that does not touch, and a metre of wall that it lacks, in units of squared skew.
_APART, _SHORT = 1e4, 25.0


def propose(demands: Demands, count: int) -> Layouts:
    """Returns the best plans by their aspects and connections, wall thickness taken as that of square rooms."""
    rooms = len(demands.areas_m2)
    every = [_rough(shape, demands) for shape in shapes(rooms)]
    cost = np.concatenate([each[0] for each in every])
    shortlist = np.sort(np.argsort(cost, kind="stable")[:_SHORTLIST])
    ends = np.cumsum([len(each[0]) for each in every])
    kept: list[Layouts] = []
    for shape, (costs, stretch), end in zip(shapes(rooms), every, ends, strict=True):
        first = end - len(costs)
        chosen = shortlist[(shortlist >= first) & (shortlist < end)] - first
        if chosen.size:
            kept.append(_shape_layouts(shape, chosen, stretch[chosen], demands))
    layouts, costs = joined(kept), cost[shortlist]
    short = np.maximum(demands.shared_m[:, None] - common_walls(layouts.cells(), *demands.pairs), 0.0)
    return layouts[np.argsort(costs + _SHORT * (short * short).sum(axis=0), kind="stable")[:count]]


def _rough(shape: Shape, demands: Demands) -> tuple[Float[np.ndarray, " labelings"], Float[np.ndarray, " labelings"]]:
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
        cost += _APART * _apart(shape, order, demands)
    return cost, np.sqrt(np.sqrt(deep / wide))


def _cell_areas(demands: Demands) -> Float[np.ndarray, " rooms"]:
    side = np.sqrt(demands.areas_m2) + WALL_M
    return side * side


def _apart(shape: Shape, order: Int[np.ndarray, "places labelings"], demands: Demands) -> Int[np.ndarray, " labelings"]:
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
