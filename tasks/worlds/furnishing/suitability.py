"""How little a place suits a group: what it likes, against where it would stand."""

import numpy as np
from jaxtyping import Bool, Float

from tasks.worlds.furnishing.groups.group import FurnitureGroup
from tasks.worlds.furnishing.scene import RoomScene
from tasks.worlds.furnishing.spots import Spots

# What standing in the middle of a room costs, where that is no hall: there people do so.
_FREE_STANDING_COST, _IN_HALLS = 1.5, 0.1
_HALL_M2 = 80.0
_CORNERLESS_COST = 3.0
_TURNED_AWAY_COST = 4.0


def placement_cost(
    rng: np.random.Generator,
    scene: RoomScene,
    group: FurnitureGroup,
    spots: Spots,
    free: Bool[np.ndarray, "many members"],
) -> Float[np.ndarray, " many"]:
    """Returns how little each place suits a group.

    Args:
        rng: Decides between places that suit alike.
        scene: The room.
        group: What is to be placed.
        spots: The places.
        free: Which of the group's members there is room for at each.
    """
    taste = group.taste
    cost = taste.chance * rng.random(len(spots.quarters)) + taste.middle * spots.aside
    if len(scene.table.quarter) > 4:
        cost += (_FREE_STANDING_COST if scene.floor.area < _HALL_M2 else _IN_HALLS) * ~spots.at_wall
    if len(group.members) > len(group.needed):
        cost -= free @ [0.0 if member.needed else member.worth for member in group.members]
    if taste.corner:
        cost -= taste.corner * spots.held
    if group.anchor == "corner":
        cost += _CORNERLESS_COST * (spots.held < 0.99)
    if taste.window and scene.sills:
        cost -= taste.window * _below_windows(scene, spots)
    if taste.away and scene.keep_clear:
        cost += taste.away / (0.5 + _distance(spots, [box.center for box in scene.keep_clear]))
    return cost + _company_cost(scene, group, spots)


def _company_cost(scene: RoomScene, group: FurnitureGroup, spots: Spots) -> Float[np.ndarray, " many"] | float:
    """Returns what each place costs for what stands near it and across from it."""
    taste = group.taste
    cost: Float[np.ndarray, " many"] | float = 0.0
    if taste.near:
        wanted = [piece.center for piece in scene.pieces if piece.type in taste.near]
        cost = cost + (0.5 * _distance(spots, wanted) if wanted else 0.0)
    if taste.apart:
        same = [piece.center for piece in scene.pieces if piece.type == group.members[0].kind]
        cost = cost + (2.0 / (0.5 + _distance(spots, same)) if same else 0.0)
    if taste.facing:
        cost = cost + _facing_cost(scene, taste.facing, spots)
    return cost


def _below_windows(scene: RoomScene, spots: Spots) -> Float[np.ndarray, " many"]:
    """Returns how well each place lies below a window, 0-1."""
    along = spots.centers[np.arange(len(spots.quarters)), spots.quarters % 2]
    found = np.zeros(len(along))
    for sill in scene.sills:
        near = np.maximum(1.0 - np.abs(along - sill.middle), 0.0)
        found = np.maximum(found, near * (spots.quarters == sill.quarter))
    return found


def _distance(spots: Spots, points: list[tuple[float, float]]) -> Float[np.ndarray, " many"]:
    """Returns how far each place is from the nearest of the points."""
    apart = spots.centers[:, None] - np.array(points)
    return np.sqrt((apart * apart).sum(axis=2).min(axis=1))


def _facing_cost(scene: RoomScene, kind: str, spots: Spots) -> Float[np.ndarray, " many"] | float:
    """Returns how far each place is from being across from the first piece of a type: in line, and turned to it."""
    found = next((piece for piece in scene.pieces if piece.type == kind), None)
    if found is None:
        return 0.0
    aside = np.abs(spots.centers[:, found.quarter % 2] - found.center[found.quarter % 2])
    return aside + _TURNED_AWAY_COST * (spots.quarters != (found.quarter + 2) % 4)
