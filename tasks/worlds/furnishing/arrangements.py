"""What is put into a room together with a piece of each type, and where that likes to stand."""

from collections.abc import Callable, Iterator

from tasks.worlds.furnishing.groups.bedroom_groups import bed_groups, desk_groups
from tasks.worlds.furnishing.groups.dining_groups import table_groups
from tasks.worlds.furnishing.groups.group import Group, Member, Taste, Zone, front_zone
from tasks.worlds.furnishing.groups.kitchen_groups import ROW, unit_groups
from tasks.worlds.furnishing.groups.living_groups import armchair_groups, media_groups, sofa_groups
from tasks.worlds.furnishing.room_context import Setting
from tasks.worlds.furniture.catalogue import CATALOGUE, ModelType
from tasks.worlds.furniture.primitives import Size
from tasks.worlds.geometry.boxes import Box

_AROUND_M = 0.45
_TOILET_WIDTH_M = 0.85
# Depth of what may stand in a hallway narrower than this, where the way is what matters.
_HALL_DEPTH_M = 0.45
_HALL_WIDE_M = 2.6
_HALL_M2 = 50.0
_MUCH_SPARE = 0.2

_SPECIAL: dict[ModelType, Callable[[Setting], Iterator[Group]]] = {
    "Beds": bed_groups,
    "Desks": desk_groups,
    "DiningTables": table_groups,
    "Sofas": sofa_groups,
    "LivingRoomChairs": armchair_groups,
    "MediaStorage": media_groups,
}
_TASTES: dict[ModelType, Taste] = {
    "Baths": Taste(corner=1.0, window=0.3, away=0.4),
    "BarCabinets": Taste(corner=0.3, near=("DiningTables", "Sofas")),
    "Bookcases": Taste(corner=0.6),
    "CoffeeTables": Taste(near=("Sofas",), middle=0.3),
    "ConsoleTables": Taste(middle=0.4, chance=0.5, apart=True),
    "CornerCabinets": Taste(corner=1.0),
    "DeskChairs": Taste(near=("Desks",), chance=0.6),
    "DiningChairs": Taste(near=("DiningTables",), corner=0.3, chance=0.6),
    "Dressers": Taste(middle=0.3, near=("Beds",), chance=0.5),
    "EndAndSideTables": Taste(near=("Sofas", "LivingRoomChairs", "Beds"), corner=0.4),
    "FloorLamps": Taste(corner=1.0, near=("Sofas", "LivingRoomChairs", "Desks"), apart=True),
    "KitchenIslandsAndCarts": Taste(middle=0.8),
    "Nightstands": Taste(near=("Beds",), corner=0.3),
    "Ottomans": Taste(near=("LivingRoomChairs", "Sofas"), chance=0.4, apart=True),
    "ServingCarts": Taste(corner=0.3, near=("DiningTables",)),
    "Showers": Taste(corner=1.0, away=0.4),
    "SideboardsAndBuffets": Taste(middle=0.5, near=("DiningTables",)),
    "Storage": Taste(corner=0.9, away=0.1),
    "StorageBenches": Taste(middle=0.2, window=0.4, chance=0.5),
    "Toilets": Taste(corner=0.5, away=0.4, near=("Showers", "Baths", "Toilets")),
    "VanityCounters": Taste(corner=0.2, near=("Toilets", "VanityCounters")),
}  # fmt: skip


def arrangements(setting: Setting, kind: ModelType) -> Iterator[Group]:
    """Yields the groups to try for a type, the most welcome first."""
    if kind in _SPECIAL:
        yield from _SPECIAL[kind](setting)
    elif kind in ROW and (kind != "WashingMachinesAndDryers" or setting.room == "Kitchen"):
        yield from unit_groups(setting, kind)
    else:
        for size in dict.fromkeys(_sizes(setting, kind)):
            yield alone(setting, kind, size)


def alone(setting: Setting, kind: ModelType, size: Size) -> Group:
    """Returns a group of one piece."""
    model = CATALOGUE[kind]
    front = setting.front_m(kind)
    if model.anchor == "center":
        around = max(_AROUND_M, setting.scene.way_m)
        x, y = size[0] / 2 + around, size[1] / 2 + around
        return Group((Member(kind, size),), (Zone(Box(-x, -y, x, y)),), "center", _TASTES[kind])
    aside = max(_TOILET_WIDTH_M - size[0], 0.0) / 2 if kind == "Toilets" else 0.0
    zones = [front_zone(size, front)]
    if aside:
        zones.append(Zone(Box(-size[0] / 2 - aside, -size[1] / 2, size[0] / 2 + aside, size[1] / 2)))
    taste = _TASTES.get(kind, Taste())
    return Group((Member(kind, size),), tuple(zones), model.anchor, taste, flush=model.row)


def _sizes(setting: Setting, kind: ModelType) -> list[Size]:
    """Returns the sizes to try for one piece by itself, and its least."""
    if kind == "Storage":
        return _storage_sizes(setting)
    sizes = setting.sizes(kind)
    if setting.room == "Hallway" and not _wide(setting):
        sizes = [size for size in sizes if size[1] <= _HALL_DEPTH_M] or sizes
    return [*sizes[:2], setting.smallest(kind)]


def _storage_sizes(setting: Setting) -> list[Size]:
    """Returns wardrobes for bedrooms, shelving for closets, larders for kitchens, shallow cabinets for the rest."""
    hall, shelves, larder, *wardrobes = CATALOGUE["Storage"].usual(setting.area_m2)
    # Open shelving is shallow: a closet that shall be full, or is a hall, is lined with wardrobes first.
    deep = setting.spare_m2 > _MUCH_SPARE * setting.area_m2 or setting.area_m2 > _HALL_M2 or setting.chance(0.5)
    wanted = {
        "Bedroom": [*reversed(wardrobes)],
        "Closet": [*reversed(wardrobes)] if deep else [shelves, wardrobes[0]],
        "Kitchen": [larder],
        "Living": [wardrobes[0], hall],
        "Dining": [hall],
        "Hallway": [wardrobes[0], hall] if _wide(setting) else [hall],
        "Bathroom": [hall],
    }[setting.room]
    if setting.chance(0.4) and len(wanted) > 2:
        wanted = wanted[1:]
    return [setting.size("Storage", variant) for variant in (*wanted, larder if setting.room == "Bedroom" else hall)]


def _wide(setting: Setting) -> bool:
    floor = setting.scene.floor
    return min(floor.width, floor.height) >= _HALL_WIDE_M
