"""The furniture of one interior: rooms furnished one by one, and again where a robot would be shut in or out."""

from collections.abc import Sequence
from dataclasses import dataclass

from specs.data.world import Furniture, Solid
from tasks.worlds.brief import COVERED, COVERED_BY_TYPE, COVERED_SPREAD, Brief
from tasks.worlds.floorplan.doors import Hanging, hang_doors
from tasks.worlds.floorplan.floorplan import FloorPlan
from tasks.worlds.floorplan.scoring import WALL_M
from tasks.worlds.furnishing.assembly import Look, assemble, draw_look
from tasks.worlds.furnishing.room_furnisher import furnish
from tasks.worlds.furnishing.scene import Piece, RoomScene, open_scene, way_width
from tasks.worlds.geometry.boxes import Box
from tasks.worlds.geometry.clearance import Clearance, connected_share, measure_clearance, reaches_room
from tasks.worlds.streams import room_stream

_DOOR_CLEAR_M = 0.85
_DOOR_EXTRA_M = 0.05
# Primitives of all furniture, shared out by floor area; a small room gets a few more than its share.
_SOLIDS = 450
_SOLIDS_ROOM = 30
_CONNECTED = 0.7
# How much of the wished density each attempt at a room keeps; the last leaves it empty, which always works.
_ATTEMPTS = (1.0, 1.0, 1.0, 0.7, 0.5, 0.25, 0.0)


@dataclass(frozen=True)
class InteriorKey:
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
    look: Look


@dataclass(frozen=True)
class _Site:
    """What an interior is made for."""

    brief: Brief
    plan: FloorPlan
    draw: InteriorKey
    hangings: tuple[Hanging, ...]
    floors: tuple[Box, ...]


def furnish_interior(brief: Brief, plan: FloorPlan, fixed: Sequence[Solid], draw: InteriorKey) -> Interior:
    """Returns all furniture of an interior, such that a robot gets into every room and nearly everywhere in it.

    Rooms draw from streams of their own, so trying one again leaves the others as they are.

    Args:
        brief: What the template asks for.
        plan: The floor plan.
        fixed: Walls, and door leaves as they stand fully open.
        draw: Which interior it is.
    """
    site = _Site(brief, plan, draw, hang_doors(brief, plan), plan.floors)
    attempts = [0] * len(brief.rooms)
    rooms = [_furnish_room(site, room, attempts) for room in range(len(brief.rooms))]
    while True:
        furniture = _name_pieces(brief, rooms)
        clearance = _clearance(plan, fixed, furniture)
        troubled = _rooms_to_redo(site, clearance)
        troubled = [room for room in troubled if attempts[room] < len(_ATTEMPTS) - 1]
        if not troubled:
            return Interior(furniture, clearance)
        for room in troubled:
            attempts[room] += 1
            rooms[room] = _furnish_room(site, room, attempts)


def _furnish_room(site: _Site, room: int, attempts: list[int]) -> _Furnished:
    """Furnishes a room: first freely, and when that shuts ways that cannot be mended, with care at each step."""
    draw, wish, radius = site.draw, site.brief.rooms[room], site.brief.robot_radius_m
    key = (draw.seed, draw.floorplan_index, draw.interior_index, draw.sub_seed)
    solids = _solids(site, room)
    while True:
        attempt = attempts[room]
        rng = room_stream(*key, room=room, attempt=attempt)
        look, scene, share = draw_look(rng), _scene(site, room), _ATTEMPTS[attempt]
        usual = COVERED_BY_TYPE.get(wish.type, COVERED)[wish.density]
        density = share * (usual + COVERED_SPREAD * (2 * float(rng.random()) - 1))
        if share == 0.0:
            return _Furnished((), look)
        careful = attempt > 0
        good = furnish(rng, wish, scene, look.style, solids=solids, density=density, radius_m=radius, careful=careful)
        if good or careful:
            return _Furnished(tuple(scene.pieces), look)
        attempts[room] += 1


def _solids(site: _Site, room: int) -> int:
    """Returns how many primitives a room may have: its share by floor, among the rooms that get furniture."""
    wishes = site.brief.rooms
    furnished = [floor.area for floor, wish in zip(site.floors, wishes, strict=True) if wish.furniture != ()]
    return round(max((_SOLIDS - _SOLIDS_ROOM) * site.floors[room].area / max(sum(furnished), 1.0), _SOLIDS_ROOM))


def _scene(site: _Site, room: int) -> RoomScene:
    """Returns an empty room, with the floor kept free before its passages and under the leaves that swing into it."""
    plan, floor, radius = site.plan, site.floors[room], site.brief.robot_radius_m
    deep = max(_DOOR_CLEAR_M, WALL_M / 2 + way_width(radius))
    gaps = [gap for gap in plan.gaps if room in gap.rooms]
    passages = tuple(gap.box(deep, _DOOR_EXTRA_M) for gap in gaps)
    swings = tuple(hanging.swing.grown(_DOOR_EXTRA_M) for hanging in site.hangings if hanging.room == room)
    entries = tuple(_clamp(floor, gap.center) for gap in gaps)
    if floor.x_min < 0 < floor.x_max and floor.y_min < 0 < floor.y_max:
        entries = (*entries, (0.0, 0.0))
    panes = [pane for pane in plan.windows if pane.room == room]
    return open_scene(floor, passages + swings, radius, panes, entries)


def _clamp(floor: Box, point: tuple[float, float]) -> tuple[float, float]:
    x, y = point
    return min(max(x, floor.x_min), floor.x_max), min(max(y, floor.y_min), floor.y_max)


def _name_pieces(brief: Brief, rooms: Sequence[_Furnished]) -> tuple[Furniture, ...]:
    counts: dict[str, int] = {}
    named: list[Furniture] = []
    for wish, furnished in zip(brief.rooms, rooms, strict=True):
        for piece in furnished.pieces:
            counts[piece.type] = counts.get(piece.type, 0) + 1
            named.append(assemble(piece, f"{piece.type}_{counts[piece.type]}", wish.name, furnished.look))
    return tuple(named)


def _clearance(plan: FloorPlan, fixed: Sequence[Solid], furniture: Sequence[Furniture]) -> Clearance:
    return measure_clearance(plan.footprint, [*fixed, *(solid for piece in furniture for solid in piece.solids)])


def _rooms_to_redo(site: _Site, clearance: Clearance) -> list[int]:
    """Returns the rooms to furnish again: those with floor shut off, those not reached, and the ways to them."""
    radius, gaps = site.brief.robot_radius_m, site.plan.gaps
    reached = clearance.reached(radius)
    troubled: set[int] = set()
    for room, floor in enumerate(site.floors):
        if not reaches_room(reached, clearance, floor, radius):
            troubled |= {room, *(other for gap in gaps if room in gap.rooms for other in gap.rooms)}
        elif connected_share(reached, clearance, floor, radius) < _CONNECTED:
            troubled.add(room)
    return sorted(troubled)
