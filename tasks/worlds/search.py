"""The search for a layout: many random slicing trees, the best few refined, one of the best drawn."""

import numpy as np
from jaxtyping import Float

from tasks.worlds.brief import Brief
from tasks.worlds.rejection import WorldRejected
from tasks.worlds.scoring import (
    CONNECTION,
    HARD,
    START_SIDE_M,
    WALL_M,
    Demands,
    demands_of,
    score_connections,
    score_reach,
    score_shapes,
)
from tasks.worlds.slicing import AREA_PASSES, Layouts, lay_out, random_trees

_TREES = (64, 256, 1024, 2048, 4096, 6144)  # by number of rooms
_ROUNDS = 6
_FINALISTS = 48
# Layouts whose score is this close to the best are as good to a person; one of them is drawn, for variety.
_SLACK = 0.02


def search_layout(rng: np.random.Generator, brief: Brief) -> Layouts:
    """Returns one layout (an axis of length 1), searched until all wished connections fit or the rounds are over.

    Raises:
        WorldRejected: InvalidInput, when no layout has a room wide enough for the start, or joins all rooms.
    """
    demands = demands_of(brief)
    layouts, scores = _finalists(rng, demands)
    for _ in range(_ROUNDS - 1):
        if scores.min() < CONNECTION:
            break
        more, more_scores = _finalists(rng, demands)
        if more_scores.min() < scores.min():
            layouts, scores = more, more_scores
    if scores.min() >= HARD:
        raise WorldRejected(
            "InvalidInput",
            f"no layout of the {len(brief.rooms)} rooms joins them all and has one at least {START_SIDE_M} m wide, "
            "which the clear metre around the start needs; make a room larger",
        )
    good = np.flatnonzero(scores <= scores.min() + _SLACK)
    return layouts[good[[int(rng.integers(len(good)))]]]


def _finalists(rng: np.random.Generator, demands: Demands) -> tuple[Layouts, Float[np.ndarray, " finalists"]]:
    """Returns the best of one round, areas exact and coordinates whole centimetres, with their scores."""
    rooms = len(demands.areas_m2)
    trees = random_trees(rng, rooms, _footprint_aspects(rng, demands.footprint_aspect, _TREES[rooms - 1]))
    rough = lay_out(trees, demands.areas_m2, WALL_M, passes=1)
    shapes = score_shapes(rough, demands)
    shapely = np.argsort(shapes, kind="stable")[: len(shapes) // 2]
    scores = shapes[shapely] + score_connections(rough[shapely], demands)
    chosen = trees[shapely[np.argsort(scores, kind="stable")[:_FINALISTS]]]
    exact = lay_out(chosen, demands.areas_m2, WALL_M, passes=AREA_PASSES)
    layouts = Layouts(np.round(exact.cells, 2), np.round(exact.cuts, 2), exact.vertical)
    wishes = score_shapes(layouts, demands) + score_connections(layouts, demands)
    return layouts, wishes + score_reach(layouts)


def _footprint_aspects(rng: np.random.Generator, wished: float, count: int) -> Float[np.ndarray, " count"]:
    """Returns aspects to try: half of them near the wish, half anything from 1:4.5 to 4.5:1 for the rooms' sake."""
    near = wished * (0.75 + 0.6 * rng.random(count))
    wide = 1.0 + 3.5 * rng.random(count)
    wide = np.where(rng.random(count) < 0.5, wide, 1.0 / wide)
    return np.where(rng.random(count) < 0.5, near, wide)
