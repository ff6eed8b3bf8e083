"""The groups to try for a furniture type: which pieces are placed together, and where they may stand.

Beds with their nightstands, desks and tables with their chairs, kitchen units in a row with the island before it, sofas
with what stands around them, and the television across from them.
"""

from collections.abc import Callable, Iterator

from tasks.worlds.furnishing.groups import (
    FurnitureGroup,
    Member,
    RoomContext,
    Zone,
    front_zone,
    single_groups,
    storage_groups,
)
from tasks.worlds.furniture.catalogue import CATALOGUE
from tasks.worlds.furniture.furniture_type import GroupName, Size, Taste, TypeName
from tasks.worlds.geometry import Box

_BED_SIDE_M = 0.6
_HEAD_M = 0.5
_NIGHTSTAND_GAP_M = 0.05
_BENCH_GAP_M = 0.05
_DOUBLE_M = 1.3
_TUCK_M = 0.22
_DESK_RISE_M = 1.0
_MOST_OF_SPARE = 0.95
_BED = Taste(middle=0.8, window=0.2, away=0.6)
_BED_IN_CORNER = Taste(corner=0.8, window=0.3, away=0.5)
_CHAIR: Size = (0.45, 0.5, 0.9)
_LEGS_M = 0.09
_SEAT_M = 0.6  # Neufert: of table edge for each diner
_END_SEAT_M = 1.55
_TABLE_RISE_M = 0.75
_MOST = 6
_SMALL_ROOM_M2 = 16.0
_AISLE_M = 1.1
_LARDER: Size = (0.6, 0.6, 2.0)
_TO_TABLE_M = 0.4
_SOFA_SIDE_M = 0.08
_WALL_GAP_M = 0.02
_VIEW_M = (1.7, 4.2)  # from a sofa's front to the screen; beyond it the sofa comes away from its wall
_IDEAL_VIEW_M = 2.6
_CHAIR_ASKEW_RAD = 0.25
_CORNER_ASKEW_RAD = -0.6
GroupMaker = Callable[[RoomContext, TypeName], Iterator[FurnitureGroup]]


def bed_groups(setting: RoomContext, kind: TypeName) -> Iterator[FurnitureGroup]:
    """Yields beds to try: doubles reached from both sides, then from one, then narrower ones in a corner."""
    several = setting.scene.count(kind) > 0 and setting.area_m2 < 40.0
    sizes = [setting.smallest(kind)] if several else setting.sizes(kind)
    # A bed shall leave floor for a wardrobe, as far as the density wished for allows one.
    sizes = [size for size in sizes if size[0] * size[1] < _MOST_OF_SPARE * setting.spare_m2] or sizes[-1:]
    for size in sizes:
        if size[0] > _DOUBLE_M:
            yield _bed(setting, Member(kind, size), (-1, 1), _BED)
        side = 1 if setting.chance(0.5) else -1
        yield _bed(setting, Member(kind, size), (side,), _BED_IN_CORNER)
        yield _bed(setting, Member(kind, size), (-side,), _BED_IN_CORNER)


def _bed(setting: RoomContext, bed: Member, sides: tuple[int, ...], taste: Taste) -> FurnitureGroup:
    """Returns a bed with a nightstand, and floor to get up, on the given sides (-1 left, 1 right)."""
    x, y = bed.size[0] / 2, bed.size[1] / 2
    members = [bed]
    if setting.allows("Nightstands"):
        small = setting.size("Nightstands")
        aside, back = x + _NIGHTSTAND_GAP_M + small[0] / 2, small[1] / 2 - y
        members += [Member("Nightstands", small, (side * aside, back), needed=False) for side in sides]
    if setting.area_m2 > 16.0 and setting.allows("StorageBenches") and setting.chance(0.4):
        width = min(setting.size("StorageBenches", CATALOGUE["StorageBenches"].variants[0])[0], bed.size[0])
        members.append(
            Member("StorageBenches", (width, 0.4, 0.45), (0.0, y + _BENCH_GAP_M + 0.2), needed=False, worth=0.5)
        )
    way = setting.front_m(bed.kind)
    zones = [
        Zone(Box(min(side * x, side * (x + _BED_SIDE_M)), _HEAD_M - y, max(side * x, side * (x + _BED_SIDE_M)), y))
        for side in sides
    ]
    zones.append(front_zone(bed.size, way))
    if members[-1].kind == "StorageBenches":
        zones.append(Zone(Box(-x, y, x, y + _BENCH_GAP_M + 0.4 + way), len(members) - 1))
    return FurnitureGroup(tuple(members), tuple(zones), taste=taste)


