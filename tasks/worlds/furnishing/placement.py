"""Puts a group where it suits it best: on the floor, in nobody's way, and leaving the ways open."""

import numpy as np
from jaxtyping import Bool, Float

from tasks.worlds.floorplan.floorplan import START_CLEAR_M
from tasks.worlds.furnishing.groups.group import FurnitureGroup
from tasks.worlds.furnishing.room_access import robot_gets_around
from tasks.worlds.furnishing.scene import Piece, PlacedGroup, RoomScene
from tasks.worlds.furnishing.spots import Spots, find_spots
from tasks.worlds.furnishing.suitability import placement_cost
from tasks.worlds.furniture.catalogue import CATALOGUE
from tasks.worlds.geometry.boxes import Box, find_meetings

_CAREFUL_TRIES = 4
_TWICE = np.array([0, 1, 0, 1])


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
    if spots.quarters.size == 0:
        return None
    boxes = group.boxes[:, spots.quarters] + spots.centers.T[_TWICE][..., None]
    free = _free_members(scene, group, boxes)
    fitting = np.flatnonzero(free[:, group.needed].all(axis=1))
    if fitting.size == 0:
        return None
    spots, free, boxes = Spots(*[column[fitting] for column in spots]), free[fitting], boxes[:, fitting]
    cost = placement_cost(rng, scene, group, spots, free)
    for best in cost.argsort(kind="stable")[:_CAREFUL_TRIES].tolist() if radius_m else [int(cost.argmin())]:
        quarter, middle = int(spots.quarters[best]), spots.centers[best].tolist()
        found = _stand(group, (*middle, quarter), free[best].tolist(), boxes[:, best].T.tolist(), spare_m2)
        if not radius_m or _keeps_ways_open(scene, found, radius_m):
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


def _stand(
    group: FurnitureGroup, pose: tuple[float, float, int], free: list[bool], boxes: list[list[float]], spare_m2: float
) -> PlacedGroup:
    """Returns a group at a place.

    Args:
        group: What stands there.
        pose: The middle of its frame, and which way it faces.
        free: Which members there is room for.
        boxes: Where its members, then its zones lie in the room.
        spare_m2: How much floor members that it could do without may cover.
    """
    pieces: list[Piece] = []
    kept: set[int] = set()
    x, y, quarter = pose
    for number, member in enumerate(group.members):
        if not member.needed:
            if not free[number] or member.covers > spare_m2:
                continue
            spare_m2 -= member.covers
        dx, dy = turn_quarters(member.at, quarter)
        center = (round(x + dx, 3), round(y + dy, 3))
        facing = (quarter + member.quarter) % 4
        pieces.append(Piece(member.kind, member.size, center, facing, member.askew, Box(*boxes[number]), member.covers))
        kept.add(number)
    zones = zip(boxes[len(group.members) :], group.zones, strict=True)
    return PlacedGroup(tuple(pieces), tuple(Box(*box) for box, zone in zones if zone.member in kept))


def _free_members(
    scene: RoomScene, group: FurnitureGroup, boxes: Float[np.ndarray, "4 many boxes"]
) -> Bool[np.ndarray, "many members"]:
    """Returns which members stand on the floor, in nobody's way and usable, at each place."""
    count = len(group.members)
    # Bodies keep off everything; what they use may lie where others walk, but nothing may stand there.
    free = np.logical_not(find_meetings(boxes[:, :, :count], scene.barred[:, : scene.bars_low]).any(axis=2))
    if scene.holds_start:
        free &= _clear_of_start(boxes[:, :, :count])
    for number, sill in enumerate(scene.sills, start=scene.bars_low):
        tall = [member.size[2] > sill.height and not CATALOGUE[member.kind].under_window for member in group.members]
        if any(tall):
            free &= ~(find_meetings(boxes[:, :, :count], scene.barred[:, number : number + 1])[..., 0] & np.array(tall))
    if group.zones:
        usable = np.logical_not(find_meetings(boxes[:, :, count:], scene.barred[:, : scene.bars_zones]).any(axis=2))
        for number, zone in enumerate(group.zones):
            free[:, zone.member] &= usable[:, number]
    return free


def _clear_of_start(boxes: Float[np.ndarray, "4 many some"]) -> Bool[np.ndarray, "many some"]:
    x_min, y_min, x_max, y_max = boxes
    gap_x, gap_y = (np.maximum(np.maximum(low, -high), 0.0) for low, high in ((x_min, x_max), (y_min, y_max)))
    return gap_x * gap_x + gap_y * gap_y >= START_CLEAR_M**2
