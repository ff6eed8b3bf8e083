"""The furniture of one interior: rooms furnished one by one, and again where a robot would be shut in or out.

A room gets groups of its defaults, or of the template's list, until its density is met; its ways are kept open.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from specs.data.world import Furniture, Solid
from tasks.worlds.floorplan.doors import Hanging, hang_doors
from tasks.worlds.floorplan.floorplan import FloorPlan
from tasks.worlds.floorplan.scoring import WALL_M
from tasks.worlds.furnishing.arrangements import groups_to_try
from tasks.worlds.furnishing.assembly import Look, assemble, draw_look
from tasks.worlds.furnishing.groups import FurnitureGroup, RoomContext
from tasks.worlds.furnishing.placement import place_group, robot_gets_around
from tasks.worlds.furnishing.scene import Piece, PlacedGroup, RoomScene, open_scene, way_width
from tasks.worlds.furniture.catalogue import compose, draw_listed_furniture, draw_usual_furniture
from tasks.worlds.furniture.furniture_type import Style, TypeName
from tasks.worlds.geometry import BoundsGrid, Box, bounds_grid, connected_share, reaches_room
from tasks.worlds.resolved_template import COVERED, COVERED_BY_TYPE, COVERED_SPREAD, ResolvedTemplate, RoomWish
from tasks.worlds.streams import room_stream

_ROUNDS = 12
# A group may miss the wished density by as much as leaving it out would; what makes the room, by more.
_SHARE_WITHIN, _ESSENTIAL_WITHIN = 0.5, 0.55
_NEAR_M2 = 0.12
_OPTIONAL_M2 = 0.3
_LARGE_M2 = 1.5
_MENDS = 4
_DOOR_CLEAR_M = 0.85
_DOOR_EXTRA_M = 0.05
# Primitives of all furniture, shared out by floor area; a small room gets a few more than its share.
_SOLIDS = 450
_SOLIDS_ROOM = 30
_CONNECTED = 0.7
# How much of the wished density each attempt at a room keeps; the last leaves it empty, which always works.
_ATTEMPTS = (1.0, 1.0, 1.0, 0.7, 0.5, 0.25, 0.0)


@dataclass
class _Work:
    """A room at work.

    Attributes:
        target_m2: How much floor shall be covered.
        solids: How many primitives there may still be.
        radius_m: Radius of the robot that shall get around; only groups that are large must prove that it does.
        careful: Whether all of them must.
        hopeless: Types for which there was no place; there will be none later.
    """

    rng: np.random.Generator
    wish: RoomWish
    scene: RoomScene
    style: Style
    target_m2: float
    solids: int
    radius_m: float
    careful: bool
    covered_m2: float = 0.0
    hopeless: set[TypeName] = field(default_factory=set[TypeName])

    @property
    def done(self) -> bool:
        return self.covered_m2 >= self.target_m2 - _NEAR_M2 or self.solids <= 0


def furnish(
    rng: np.random.Generator,
    wish: RoomWish,
    scene: RoomScene,
    style: Style,
    *,
    solids: int,
    density: float,
    radius_m: float,
    careful: bool = False,
) -> bool:
    """Puts furniture into a scene, and returns whether a robot gets around in it.

    Args:
        rng: The room's own stream.
        wish: The room as the template wants it.
        scene: The room; it gets the pieces.
        style: The shapes of its furniture, which decide how many primitives a piece has.
        solids: How many primitives there may be, give or take a group.
        density: Share of the floor to cover, 0-1.
        radius_m: Radius of the robot that shall get around in the room.
        careful: Whether each group must prove that it does; if not, only large ones must.
    """
    if wish.furniture == ():
        return True
    first, rest = (
        draw_usual_furniture(rng, wish.type)
        if wish.furniture is None
        else draw_listed_furniture(rng, wish.type, wish.furniture)
    )
    work = _Work(rng, wish, scene, style, density * scene.floor.area, solids, radius_m, careful)
    for kind in first:
        if scene.count(kind) == 0 and not (work.done and scene.pieces):
            _place_first_fit(work, kind, _ESSENTIAL_WITHIN)
    _fill(work, rest)
    if _leaves_open(work, len(scene.groups)):
        return True
    work.careful = True
    mended = _mend(work)
    _fill(work, rest)
    return mended


def _fill(work: _Work, kinds: dict[TypeName, float]) -> None:
    """Adds groups in rounds until the density is met, or a round adds none.

    Args:
        work: The room.
        kinds: What to add, and the floor for which there is one of each.
    """
    scene = work.scene
    for _ in range(_ROUNDS):
        before = len(scene.pieces)
        for kind, spread_m2 in kinds.items():
            if work.done:
                return
            if kind not in work.hopeless and scene.count(kind) < 1 + int(scene.floor.area / spread_m2):
                _place_first_fit(work, kind, _SHARE_WITHIN)
        if len(scene.pieces) == before:
            return


def _place_first_fit(work: _Work, kind: TypeName, within: float) -> None:
    """Places the first group for a type that fits the density and the room."""
    left = work.target_m2 - work.covered_m2
    setting = RoomContext(work.rng, work.wish.type, work.scene, work.wish.furniture, left)
    tried = False
    last: FurnitureGroup | None = None
    for group in groups_to_try(setting, kind):
        last = group
        if within * group.area > left:
            continue
        tried = True
        if _try_group(work, group, left):
            return
    if not work.scene.pieces and last is not None and not tried:
        _try_group(work, last, left)
    elif tried:
        work.hopeless.add(kind)


def _try_group(work: _Work, group: FurnitureGroup, left_m2: float) -> bool:
    care = work.radius_m if work.careful or group.area > _LARGE_M2 else 0.0
    spare = left_m2 - group.area + _OPTIONAL_M2 if group.area <= left_m2 else 0.0
    found = place_group(work.rng, work.scene, group, spare_m2=spare, radius_m=care)
    if found is None:
        return False
    _account(work, found, 1)
    return True


def _mend(work: _Work) -> bool:
    """Takes out the groups that shut a robot out of a part of the room, the earliest that does first."""
    groups = work.scene.groups
    for _ in range(_MENDS):
        low, high = 0, len(groups)
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if _leaves_open(work, middle) else (low, middle)
        _account(work, work.scene.remove(high - 1), -1)
        if _leaves_open(work, len(groups)):
            return True
    return False


def _leaves_open(work: _Work, count: int) -> bool:
    """Returns whether a robot gets around when only the first so many groups stand."""
    bodies = [piece.body for group in work.scene.groups[:count] for piece in group.pieces]
    return robot_gets_around(work.scene.floor, bodies, work.scene.entries, work.radius_m)


def _account(work: _Work, group: PlacedGroup, sign: int) -> None:
    work.covered_m2 += sign * sum(piece.covers_m2 for piece in group.pieces)
    work.solids -= sign * sum(len(compose(piece.type, piece.size, work.style)) for piece in group.pieces)


@dataclass(frozen=True)
class InteriorKey:
    """Which interior is drawn: the seed, the indices, both from 1, and how many tries were given up before."""

    seed: int
    floorplan_index: int
    interior_index: int
    sub_seed: int = 0


@dataclass(frozen=True)
class _Furnished:
    """One room's furniture before it has names."""

    pieces: tuple[Piece, ...]
    look: Look


