"""Puts a group where it suits it best: on the floor, in nobody's way, and leaving the ways open."""

import numpy as np

from tasks.worlds.furnishing.groups.group import FurnitureGroup
from tasks.worlds.furnishing.room_access import robot_gets_around
from tasks.worlds.furnishing.scene import Piece, PlacedGroup, RoomScene
from tasks.worlds.furnishing.spots import Spot, find_spots
from tasks.worlds.furnishing.suitability import placement_cost

_CAREFUL_TRIES = 4


def place_group(
    rng: np.random.Generator, scene: RoomScene, group: FurnitureGroup, *, spare_m2: float = 1e9, radius_m: float = 0.0
) -> PlacedGroup | None:
    """Puts a group into a scene where it suits it best, and returns it there; None when there is no room for it.

    Args:
        rng: Chooses between places that suit alike.
        scene: The room; it gets the pieces.
        group: What to place.
        spare_m2: How much floor members that it could do without may cover.
        radius_m: Radius of a robot that must still get around in the room; 0 for no such check.
    """
    spots = find_spots(rng, scene, group)
    if not spots:
        return None
    cost = placement_cost(rng, scene, group, spots)
    if not radius_m:
        found = _stand(group, spots[cost.index(min(cost))], spare_m2)
        scene.add(found)
        return found
    for best in sorted(range(len(cost)), key=cost.__getitem__)[:_CAREFUL_TRIES]:
        found = _stand(group, spots[best], spare_m2)
        if _keeps_ways_open(scene, found, radius_m):
            scene.add(found)
            return found
    return None


def turn_quarters(point: tuple[float, float], quarter: int) -> tuple[float, float]:
    """Returns a point turned counter-clockwise about the origin by quarter turns, exactly."""
    x, y = point
    return ((x, y), (-y, x), (-x, -y), (y, -x))[quarter % 4]


def _keeps_ways_open(scene: RoomScene, group: PlacedGroup, radius_m: float) -> bool:
    bodies = [piece.body for piece in (*scene.pieces, *group.pieces)]
    return robot_gets_around(scene.floor, bodies, scene.entries, radius_m)


def _stand(group: FurnitureGroup, spot: Spot, spare_m2: float) -> PlacedGroup:
    """Returns a group at a place, without members that are in the way or cover more than there is to spare."""
    pieces: list[Piece] = []
    kept: set[int] = set()
    x, y = spot.center
    quarter, boxes = spot.quarter, group.turned(spot.quarter)
    for number, member in enumerate(group.members):
        if not member.needed:
            if not spot.free[number] or member.covers > spare_m2:
                continue
            spare_m2 -= member.covers
        dx, dy = turn_quarters(member.at, quarter)
        center = (round(x + dx, 3), round(y + dy, 3))
        facing, body = (quarter + member.quarter) % 4, boxes[number].shifted(x, y)
        pieces.append(Piece(member.kind, member.size, center, facing, member.askew, body, member.covers))
        kept.add(number)
    zones = zip(boxes[len(group.members) :], group.zones, strict=True)
    return PlacedGroup(tuple(pieces), tuple(box.shifted(x, y) for box, zone in zones if zone.member in kept))
