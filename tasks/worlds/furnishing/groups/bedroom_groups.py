"""Beds with their nightstands, and desks with their chairs."""

from collections.abc import Iterator

from tasks.worlds.furnishing.groups.group import FurnitureGroup, Member, Zone, front_zone
from tasks.worlds.furnishing.room_context import RoomContext
from tasks.worlds.furniture.catalogue import CATALOGUE
from tasks.worlds.furniture.furniture_type import Taste, TypeName
from tasks.worlds.furniture.primitives import Size
from tasks.worlds.geometry.boxes import Box

_BESIDE_M = 0.6
_HEAD_M = 0.5
_NIGHTSTAND_GAP_M = 0.05
_BENCH_GAP_M = 0.05
_DOUBLE_M = 1.3
_TUCK_M = 0.22
_RISE_M = 1.0
_MOST_OF_SPARE = 0.95
_BED = Taste(middle=0.8, window=0.2, away=0.6)
_BED_IN_CORNER = Taste(corner=0.8, window=0.3, away=0.5)


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
        Zone(Box(min(side * x, side * (x + _BESIDE_M)), _HEAD_M - y, max(side * x, side * (x + _BESIDE_M)), y))
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
            tuple(members), (_chair_zone(setting, size),), taste=Taste(corner=0.3, window=1.0, away=0.2)
        )


def _desk_chair(setting: RoomContext, desk: Size) -> Member:
    size = setting.size("DeskChairs", CATALOGUE["DeskChairs"].variants[0])
    knees = -0.17  # the middle between the desk's legs and its drawers
    return Member("DeskChairs", size, (knees, desk[1] / 2 + size[1] / 2 - _TUCK_M), 2, under=_TUCK_M)


def _chair_zone(setting: RoomContext, desk: Size) -> Zone:
    return front_zone(desk, max(_RISE_M, setting.scene.way_m))
