"""How well layouts fulfil a brief, in bulk; a lower score is better.

Hard demands (a place for the start, all rooms reachable) weigh more than any wish, wished connections more than all
shapes together.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from tasks.worlds.brief import Brief
from tasks.worlds.geometry import EPSILON_M
from tasks.worlds.slicing import Layouts

WALL_M = 0.12
DOORWAY_M = 0.9
OPENING_MIN_M = 1.4
# Wall left standing at either side of a gap.
JAMB_M = 0.1
# Least width of the room that holds the start: the clear disc of 1 m radius and a hand's breadth.
START_SIDE_M = 2.1

HARD = 1e5
CONNECTION = 100.0
_SLIVER_M = 1.6
_SLIVER = 20.0


@dataclass(frozen=True)
class Demands:
    """A brief as arrays over rooms and over pairs of rooms.

    Attributes:
        aspect: Wished width over height by room.
        weight: How much a room's aspect counts.
        slim: Width below which a room is a sliver.
        shared_m: Length of wall that a pair must share for its wished connections, 0 for none.
    """

    areas_m2: Float[np.ndarray, " rooms"]
    aspect: Float[np.ndarray, " rooms"]
    weight: Float[np.ndarray, " rooms"]
    slim: Float[np.ndarray, " rooms"]
    shared_m: Float[np.ndarray, "rooms rooms"]
    footprint_aspect: float
    footprint_weight: float


def demands_of(brief: Brief) -> Demands:
    """Returns a brief as arrays.

    A wish of 1:1 is what a template says when it says nothing, so it weighs less than any other.
    """
    areas = np.array([room.area_m2 for room in brief.rooms])
    aspect = np.array([room.aspect for room in brief.rooms])
    shared = np.zeros((len(areas), len(areas)))
    for wish in brief.connections:
        gap = OPENING_MIN_M if wish.kind == "Opening" else DOORWAY_M
        shared[wish.rooms] += gap + JAMB_M + (JAMB_M if shared[wish.rooms] == 0 else 0.0)
    return Demands(
        areas_m2=areas,
        aspect=aspect,
        weight=np.where(aspect == 1.0, 0.1, 1.0),
        slim=np.minimum(_SLIVER_M, 0.6 * np.sqrt(areas)),
        shared_m=shared,
        footprint_aspect=brief.footprint_aspect,
        footprint_weight=0.01 if brief.footprint_aspect == 1.0 else 3.0,
    )


def deviation(
    found: Float[np.ndarray, "*shape"], wished: Float[np.ndarray, "*shape"] | float
) -> Float[np.ndarray, "*shape"]:
    """Returns by what share an aspect ratio misses the wished one, the same for too wide and too deep."""
    ratio = found / wished
    return np.maximum(ratio, 1.0 / ratio) - 1.0


def shared_walls(layouts: Layouts) -> Float[np.ndarray, "trees rooms rooms"]:
    """Returns the length of wall that each pair of rooms faces from both sides (metres)."""
    low, high = layouts.cells[..., :2], layouts.cells[..., 2:]
    overlap = np.minimum(high[:, :, None], high[:, None]) - np.maximum(low[:, :, None], low[:, None])
    touching = np.abs(overlap) < EPSILON_M
    along_y = np.where(touching[..., 0], overlap[..., 1], 0.0)
    along_x = np.where(touching[..., 1], overlap[..., 0], 0.0)
    return np.maximum(np.maximum(along_x, along_y) - WALL_M, 0.0)


def score_shapes(layouts: Layouts, demands: Demands) -> Float[np.ndarray, " trees"]:
    """Returns what room and footprint shapes cost: squared deviations, slivers, and no room for the start."""
    extent = layouts.cells[..., 2:] - layouts.cells[..., :2] - WALL_M
    side = np.maximum(np.minimum(extent[..., 0], extent[..., 1]), EPSILON_M)
    extent = np.maximum(extent, EPSILON_M)
    rooms = deviation(extent[..., 0] / extent[..., 1], demands.aspect)
    outer = layouts.cells[..., 2:].max(axis=1) + WALL_M
    footprint = deviation(outer[:, 0] / outer[:, 1], demands.footprint_aspect)
    sliver = np.maximum(demands.slim - side, 0.0)
    return (
        (demands.weight * rooms**2 + _SLIVER * sliver**2).sum(axis=1)
        + demands.footprint_weight * footprint**2
        + HARD * np.ceil(np.maximum(START_SIDE_M - side.max(axis=1), 0.0))
    )


def score_connections(layouts: Layouts, demands: Demands) -> Float[np.ndarray, " trees"]:
    """Returns what it costs that wished pairs share too little wall."""
    if not demands.shared_m.any():
        return np.zeros(len(layouts.cells))
    missing = np.maximum(demands.shared_m - shared_walls(layouts), 0.0) / np.maximum(demands.shared_m, DOORWAY_M)
    return CONNECTION * ((missing > 0).sum(axis=(1, 2)) + missing.sum(axis=(1, 2)))


def score_reach(layouts: Layouts) -> Float[np.ndarray, " trees"]:
    """Returns what it costs that doorways cannot join all rooms."""
    return HARD * ~all_connected(shared_walls(layouts) >= DOORWAY_M + 2 * JAMB_M)


def all_connected(adjacent: Bool[np.ndarray, "trees rooms rooms"]) -> Bool[np.ndarray, " trees"]:
    """Returns for each graph whether all rooms hang together, by squaring reachability."""
    rooms = adjacent.shape[-1]
    reached = adjacent.copy()
    reached[:, np.arange(rooms), np.arange(rooms)] = True
    for _ in range(3):
        reached = np.asarray((reached[:, :, :, None] & reached[:, None, :, :]).any(axis=2))
    return np.asarray(reached[:, 0].all(axis=1))
