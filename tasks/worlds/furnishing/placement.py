"""Puts a group where it suits it best: on the floor, in nobody's way, and leaving the ways open for a robot."""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool

from tasks.worlds.furnishing.groups import FurnitureGroup
from tasks.worlds.furnishing.scene import Piece, PlacedGroup, RoomScene
from tasks.worlds.furnishing.spots import Spot, find_spots
from tasks.worlds.geometry import Box, connected, label_parts

_CELL_M = 0.1
# What the clearance grid takes from a way at most: see ``_GRID_SLACK_M`` of ``geometry``, and half of its cell.
_PLAY_M = 0.09
_CONNECTED = 0.78
# What standing in the middle of a room costs, where that is no hall: there people do so.
_FREE_STANDING_COST, _IN_HALLS = 1.5, 0.1
_HALL_M2 = 80.0
_CORNERLESS_COST = 3.0
_TURNED_AWAY_COST = 4.0
_CAREFUL_TRIES = 4


def robot_gets_around(
    floor: Box, bodies: Sequence[Box], entries: Sequence[tuple[float, float]], radius_m: float
) -> bool:
    """Returns whether a robot gets around in a room.

    Args:
        floor: The room's floor.
        bodies: What stands on it.
        entries: Where a robot stands that has just come in, or starts.
        radius_m: The robot's radius.
    """
    room = floor.grown(-radius_m - _PLAY_M)
    rows, columns = int(room.width / _CELL_M) + 1, int(room.height / _CELL_M) + 1
    if min(rows, columns) < 2:
        return not bodies
    free = np.ones((rows, columns), dtype=bool)
    for body in bodies:
        free[_touching(body, room, radius_m + _PLAY_M)] = False
    wanted = _CONNECTED * np.count_nonzero(free)
    if not entries:
        return _has_large_part(free, wanted)
    cells = [_cell(room, entry, rows, columns) for entry in entries]
    if not all(free[cell] for cell in cells):
        return False
    part = connected(free, cells[0])
    return all(part[cell] for cell in cells) and bool(np.count_nonzero(part) >= wanted)


def _touching(body: Box, room: Box, by_m: float) -> tuple[slice, slice]:
    """Returns the cells from which a robot would touch a body."""
    x_min, y_min, x_max, y_max = body.grown(by_m)
    return _cells_between(x_min - room.x_min, x_max - room.x_min), _cells_between(
        y_min - room.y_min, y_max - room.y_min
    )


def _cells_between(low_m: float, high_m: float) -> slice:
    return slice(max(int(low_m / _CELL_M) + 1, 0), max(int(high_m / _CELL_M) + 1, 0))


def _cell(room: Box, point: tuple[float, float], rows: int, columns: int) -> tuple[int, int]:
    x = min(max(round((point[0] - room.x_min) / _CELL_M), 0), rows - 1)
    y = min(max(round((point[1] - room.y_min) / _CELL_M), 0), columns - 1)
    return x, y


def _has_large_part(free: Bool[np.ndarray, "x y"], wanted: float) -> bool:
    """Returns whether so many free cells hang together."""
    sizes = np.bincount(label_parts(free)[free])
    return sizes.size > 0 and int(sizes.max()) >= wanted


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
