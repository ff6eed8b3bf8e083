"""What a room of each type is furnished with when the template leaves it open."""

from dataclasses import dataclass

import numpy as np

from specs.world import RoomType
from tasks.worlds.catalogue import CATALOGUE, ModelType


@dataclass(frozen=True)
class Programme:
    """What belongs into a room.

    Attributes:
        essential: What makes it that room, in order; of several in one place, one is drawn.
        likely: What most such rooms have, and for how much floor there is one (square metres).
        also: What some have, likewise.
    """

    essential: tuple[tuple[ModelType, ...], ...]
    likely: dict[ModelType, float]
    also: dict[ModelType, float]


PROGRAMMES: dict[RoomType, Programme] = {
    "Bedroom": Programme(
        (("Beds",), ("Storage",)),
        {"Dressers": 18.0, "Desks": 22.0, "LivingRoomChairs": 14.0, "FloorLamps": 16.0, "Storage": 9.0},
        {"Bookcases": 14.0, "StorageBenches": 22.0, "Ottomans": 24.0, "Beds": 24.0, "Sofas": 45.0},
    ),
    "Bathroom": Programme(
        (("Toilets",), ("VanityCounters",), ("Showers", "Baths")),
        {"Baths": 18.0, "Showers": 14.0, "WashingMachinesAndDryers": 9.0, "Storage": 8.0},
        {"CornerCabinets": 30.0, "VanityCounters": 9.0, "Toilets": 14.0, "StorageBenches": 12.0, "Ottomans": 30.0},
    ),
    "Living": Programme(
        (("Sofas",), ("MediaStorage",)),
        {
            "LivingRoomChairs": 9.0,
            "Bookcases": 8.0,
            "SideboardsAndBuffets": 16.0,
            "FloorLamps": 12.0,
            "Ottomans": 14.0,
        },
        {
            "ConsoleTables": 18.0,
            "DiningTables": 32.0,
            "Desks": 30.0,
            "BarCabinets": 28.0,
            "Sofas": 20.0,
            "StorageBenches": 26.0,
            "Storage": 16.0,
        },
    ),
    "Dining": Programme(
        (("DiningTables",), ("SideboardsAndBuffets",)),
        {"BarCabinets": 16.0, "CornerCabinets": 20.0, "FloorLamps": 12.0, "ServingCarts": 16.0},
        {
            "ConsoleTables": 14.0,
            "DiningTables": 18.0,
            "Bookcases": 9.0,
            "SideboardsAndBuffets": 12.0,
            "LivingRoomChairs": 12.0,
            "StorageBenches": 16.0,
            "Storage": 12.0,
        },
    ),
    "Kitchen": Programme(
        (("Ovens",), ("DishWashers",), ("Fridges",)),
        {"DiningTables": 20.0, "KitchenIslandsAndCarts": 20.0, "Storage": 9.0},
        {
            "ServingCarts": 20.0,
            "WashingMachinesAndDryers": 18.0,
            "SideboardsAndBuffets": 14.0,
            "BarCabinets": 24.0,
            "Fridges": 26.0,
            "Ovens": 18.0,
            "DishWashers": 18.0,
            "Bookcases": 20.0,
        },
    ),
    "Hallway": Programme(
        (("ConsoleTables", "StorageBenches"), ("Storage",)),
        {"StorageBenches": 9.0, "ConsoleTables": 10.0, "FloorLamps": 10.0, "Storage": 6.0},
        {"Bookcases": 7.0, "Dressers": 12.0, "SideboardsAndBuffets": 12.0, "LivingRoomChairs": 14.0, "Ottomans": 12.0},
    ),
    "Closet": Programme(
        (("Storage",),),
        {"Storage": 2.5, "Dressers": 9.0},
        {"StorageBenches": 12.0, "Bookcases": 7.0, "WashingMachinesAndDryers": 12.0, "Ottomans": 20.0},
    ),
}  # fmt: skip

# A list is an explicit wish: more of the same is welcome than the programme would have.
_LISTED_SHARE = 0.5


def open_programme(rng: np.random.Generator, room: RoomType) -> tuple[list[ModelType], dict[ModelType, float]]:
    """Returns what to try first, in order, and what next, with the floor for which there is one (square metres)."""
    programme = PROGRAMMES[room]
    first = [choice[int(rng.integers(len(choice)))] for choice in programme.essential]
    rest = {kind: tier[kind] for tier in (programme.likely, programme.also) for kind in _shuffled(rng, tier)}
    return first, rest


def listed_programme(
    rng: np.random.Generator, room: RoomType, listed: tuple[ModelType, ...]
) -> tuple[list[ModelType], dict[ModelType, float]]:
    """Returns the same of a template's list: what makes the room first, then each type by chance."""
    kinds = tuple(dict.fromkeys(kind for kind in listed if kind in CATALOGUE))
    essential = dict.fromkeys(kind for choice in PROGRAMMES[room].essential for kind in choice if kind in kinds)
    others = _shuffled(rng, tuple(kind for kind in kinds if kind not in essential))
    return [*essential, *others], {kind: _LISTED_SHARE * CATALOGUE[kind].spread_m2 for kind in _shuffled(rng, kinds)}


def _shuffled(rng: np.random.Generator, kinds: tuple[ModelType, ...] | dict[ModelType, float]) -> list[ModelType]:
    names = tuple(kinds)
    return [names[place] for place in np.argsort(rng.random(len(names)), kind="stable").tolist()]
