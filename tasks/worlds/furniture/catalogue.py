"""The catalogue of all furniture types, collected from the families, and the primitives of a piece."""

from functools import lru_cache

from tasks.worlds.furniture import bathroom, beds_and_lamps, cabinets, kitchen, seats, shelves, tables
from tasks.worlds.furniture.furniture_type import FurnitureType, TypeName
from tasks.worlds.furniture.primitives import Primitive, Size, Style

# The order decides which of two types comes first that have the same place in a programme or stand in one kitchen row.
# Seeded draws follow it: a new family comes last.
_FAMILIES = (kitchen, bathroom, beds_and_lamps, tables, cabinets, shelves, seats)
CATALOGUE: dict[TypeName, FurnitureType] = {each.name: each for family in _FAMILIES for each in family.TYPES}


@lru_cache(maxsize=4096)
def compose(kind: TypeName, size: Size, style: Style) -> tuple[Primitive, ...]:
    """Returns the primitives of a piece, in its own frame; homes share sizes, so most have been made before."""
    return CATALOGUE[kind].shape(size, style)
