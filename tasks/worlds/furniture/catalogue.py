"""The catalogue of all furniture types, collected from the families, and what each room type has by default."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import get_args

import numpy as np

from specs.data.world import RoomType
from tasks.worlds.furniture import bathroom, beds_and_lamps, cabinets, kitchen, seats, shelves, tables
from tasks.worlds.furniture.furniture_type import FurnitureType, Primitive, RoomUse, Size, Style, Tier, TypeName

# The order decides which of two types comes first that have one place in a room's defaults or stand in one kitchen row.
# Seeded draws follow it: a new family comes last.
_FAMILIES = (kitchen, bathroom, beds_and_lamps, tables, cabinets, shelves, seats)
CATALOGUE: dict[TypeName, FurnitureType] = {each.name: each for family in _FAMILIES for each in family.TYPES}
# A list is an explicit wish: more of the same is welcome than the defaults would have.
_LISTED_SHARE = 0.5


@lru_cache(maxsize=4096)
def compose(kind: TypeName, size: Size, style: Style) -> tuple[Primitive, ...]:
    """Returns the primitives of a piece, in its own frame; homes share sizes, so most have been made before."""
    return CATALOGUE[kind].shape(size, style)


@dataclass(frozen=True)
class RoomDefaults:
    """What belongs into a room.

    Attributes:
        essential: What makes it that room, in order; of several in one place, one is drawn.
        likely: What most such rooms have, and for how much floor there is one (square metres).
        occasional: What some have, likewise.
    """

    essential: tuple[tuple[TypeName, ...], ...]
    likely: dict[TypeName, float]
    occasional: dict[TypeName, float]


def room_defaults_of(room: RoomType) -> RoomDefaults:
    """Returns the defaults that the catalogue gives a type of room."""
    places: dict[int, list[TypeName]] = {}
    for kind, use in _uses(room, "essential"):
        places.setdefault(use.place, []).append(kind)
    likely, occasional = ({kind: use.floor_m2 for kind, use in _uses(room, tier)} for tier in ("likely", "occasional"))
    return RoomDefaults(tuple(map(tuple, places.values())), likely, occasional)


def _uses(room: RoomType, tier: Tier) -> list[tuple[TypeName, RoomUse]]:
    """Returns a room type's furniture of one tier by its places, and in the catalogue's order within a place."""
    found = [
        (kind, use) for kind, model in CATALOGUE.items() for use in model.rooms if (use.room, use.tier) == (room, tier)
    ]
    return sorted(found, key=lambda each: each[1].place)


ROOM_DEFAULTS: dict[RoomType, RoomDefaults] = {room: room_defaults_of(room) for room in get_args(RoomType)}


def draw_usual_furniture(rng: np.random.Generator, room: RoomType) -> tuple[list[TypeName], dict[TypeName, float]]:
    """Returns what to try first, in order, and what next, with the floor for which there is one (square metres)."""
    defaults = ROOM_DEFAULTS[room]
    first = [choice[int(rng.integers(len(choice)))] for choice in defaults.essential]
    rest = {kind: tier[kind] for tier in (defaults.likely, defaults.occasional) for kind in _shuffle(rng, tier)}
    return first, rest


def draw_listed_furniture(
    rng: np.random.Generator, room: RoomType, listed: tuple[TypeName, ...]
) -> tuple[list[TypeName], dict[TypeName, float]]:
    """Returns what to try first and next of a template's list: what makes the room first, then each type by chance."""
    kinds = tuple(dict.fromkeys(kind for kind in listed if kind in CATALOGUE))
    essential = dict.fromkeys(kind for choice in ROOM_DEFAULTS[room].essential for kind in choice if kind in kinds)
    others = _shuffle(rng, tuple(kind for kind in kinds if kind not in essential))
    return [*essential, *others], {kind: _LISTED_SHARE * CATALOGUE[kind].spread_m2 for kind in _shuffle(rng, kinds)}


def _shuffle(rng: np.random.Generator, kinds: Iterable[TypeName]) -> list[TypeName]:
    names = tuple(kinds)
    return [names[place] for place in np.argsort(rng.random(len(names)), kind="stable").tolist()]