def desk_groups(setting: RoomContext, kind: TypeName) -> Iterator[FurnitureGroup]:
    """Yields desks with a chair pushed under them, then smaller ones."""
    for size in (*setting.sizes(kind), setting.smallest(kind)):
        members = [Member(kind, size)]
        if setting.allows("DeskChairs"):
            members.append(_desk_chair(setting, size))
        yield FurnitureGroup(
            tuple(members),
            (front_zone(size, max(_DESK_RISE_M, setting.scene.way_m)),),
            taste=Taste(corner=0.3, window=1.0, away=0.2),
        )


def _desk_chair(setting: RoomContext, desk: Size) -> Member:
    size = setting.size("DeskChairs", CATALOGUE["DeskChairs"].variants[0])
    knees = -0.17  # the middle between the desk's legs and its drawers
    return Member("DeskChairs", size, (knees, desk[1] / 2 + size[1] / 2 - _TUCK_M), 2, under=_TUCK_M)


def table_groups(setting: RoomContext, kind: TypeName) -> Iterator[FurnitureGroup]:
    """Yields tables to try: in the room with chairs all around, then with one end or side at a wall, then alone."""
    sizes = setting.sizes(kind)
    turns = _long_way(setting)
    for size in sizes:
        yield _free_standing(setting, Member(kind, size), turns)
    for size in sizes[-2:]:
        yield _end_at_wall(setting, Member(kind, size, quarter=1))
        yield _side_at_wall(setting, Member(kind, size))
    small = Member(kind, setting.smallest(kind))
    yield _side_at_wall(setting, small)
    if setting.listed is not None:
        yield FurnitureGroup((small,), ())


def _long_way(setting: RoomContext) -> tuple[int, ...]:
    """Returns the ways to turn a table so that it lies along the room, or any in a square one."""
    floor = setting.scene.floor
    if max(floor.width, floor.height) < 1.15 * min(floor.width, floor.height):
        return (0, 1)
    return (0,) if floor.width > floor.height else (1,)


def _free_standing(setting: RoomContext, table: Member, turns: tuple[int, ...]) -> FurnitureGroup:
    """Returns a table in the room, with chairs all around."""
    size = table.size
    x, y = size[0] / 2, size[1] / 2
    chairs = _long_side(setting, size, -1) + _long_side(setting, size, 1)
    if size[0] >= _END_SEAT_M or size[0] == size[1]:
        chairs += [_chair(setting, size, (side * x, 0.0), side % 4) for side in (-1, 1)]
    most = 4 if setting.area_m2 < _SMALL_ROOM_M2 else _MOST
    around = max(_TABLE_RISE_M, setting.scene.way_m)
    zone = Zone(Box(-x - around, -y - around, x + around, y + around))
    # The first table of a room takes its middle.
    middle = 1.2 if setting.scene.count(table.kind) == 0 else 0.0
    return FurnitureGroup(
        (table, *_keep_allowed(setting, chairs[:most])),
        (zone,),
        "center",
        Taste(middle=middle, away=0.3, chance=0.4),
        turns,
    )


def _side_at_wall(setting: RoomContext, table: Member) -> FurnitureGroup:
    """Returns a table with a long side at a wall, and chairs along the other."""
    x, y = table.size[0] / 2, table.size[1] / 2
    chairs = _long_side(setting, table.size, 1)
    zone = Zone(Box(-x, y, x, y + max(_TABLE_RISE_M, setting.scene.way_m)))
    return FurnitureGroup((table, *_keep_allowed(setting, chairs)), (zone,), taste=Taste(window=0.6, corner=0.2))