@dataclass(frozen=True)
class _Site:
    """What an interior is made for."""

    resolved: ResolvedTemplate
    plan: FloorPlan
    draw: InteriorKey
    hangings: tuple[Hanging, ...]
    floors: tuple[Box, ...]


def furnish_interior(
    resolved: ResolvedTemplate, plan: FloorPlan, fixed: Sequence[Solid], draw: InteriorKey
) -> tuple[Furniture, ...]:
    """Returns all furniture of an interior, such that a robot gets into every room and nearly everywhere in it.

    Rooms draw from streams of their own, so trying one again leaves the others as they are.

    Args:
        resolved: What the template asks for.
        plan: The floor plan.
        fixed: Walls, and door leaves as they stand fully open.
        draw: Which interior it is.
    """
    site = _Site(resolved, plan, draw, hang_doors(resolved, plan), plan.floors)
    attempts = [0] * len(resolved.rooms)
    rooms = [_furnish_room(site, room, attempts) for room in range(len(resolved.rooms))]
    while True:
        furniture = _name_pieces(resolved, rooms)
        solids = [*fixed, *(solid for piece in furniture for solid in piece.solids)]
        troubled = _rooms_to_redo(site, bounds_grid(plan.footprint, solids))
        troubled = [room for room in troubled if attempts[room] < len(_ATTEMPTS) - 1]
        if not troubled:
            return furniture
        for room in troubled:
            attempts[room] += 1
            rooms[room] = _furnish_room(site, room, attempts)


def _furnish_room(site: _Site, room: int, attempts: list[int]) -> _Furnished:
    """Furnishes a room: first freely, and when that shuts ways that cannot be mended, with care at each step."""
    draw, wish, radius = site.draw, site.resolved.rooms[room], site.resolved.robot_radius_m
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
    wishes = site.resolved.rooms
    furnished = [floor.area for floor, wish in zip(site.floors, wishes, strict=True) if wish.furniture != ()]
    return round(max((_SOLIDS - _SOLIDS_ROOM) * site.floors[room].area / max(sum(furnished), 1.0), _SOLIDS_ROOM))


def _scene(site: _Site, room: int) -> RoomScene:
    """Returns an empty room, with the floor kept free before its passages and under the leaves that swing into it."""
    plan, floor, radius = site.plan, site.floors[room], site.resolved.robot_radius_m
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


def _name_pieces(resolved: ResolvedTemplate, rooms: Sequence[_Furnished]) -> tuple[Furniture, ...]:
    counts: dict[str, int] = {}
    named: list[Furniture] = []
    for wish, furnished in zip(resolved.rooms, rooms, strict=True):
        for piece in furnished.pieces:
            counts[piece.type] = counts.get(piece.type, 0) + 1
            named.append(assemble(piece, f"{piece.type}_{counts[piece.type]}", wish.name, furnished.look))
    return tuple(named)


def _rooms_to_redo(site: _Site, grid: BoundsGrid) -> list[int]:
    """Returns the rooms to furnish again: those with floor shut off, those not reached, and the ways to them."""
    radius, gaps = site.resolved.robot_radius_m, site.plan.gaps
    reached = grid.reached(radius)
    troubled: set[int] = set()
    for room, floor in enumerate(site.floors):
        if not reaches_room(reached, grid, floor, radius):
            troubled |= {room, *(other for gap in gaps if room in gap.rooms for other in gap.rooms)}
        elif connected_share(reached, grid, floor, radius) < _CONNECTED:
            troubled.add(room)
    return sorted(troubled)
