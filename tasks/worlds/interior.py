"""The furniture of one interior: rooms furnished one by one, and again where a robot would be shut in or out."""

from collections.abc import Sequence
from dataclasses import dataclass

from specs.world import Furniture, RoomType, Solid
from tasks.worlds.assembling import assemble, draw_tints
from tasks.worlds.brief import Brief
from tasks.worlds.certificate import ROBOT_RADIUS_M
from tasks.worlds.clearance import connected_share, measure_clearance, reaches_room
from tasks.worlds.floorplan import FloorPlan
from tasks.worlds.furnishing import DENSITIES, furnish
from tasks.worlds.geometry import Box
from tasks.worlds.parts import Tints
from tasks.worlds.placing import Piece
from tasks.worlds.streams import room_stream

_DOOR_CLEAR_M = 0.85
_DOOR_EXTRA_M = 0.05
# Primitives of all furniture, shared out by floor area and by how much a type needs: chairs have many parts.
_SOLIDS = 86
_SOLIDS_ROOM = 9
_NEEDS: dict[RoomType, float] = {
    "Bedroom": 1.0,
    "Bathroom": 1.0,
    "Living": 1.0,
    "Dining": 1.7,
    "Kitchen": 1.3,
    "Hallway": 0.6,
    "Closet": 0.6,
}
_CONNECTED = 0.7
# How much of the wished density each attempt at a room keeps; the last leaves it empty, which always works.
_ATTEMPTS = (1.0, 1.0, 1.0, 0.7, 0.5, 0.25, 0.0)


@dataclass(frozen=True)
class Draw:
    """Which interior is drawn: the seed and the indices, both from 1."""

    seed: int
    floorplan_index: int
    interior_index: int


@dataclass(frozen=True)
class _Furnished:
    """One room's furniture before it has names."""

    pieces: tuple[Piece, ...]
    tints: Tints


def furnish_interior(brief: Brief, plan: FloorPlan, walls: Sequence[Solid], draw: Draw) -> tuple[Furniture, ...]:
    """Returns all furniture of an interior, such that a robot gets into every room and nearly everywhere in it.

    Rooms draw from streams of their own, so trying one again leaves the others as they are.
    """
    attempts = [0] * len(brief.rooms)
    rooms = [_furnish_room(brief, plan, draw, room, 0) for room in range(len(brief.rooms))]
    while True:
        furniture = _named(brief, rooms)
        troubled = [room for room in _troubled(plan, walls, furniture) if attempts[room] < len(_ATTEMPTS) - 1]
        if not troubled:
            return furniture
        for room in troubled:
            attempts[room] += 1
            rooms[room] = _furnish_room(brief, plan, draw, room, attempts[room])


def unfurnished_wishes(brief: Brief, furniture: Sequence[Furniture]) -> tuple[str, ...]:
    """Returns one sentence for each room that wishes furniture of a list and got none of it."""
    furnished = {piece.room for piece in furniture}
    return tuple(
        f"{room.name}: no place for any of {', '.join(room.furniture)}"
        for room in brief.rooms
        if room.furniture and room.name not in furnished
    )


def _furnish_room(brief: Brief, plan: FloorPlan, draw: Draw, room: int, attempt: int) -> _Furnished:
    rng = room_stream(draw.seed, draw.floorplan_index, draw.interior_index, room, attempt)
    tints = draw_tints(rng)
    density = DENSITIES[brief.rooms[room].density] * _ATTEMPTS[attempt]
    if density == 0.0:
        return _Furnished((), tints)
    needs = [wish.area_m2 * _NEEDS[wish.type] for wish in brief.rooms]
    floor = plan.floors[room]
    solids = max(_SOLIDS_ROOM, round(_SOLIDS * needs[room] / sum(needs)))
    pieces = furnish(rng, brief.rooms[room], floor, _keep_clear(plan, room), solids=solids, density=density)
    return _Furnished(pieces, tints)


def _keep_clear(plan: FloorPlan, room: int) -> tuple[Box, ...]:
    """Returns the floor before a room's passages."""
    return tuple(gap.box(_DOOR_CLEAR_M, _DOOR_EXTRA_M) for gap in plan.gaps if room in gap.rooms)


def _named(brief: Brief, rooms: Sequence[_Furnished]) -> tuple[Furniture, ...]:
    counts: dict[str, int] = {}
    named: list[Furniture] = []
    for wish, furnished in zip(brief.rooms, rooms, strict=True):
        for piece in furnished.pieces:
            counts[piece.type] = counts.get(piece.type, 0) + 1
            named.append(assemble(piece, f"{piece.type}_{counts[piece.type]}", wish.name, furnished.tints))
    return tuple(named)


def _troubled(plan: FloorPlan, walls: Sequence[Solid], furniture: Sequence[Furniture]) -> list[int]:
    """Returns the rooms to furnish again: those with floor shut off, those not reached, and the ways to them."""
    solids = [*walls, *(solid for piece in furniture for solid in piece.solids)]
    clearance = measure_clearance(plan.footprint, solids)
    reached = clearance.reached(ROBOT_RADIUS_M)
    troubled: set[int] = set()
    for room, floor in enumerate(plan.floors):
        if not reaches_room(reached, clearance, floor, ROBOT_RADIUS_M):
            troubled |= {room, *(other for gap in plan.gaps if room in gap.rooms for other in gap.rooms)}
        elif connected_share(reached, clearance, floor, ROBOT_RADIUS_M) < _CONNECTED:
            troubled.add(room)
    return sorted(troubled)
