"""How little a place suits a group: what it likes, against where it would stand."""

import math
from collections.abc import Sequence

import numpy as np

from tasks.worlds.furnishing.groups.group import FurnitureGroup
from tasks.worlds.furnishing.scene import Piece, RoomScene
from tasks.worlds.furnishing.spots import Spot

# What standing in the middle of a room costs, where that is no hall: there people do so.
_FREE_STANDING_COST, _IN_HALLS = 1.5, 0.1
_HALL_M2 = 80.0
_CORNERLESS_COST = 3.0
_TURNED_AWAY_COST = 4.0


def placement_cost(
    rng: np.random.Generator, scene: RoomScene, group: FurnitureGroup, spots: Sequence[Spot]
) -> list[float]:
    """Returns how little each place suits a group.

    Args:
        rng: Decides between places that suit alike.
        scene: The room.
        group: What is to be placed.
        spots: The places.
    """
    taste = group.taste
    chances = rng.random(len(spots)).tolist()
    cost = [taste.chance * chance + taste.middle * spot.aside for chance, spot in zip(chances, spots, strict=True)]
    if len(scene.lines) > 4:
        away = _FREE_STANDING_COST if scene.floor.area < _HALL_M2 else _IN_HALLS
        cost = [each if spot.at_wall else each + away for each, spot in zip(cost, spots, strict=True)]
    if len(group.members) > len(group.needed):
        worth = [0.0 if member.needed else member.worth for member in group.members]
        cost = [each - _worth(worth, spot) for each, spot in zip(cost, spots, strict=True)]
    if taste.corner:
        cost = [each - taste.corner * spot.held for each, spot in zip(cost, spots, strict=True)]
    if group.anchor == "corner":
        cost = [each + _CORNERLESS_COST * (spot.held < 0.99) for each, spot in zip(cost, spots, strict=True)]
    if taste.window and scene.sills:
        cost = [each - taste.window * _below_windows(scene, spot) for each, spot in zip(cost, spots, strict=True)]
    if taste.away and scene.keep_clear:
        ways = [box.center for box in scene.keep_clear]
        cost = [each + taste.away / (0.5 + _distance(spot, ways)) for each, spot in zip(cost, spots, strict=True)]
    company = _company_cost(scene, group, spots)
    return [each + more for each, more in zip(cost, company, strict=True)] if company else cost


def _worth(worth: list[float], spot: Spot) -> float:
    total = 0.0
    for free, each in zip(spot.free, worth, strict=True):
        if free:
            total += each
    return total


def _company_cost(scene: RoomScene, group: FurnitureGroup, spots: Sequence[Spot]) -> list[float]:
    """Returns what each place costs for what stands near it and across from it; nothing where that does not matter."""
    taste, cost = group.taste, [0.0] * len(spots)
    near = [piece.center for piece in scene.pieces if piece.type in taste.near] if taste.near else []
    same = [piece.center for piece in scene.pieces if piece.type == group.members[0].kind] if taste.apart else []
    facing = next((piece for piece in scene.pieces if piece.type == taste.facing), None) if taste.facing else None
    if near:
        cost = [0.5 * _distance(spot, near) for spot in spots]
    if same:
        cost = [each + 2.0 / (0.5 + _distance(spot, same)) for each, spot in zip(cost, spots, strict=True)]
    if facing:
        cost = [each + _facing_cost(facing, spot) for each, spot in zip(cost, spots, strict=True)]
    return cost if near or same or facing else []


def _below_windows(scene: RoomScene, spot: Spot) -> float:
    """Returns how well a place lies below a window, 0-1."""
    along = spot.center[spot.quarter % 2]
    return max(
        (max(1.0 - abs(along - sill.middle), 0.0) for sill in scene.sills if sill.quarter == spot.quarter), default=0.0
    )


def _distance(spot: Spot, points: Sequence[tuple[float, float]]) -> float:
    """Returns how far a place is from the nearest of the points."""
    x, y = spot.center
    return math.sqrt(min([(x - px) * (x - px) + (y - py) * (y - py) for px, py in points]))


def _facing_cost(piece: Piece, spot: Spot) -> float:
    """Returns how far a place is from being across from a piece: in line, and turned to it."""
    axis = piece.quarter % 2
    turned_away = _TURNED_AWAY_COST * (spot.quarter != (piece.quarter + 2) % 4)
    return abs(spot.center[axis] - piece.center[axis]) + turned_away