def _end_at_wall(setting: RoomContext, table: Member) -> FurnitureGroup:
    """Returns a table, a quarter turned, whose long side runs from a wall into the room, and chairs along both."""
    x, y = table.size[1] / 2, table.size[0] / 2
    rise = max(_TABLE_RISE_M, setting.scene.way_m)
    chairs = [_turn_chair(chair) for side in (-1, 1) for chair in _long_side(setting, table.size, side)]
    zone = Zone(Box(-x - rise, -y, x + rise, y))
    front = Zone(Box(-x, y, x, y + setting.scene.way_m))
    return FurnitureGroup((table, *_keep_allowed(setting, chairs)), (zone, front), taste=Taste(window=0.4, middle=0.4))


def _long_side(setting: RoomContext, size: Size, side: int) -> list[Member]:
    """Returns the chairs along one long side (-1 at the back, 1 in front), as many as have 0.6 m each."""
    usable = size[0] - 2 * _LEGS_M
    if size[0] == size[1]:
        usable = min(usable, _SEAT_M)
    count = min(max(1, int((usable + 0.04) / _SEAT_M)), 3)
    pitch = usable / count
    return [
        _chair(setting, size, (round(-usable / 2 + (n + 0.5) * pitch, 3), side * size[1] / 2), 0 if side < 0 else 2)
        for n in range(count)
    ]


def _chair(setting: RoomContext, table: Size, edge: tuple[float, float], quarter: int) -> Member:
    """Returns a chair that faces a table from a point of its edge, and is pushed under it more or less."""
    tuck = round(_TUCK_M - 0.04 * int(3 * float(setting.rng.random())), 2)
    if table[0] == table[1]:
        tuck = min(tuck, round(table[0] / 2 - _CHAIR[0] / 2 - 0.02, 3))  # or diners at the corner would touch
    out = round(_CHAIR[1] / 2 - tuck, 3)
    # Facings 0 to 3 look along +y, -x, -y, +x; the chair stands out of the table the other way.
    dx, dy = ((0.0, -out), (out, 0.0), (0.0, out), (-out, 0.0))[quarter]
    return Member("DiningChairs", _CHAIR, (edge[0] + dx, edge[1] + dy), quarter, needed=False, worth=0.5, under=tuck)


def _turn_chair(chair: Member) -> Member:
    x, y = chair.at
    return chair._replace(at=(-y, x), quarter=(chair.quarter + 1) % 4)


def _keep_allowed(setting: RoomContext, chairs: list[Member]) -> list[Member]:
    """Returns the chairs that a list leaves; a table without any would be a poor one, so the first is needed."""
    if not setting.allows("DiningChairs"):
        return []
    return [chairs[0]._replace(needed=True), *chairs[1:]]


ROW = tuple(kind for kind, each in CATALOGUE.items() if each.group in ("kitchen row", "laundry"))
"""What stands in a row, from its tall end on: the catalogue's order."""


def row_groups(setting: RoomContext) -> Iterator[FurnitureGroup]:
    """Yields rows of all units that the room may hold and has not: wide, narrow, without the laundry, single."""
    kinds = [kind for kind in ROW if setting.allows(kind) and _wants(setting, kind)]
    mirrored = setting.chance(0.5)
    if len(kinds) > 1:
        yield _row(setting, kinds, ("DishWashers", "Ovens", "Storage"), mirrored=mirrored)
        yield _row(setting, kinds, ("DishWashers",), mirrored=mirrored)
        yield _row(setting, kinds, (), mirrored=mirrored)
    if len(kinds) > 2:
        yield _row(setting, kinds[:-1], (), mirrored=mirrored)
        yield _row(setting, kinds[1:], (), mirrored=mirrored)


