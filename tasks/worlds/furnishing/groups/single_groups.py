"""Single pieces: the sizes to try, and the floor that the use of one needs."""

from collections.abc import Iterator

from tasks.worlds.furnishing.groups.group import FurnitureGroup, Member, Zone, front_zone
from tasks.worlds.furnishing.room_context import RoomContext
from tasks.worlds.furniture.catalogue import CATALOGUE
from tasks.worlds.furniture.furniture_type import TypeName
from tasks.worlds.furniture.primitives import Size
from tasks.worlds.geometry.boxes import Box

_AROUND_M = 0.45
# Depth of what may stand in a hallway narrower than this, where the way is what matters.
_HALL_DEPTH_M = 0.45
_HALL_WIDE_M = 2.6
_HALL_M2 = 50.0
_MUCH_SPARE = 0.2


def single_groups(setting: RoomContext, kind: TypeName) -> Iterator[FurnitureGroup]:
    """Yields one piece in each size to try, and in its least."""
    sizes = setting.sizes(kind)
    if setting.room == "Hallway" and not _wide(setting):
        sizes = [size for size in sizes if size[1] <= _HALL_DEPTH_M] or sizes
    for size in dict.fromkeys([*sizes[:2], setting.smallest(kind)]):
        yield _single(setting, kind, size)


def storage_groups(setting: RoomContext, kind: TypeName) -> Iterator[FurnitureGroup]:
    """Yields wardrobes for bedrooms, shelving for closets, larders for kitchens, shallow cabinets for the rest."""
    for size in dict.fromkeys(_storage_sizes(setting, kind)):
        yield _single(setting, kind, size)


def _single(setting: RoomContext, kind: TypeName, size: Size) -> FurnitureGroup:
    """Returns a group of one piece."""
    model, members = CATALOGUE[kind], (Member(kind, size),)
    x, y = size[0] / 2, size[1] / 2
    if model.anchor == "center":
        around = max(_AROUND_M, setting.scene.way_m)
        zone = Zone(Box(-x - around, -y - around, x + around, y + around))
        return FurnitureGroup(members, (zone,), model.anchor, model.taste)
    zones = [front_zone(size, setting.front_m(kind))]
    aside = max(model.use_width_m - size[0], 0.0) / 2
    if aside:
        zones.append(Zone(Box(-x - aside, -y, x + aside, y)))
    return FurnitureGroup(members, tuple(zones), model.anchor, model.taste, flush=model.row)


def _storage_sizes(setting: RoomContext, kind: TypeName) -> list[Size]:
    """Returns the sizes to try, the most welcome first, then one that fits nearly everywhere.

    The variants are, in order, a hall cabinet, open shelving, a larder, and wardrobes.
    """
    hall, shelves, larder, *wardrobes = CATALOGUE[kind].usual(setting.area_m2)
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
    return [setting.size(kind, variant) for variant in (*wanted, larder if setting.room == "Bedroom" else hall)]


def _wide(setting: RoomContext) -> bool:
    floor = setting.scene.floor
    return min(floor.width, floor.height) >= _HALL_WIDE_M
