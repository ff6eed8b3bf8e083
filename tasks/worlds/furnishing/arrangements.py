"""The groups to try for a furniture type: which pieces are placed together, and where they may stand."""

from collections.abc import Callable, Iterator

from tasks.worlds.furnishing.groups.bedroom_groups import bed_groups, desk_groups
from tasks.worlds.furnishing.groups.dining_groups import table_groups
from tasks.worlds.furnishing.groups.group import FurnitureGroup
from tasks.worlds.furnishing.groups.kitchen_groups import laundry_groups, unit_groups
from tasks.worlds.furnishing.groups.living_groups import armchair_groups, sofa_groups, television_groups
from tasks.worlds.furnishing.groups.single_groups import single_groups, storage_groups
from tasks.worlds.furnishing.room_context import RoomContext
from tasks.worlds.furniture.catalogue import CATALOGUE
from tasks.worlds.furniture.furniture_type import GroupName, TypeName

GroupMaker = Callable[[RoomContext, TypeName], Iterator[FurnitureGroup]]
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