def _wants(setting: RoomContext, kind: TypeName) -> bool:
    count = setting.scene.count(kind)
    if kind == "WashingMachinesAndDryers":
        return count == 0 and (setting.listed is not None or (setting.area_m2 > 11.0 and setting.chance(0.3)))
    return count == 0 or setting.scene.count("Ovens") > 0


def _row(setting: RoomContext, kinds: list[TypeName], wide: tuple[TypeName, ...], *, mirrored: bool) -> FurnitureGroup:
    """Returns a row of one unit of each type; those that are wide have drawers or the sink beside the machine."""
    units = [
        (kind, setting.size(kind, CATALOGUE[kind].variants[-1]) if kind in wide else setting.smallest(kind))
        for kind in kinds
    ]
    units = [(kind, (w, d, 0.85) if kind == "WashingMachinesAndDryers" else (w, d, h)) for kind, (w, d, h) in units]
    roomy = setting.room == "Kitchen" and "Storage" in wide
    if roomy and setting.area_m2 > 15.0 and setting.allows("Storage"):
        units.insert(0, ("Storage", _LARDER))
    if mirrored:
        units.reverse()
    first = units[0][1]
    members: list[Member] = []
    along = -first[0] / 2
    for kind, size in units:
        at = (round(along + size[0] / 2, 3), round((size[1] - first[1]) / 2, 3))
        members.append(Member(kind, size, at))
        along += size[0]
    deepest = max(size[1] for _, size in units) - first[1] / 2
    start = -first[0] / 2
    way = setting.front_m("Ovens")
    zones = [Zone(Box(start, deepest, round(along, 3), deepest + way))]
    if roomy and setting.area_m2 > 14.0 and setting.allows("KitchenIslandsAndCarts"):
        members.append(_island(setting, (start, along), deepest))
        zones.append(_island_zone(setting, members[-1], len(members) - 1))
    return FurnitureGroup(tuple(members), tuple(zones), taste=Taste(corner=0.6, window=0.0), flush=True)


def _island(setting: RoomContext, run: tuple[float, float], front: float) -> Member:
    size = setting.size("KitchenIslandsAndCarts", CATALOGUE["KitchenIslandsAndCarts"].variants[-1])
    aisle = max(_AISLE_M, setting.scene.way_m)
    middle = (round((run[0] + run[1]) / 2, 3), round(front + aisle + size[1] / 2, 3))
    return Member("KitchenIslandsAndCarts", size, middle, needed=False, worth=1.2)


def _island_zone(setting: RoomContext, island: Member, number: int) -> Zone:
    way = setting.scene.way_m
    body = island.body
    return Zone(Box(body.x_min - way, body.y_min, body.x_max + way, body.y_max + way), number)


def unit_groups(setting: RoomContext, kind: TypeName) -> Iterator[FurnitureGroup]:
    """Yields rows that begin with a unit, then that unit alone, beside others where it can."""
    if setting.scene.count(kind) == 0 or setting.chance(0.5):
        yield from row_groups(setting)
    for size in setting.sizes(kind):
        yield FurnitureGroup(
            (Member(kind, size),),
            (front_zone(size, setting.front_m(kind)),),
            taste=Taste(corner=0.5, near=ROW),
            flush=True,
        )


def laundry_groups(setting: RoomContext, kind: TypeName) -> Iterator[FurnitureGroup]:
    """Yields rows that begin with a laundry machine in a kitchen, and the machine alone in other rooms."""
    yield from (unit_groups if setting.room == "Kitchen" else single_groups)(setting, kind)


def sofa_groups(setting: RoomContext, kind: TypeName) -> Iterator[FurnitureGroup]:
    """Yields sofas to try: across from a television, then with a table and chairs, then small and alone."""
    sofas = [Member(kind, size) for size in setting.sizes(kind)]
    first = setting.scene.count(kind) == 0
    if setting.allows("MediaStorage") and setting.scene.count("MediaStorage") == 0:
        yield from _televisions(setting, sofas[0])
        if len(sofas) > 1:
            yield from _televisions(setting, sofas[-1])
    facing = "MediaStorage" if first else ""
    if setting.area_m2 > 24.0 and not first:
        yield _facing_sofas(setting, sofas[0])
    for sofa in sofas:
        yield _sofa(setting, sofa, Taste(middle=0.6, window=0.3, away=0.3, facing=facing))
    yield FurnitureGroup((sofas[-1],), (front_zone(sofas[-1].size, setting.front_m(kind)),), taste=Taste())


