"""Kitchen units in a row under one worktop, and the island before it."""

from collections.abc import Iterator

from tasks.worlds.furnishing.groups.group import FurnitureGroup, Member, Zone, front_zone
from tasks.worlds.furnishing.groups.single_groups import single_groups
from tasks.worlds.furnishing.room_context import RoomContext
from tasks.worlds.furniture.catalogue import CATALOGUE
from tasks.worlds.furniture.furniture_type import Taste, TypeName
from tasks.worlds.furniture.primitives import Size
from tasks.worlds.geometry.boxes import Box

ROW = tuple(kind for kind, each in CATALOGUE.items() if each.group in ("kitchen row", "laundry"))
"""What stands in a row, from its tall end on: the catalogue's order."""
_AISLE_M = 1.1
_LARDER: Size = (0.6, 0.6, 2.0)


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
