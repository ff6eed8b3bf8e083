"""Sofas with what stands around them, armchairs, and the television across from them."""

from collections.abc import Iterator

from tasks.worlds.furnishing.groups.group import FurnitureGroup, Member, Zone, front_zone
from tasks.worlds.furnishing.room_context import RoomContext
from tasks.worlds.furniture.furniture_type import Taste, TypeName
from tasks.worlds.furniture.primitives import Size
from tasks.worlds.geometry.boxes import Box

_TO_TABLE_M = 0.4
_BESIDE_M = 0.08
_WALL_GAP_M = 0.02
_VIEW_M = (1.7, 4.2)  # from a sofa's front to the screen; beyond it the sofa comes away from its wall
_IDEAL_VIEW_M = 2.6
_CHAIR_ASKEW_RAD = 0.25
_CORNER_ASKEW_RAD = -0.6


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
            at = (chair.body.x_max + _BESIDE_M + lamp[0] / 2, chair.body.y_min + lamp[1] / 2)
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
    aside = sofa.size[0] / 2 + _BESIDE_M + size[0] / 2
    at = (round(sofa.at[0] + side * aside, 3), round(sofa.at[1] + back * (sofa.size[1] - size[1]) / 2, 3))
    return Member(kind, size, at, sofa.quarter, needed=False, worth=0.3)


def _before(setting: RoomContext, kind: str, owner: Member, gap_m: float) -> Member:
    size = setting.size(kind)
    return Member(kind, size, (0.0, round(owner.body.y_max + gap_m + size[1] / 2, 3)), needed=False, worth=0.4)