def armchair_groups(setting: RoomContext, kind: TypeName) -> Iterator[FurnitureGroup]:
    """Yields armchairs to try: in a corner with a lamp and a footstool, then at a wall."""
    size, front = setting.size(kind), setting.front_m(kind)
    near = Taste(corner=0.3, near=("Sofas", "CoffeeTables"), chance=0.6)
    for askew, anchor in ((_CORNER_ASKEW_RAD, "corner"), (0.0, "wall")):
        chair = Member(kind, size, askew=askew)
        members = [chair]
        if setting.allows("Ottomans") and setting.chance(0.5):
            members.append(_before(setting, "Ottomans", chair, 0.2))
        if setting.allows("FloorLamps") and setting.chance(0.4):
            lamp = setting.size("FloorLamps")
            at = (chair.body.x_max + _SOFA_SIDE_M + lamp[0] / 2, chair.body.y_min + lamp[1] / 2)
            members.append(Member("FloorLamps", lamp, at, needed=False, worth=0.3))
        zone = Zone(Box(chair.body.x_min, chair.body.y_max, chair.body.x_max, chair.body.y_max + front))
        if anchor == "corner":
            yield FurnitureGroup(tuple(members), (zone,), "corner", Taste(corner=1.0, chance=0.5))
        else:
            yield FurnitureGroup(tuple(members), (zone,), taste=near)


def television_groups(setting: RoomContext, kind: TypeName) -> Iterator[FurnitureGroup]:
    """Yields a television to try across from the sofa."""
    size = setting.size(kind)
    taste = Taste(middle=0.4, chance=0.3, facing="Sofas")
    yield FurnitureGroup((Member(kind, size),), (front_zone(size, setting.front_m(kind)),), taste=taste)


def _televisions(setting: RoomContext, sofa: Member) -> Iterator[FurnitureGroup]:
    """Yields a television with a sofa across from it, along the axis with the better view first."""
    floor, media = setting.scene.floor, setting.size("MediaStorage")
    options: list[tuple[float, float, tuple[int, ...]]] = []
    for depth, quarters in ((floor.height, (0, 2)), (floor.width, (1, 3))):
        at_wall = depth - 2 * _WALL_GAP_M - media[1] - sofa.size[1]
        floating = min(at_wall - setting.scene.way_m - 0.2, _IDEAL_VIEW_M + 0.4)
        view = at_wall if at_wall <= _VIEW_M[1] else floating
        if view >= _VIEW_M[0]:
            options.append((abs(view - _IDEAL_VIEW_M), view, quarters))
    for _, view, quarters in sorted(options):
        yield _television(setting, media, sofa, round(view, 3), quarters)


def _television(
    setting: RoomContext, media: Size, sofa: Member, view: float, quarters: tuple[int, ...]
) -> FurnitureGroup:
    """Returns a television whose group faces it at a distance of ``view``."""
    front = media[1] / 2
    seat = sofa._replace(at=(0.0, round(front + view + sofa.size[1] / 2, 3)), quarter=2)
    members = [Member("MediaStorage", media), seat, *_sofa_companions(setting, seat)]
    x = min(media[0], sofa.size[0]) / 2
    zones = (Zone(Box(-x, front, x, front + view)),)
    return FurnitureGroup(tuple(members), zones, taste=Taste(middle=0.8, away=0.3), quarters=quarters, walls_only=True)


def _sofa(setting: RoomContext, sofa: Member, taste: Taste) -> FurnitureGroup:
    """Returns a sofa with its back at a wall, a table before it, and chairs at the table's ends."""
    members = (sofa, *_sofa_companions(setting, sofa))
    return FurnitureGroup(members, (front_zone(sofa.size, setting.front_m(sofa.kind)),), taste=taste)


