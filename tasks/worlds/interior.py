"""The furniture of one interior: rooms furnished one by one, and again where a robot would be shut in or out."""

from collections.abc import Sequence
from dataclasses import dataclass

from specs.world import Furniture, RoomType, Solid
from tasks.worlds.assembling import assemble, draw_tints
from tasks.worlds.brief import Brief
from tasks.worlds.clearance import Clearance, connected_share, measure_clearance, reaches_room
from tasks.worlds.densities import COVERED
from tasks.worlds.doors import hang_doors
from tasks.worlds.floorplan import FloorPlan
from tasks.worlds.furnishing import furnish
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
    """Which interior is drawn: the seed, the indices, both from 1, and how many tries were given up before."""

    seed: int
    floorplan_index: int
    interior_index: int
    sub_seed: int = 0


@dataclass(frozen=True)
class Interior:
    """The furniture of an interior, and where a robot can drive between it with all doors open."""

    furniture: tuple[Furniture, ...]
    clearance: Clearance


@dataclass(frozen=True)
class _Furnished:
    """One room's furniture before it has names."""

    pieces: tuple[Piece, ...]
    tints: Tints


def furnish_interior(brief: Brief, plan: FloorPlan, fixed: Sequence[Solid], draw: Draw) -> Interior:
    """Returns all furniture of an interior, such that a robot gets into every room and nearly everywhere in it.

    Rooms draw from streams of their own, so trying one again leaves the others as they are.

    Args:
        brief: What the template asks for.
        plan: The floor plan.
        fixed: Walls, and door leaves as they stand fully open.
        draw: Which interior it is.
    """
    attempts = [0] * len(brief.rooms)
    rooms = [_furnish_room(brief, plan, draw, room, 0) for room in range(len(brief.rooms))]
    while True:
        furniture = _named(brief, rooms)
        clearance = _clearance(plan, fixed, furniture)
        troubled = _troubled(brief, plan, clearance)
        troubled = [room for room in troubled if attempts[room] < len(_ATTEMPTS) - 1]
        if not troubled:
            return Interior(furniture, clearance)
        for room in troubled:
            attempts[room] += 1
            rooms[room] = _furnish_room(brief, plan, draw, room, attempts[room])


def _furnish_room(brief: Brief, plan: FloorPlan, draw: Draw, room: int, attempt: int) -> _Furnished:
    rng = room_stream(draw.seed, draw.floorplan_index, draw.interior_index, draw.sub_seed, room=room, attempt=attempt)
    tints = draw_tints(rng)
    density = COVERED[brief.rooms[room].density] * _ATTEMPTS[attempt]
    if density == 0.0:
        return _Furnished((), tints)
    needs = [wish.area_m2 * _NEEDS[wish.type] for wish in brief.rooms]
    floor = plan.floors[room]
    solids = max(_SOLIDS_ROOM, round(_SOLIDS * needs[room] / sum(needs)))
    pieces = furnish(rng, brief.rooms[room], floor, _keep_clear(brief, plan, room), solids=solids, density=density)
    return _Furnished(pieces, tints)


def _keep_clear(brief: Brief, plan: FloorPlan, room: int) -> tuple[Box, ...]:
    """Returns the floor before a room's passages, and under the leaves that swing into it."""
    passages = tuple(gap.box(_DOOR_CLEAR_M, _DOOR_EXTRA_M) for gap in plan.gaps if room in gap.rooms)
    return passages + tuple(way.swing.grown(_DOOR_EXTRA_M) for way in hang_doors(brief, plan) if way.room == room)


def _named(brief: Brief, rooms: Sequence[_Furnished]) -> tuple[Furniture, ...]:
    counts: dict[str, int] = {}
    named: list[Furniture] = []
    for wish, furnished in zip(brief.rooms, rooms, strict=True):
        for piece in furnished.pieces:
            counts[piece.type] = counts.get(piece.type, 0) + 1
            named.append(assemble(piece, f"{piece.type}_{counts[piece.type]}", wish.name, furnished.tints))
    return tuple(named)


def _clearance(plan: FloorPlan, fixed: Sequence[Solid], furniture: Sequence[Furniture]) -> Clearance:
    return measure_clearance(plan.footprint, [*fixed, *(solid for piece in furniture for solid in piece.solids)])


def _troubled(brief: Brief, plan: FloorPlan, clearance: Clearance) -> list[int]:
    """Returns the rooms to furnish again: those with floor shut off, those not reached, and the ways to them."""
    radius = brief.robot_radius_m
    reached = clearance.reached(radius)
    troubled: set[int] = set()
    for room, floor in enumerate(plan.floors):
        if not reaches_room(reached, clearance, floor, radius):
            troubled |= {room, *(other for gap in plan.gaps if room in gap.rooms for other in gap.rooms)}
        elif connected_share(reached, clearance, floor, radius) < _CONNECTED:
            troubled.add(room)
    return sorted(troubled)