def _facing_sofas(setting: RoomContext, sofa: Member) -> FurnitureGroup:
    """Returns two sofas that face each other across a table, somewhere in a large room."""
    table = setting.size("CoffeeTables")
    width, depth, _ = sofa.size
    apart = table[1] + 2 * _TO_TABLE_M + depth
    members = [sofa, sofa._replace(at=(0.0, round(apart, 3)), quarter=2)]
    if setting.allows("CoffeeTables"):
        members.append(Member("CoffeeTables", table, (0.0, round(apart / 2, 3)), needed=False))
    way = setting.scene.way_m
    zone = Zone(Box(-width / 2 - way, -depth / 2 - way, width / 2 + way, apart + depth / 2 + way))
    return FurnitureGroup(tuple(members), (zone,), "center", Taste(chance=1.0))


def _sofa_companions(setting: RoomContext, sofa: Member) -> list[Member]:
    """Returns what stands around a sofa that faces +y or, turned by two quarters, -y.

    A table before it, chairs at the table's ends, a side table and a lamp beside it.
    """
    ahead = -1 if sofa.quarter == 2 else 1
    x, y, half = sofa.at[0], sofa.at[1], sofa.size[1] / 2
    found: list[Member] = []
    table = setting.size("CoffeeTables")
    middle = round(y + ahead * (half + _TO_TABLE_M + table[1] / 2), 3)
    if setting.allows("CoffeeTables"):
        found.append(Member("CoffeeTables", table, (x, middle), needed=False, worth=1.5))
    if setting.allows("EndAndSideTables"):
        found.append(_beside(setting, "EndAndSideTables", sofa, -1))
    if setting.allows("FloorLamps"):
        found.append(_beside(setting, "FloorLamps", sofa, 1))
    if setting.allows("LivingRoomChairs") and setting.room == "Living":
        chair = setting.size("LivingRoomChairs")
        aside = round(max(table[0] / 2 + _TO_TABLE_M, 0.75) + 0.1 + chair[0] / 2, 3)
        for side in (-1, 1):
            # A chair on the right faces left: a quarter turn counter-clockwise; both are turned a little to the sofa.
            askew = -side * ahead * _CHAIR_ASKEW_RAD
            at = (round(x + side * aside, 3), middle)
            found.append(Member("LivingRoomChairs", chair, at, side % 4, askew, needed=False, worth=0.6))
    return found


def _beside(setting: RoomContext, kind: str, sofa: Member, side: int) -> Member:
    """Returns something small in line with a sofa's back, on one side of it."""
    size = setting.size(kind)
    back = -1 if sofa.quarter == 0 else 1
    aside = sofa.size[0] / 2 + _SOFA_SIDE_M + size[0] / 2
    at = (round(sofa.at[0] + side * aside, 3), round(sofa.at[1] + back * (sofa.size[1] - size[1]) / 2, 3))
    return Member(kind, size, at, sofa.quarter, needed=False, worth=0.3)


def _before(setting: RoomContext, kind: str, owner: Member, gap_m: float) -> Member:
    size = setting.size(kind)
    return Member(kind, size, (0.0, round(owner.body.y_max + gap_m + size[1] / 2, 3)), needed=False, worth=0.4)


_MAKERS: dict[GroupName, GroupMaker] = {
    "single": single_groups,
    "storage": storage_groups,
    "bed": bed_groups,
    "desk": desk_groups,
    "dining table": table_groups,
    "sofa": sofa_groups,
    "armchair": armchair_groups,
    "television": television_groups,
    "kitchen row": unit_groups,
    "laundry": laundry_groups,
}


def groups_to_try(setting: RoomContext, kind: TypeName) -> Iterator[FurnitureGroup]:
    """Yields the groups to try for a type, the most welcome first."""
    yield from _MAKERS[CATALOGUE[kind].group](setting, kind)
