"""The 31 furniture types: how large they are, how they stand, and how much floor their use needs.

Where the figures come from (metres):

- Kitchens: EN 1116 co-ordinates units to widths in steps of 0.1, 0.6 for appliances, 0.6 deep, worktops at 0.85 or 0.9.
- Beds: European mattresses are 0.9, 1.4, 1.6 or 1.8 wide and 2.0 long; the frame adds 0.05 on each side.
- Baths are 1.7 x 0.7 or 0.75 (EN 232), shower trays 0.8 to 1.2 x 0.8 or 0.9 (EN 251), pans about 0.4 x 0.7 (EN 33).
- Desks are 0.74 high (EN 527-1), with 1.0 behind them for the chair; dining tables 0.75, seats 0.46.
- Neufert, Architects' Data: 0.6 of table edge for each diner, 0.75 from the edge to rise from a chair; 0.6 before a
  toilet, 0.75 before a washbasin; 0.6 beside a bed; 0.6 before a cupboard, 0.9 before a wardrobe or an oven whose
  door is open; 1.2 between two rows of kitchen units; passages of 0.6 for one person, 0.9 for comfort.
- Seating: 0.6 to 0.7 of width for each seat, 0.3 to 0.45 from a sofa to its table.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

from tasks.worlds.furniture.primitives import Range, Size

Anchor = Literal["wall", "corner", "center"]
ModelType = str
STEP_M = 0.05
"""Sizes are drawn in steps of this: shops do not sell tables of 1.37 m, and homes share what is made of them."""


@dataclass(frozen=True)
class Variant:
    """A usual size of a type.

    Attributes:
        width_m: Least and greatest extent along its back.
        depth_m: Least and greatest extent from its back to its front.
        height_m: Least and greatest height, with what stands on it.
        room_m2: Least and greatest area of the rooms in which it is usual.
    """

    width_m: Range
    depth_m: Range
    height_m: Range
    room_m2: Range = (0.0, 1e9)

    @cached_property
    def sizes(self) -> tuple[tuple[float, ...], ...]:
        """The widths, depths and heights to draw from."""
        return tuple(
            tuple(round(low + n * STEP_M, 2) for n in range(round((high - low) / STEP_M) + 1))
            for low, high in (self.width_m, self.depth_m, self.height_m)
        )


@dataclass(frozen=True)
class Model:
    """One type of furniture.

    Attributes:
        variants: Its usual sizes, smallest first.
        front_m: Floor kept free before it, or around it when it stands in the middle of a room.
        anchor: Where it stands by itself.
        under_window: Whether it belongs under a window, however high it is.
        row: Whether it stands flush beside others of a row, as kitchen units do.
        spread_m2: A room holds one for so much floor, at most; but always one.
    """

    variants: tuple[Variant, ...]
    front_m: float = 0.6
    anchor: Anchor = "wall"
    under_window: bool = False
    row: bool = False
    spread_m2: float = 8.0

    def usual(self, room_m2: float) -> tuple[Variant, ...]:
        """Returns the sizes that are usual in a room of that area, smallest first."""
        found = tuple(each for each in self.variants if each.room_m2[0] <= room_m2 <= each.room_m2[1])
        return found or self.variants[:1]

    def holds(self, size: Size) -> bool:
        """Returns whether a size is one of this type's."""
        return any(
            size[0] in widths and size[1] in (depths if depths[0] else size[:1]) and size[2] in heights
            for widths, depths, heights in (variant.sizes for variant in self.variants)
        )


_HALLS = (50.0, 1e9)


def _one(width: Range, depth: Range, height: Range) -> tuple[Variant, ...]:
    return (Variant(width, depth, height),)


def _and_long(width: Range, depth: Range, height: Range, long: Range) -> tuple[Variant, ...]:
    """Returns a usual size, and a longer one for rooms the size of a hall."""
    return Variant(width, depth, height), Variant(long, depth, height, _HALLS)


CATALOGUE: dict[ModelType, Model] = {
    "Baths": Model(_one((1.6, 1.8), (0.7, 0.8), (0.75, 0.75)), 0.7, "corner", under_window=True, spread_m2=14.0),
    "BarCabinets": Model(_and_long((0.8, 1.2), (0.4, 0.45), (1.2, 1.35), (1.6, 2.0)), spread_m2=12.0),
    "Beds": Model(
        (
            Variant((1.0, 1.0), (2.1, 2.1), (0.85, 1.0)),
            Variant((1.5, 1.5), (2.1, 2.1), (0.95, 1.1), (11.0, 1e9)),
            Variant((1.7, 1.7), (2.1, 2.1), (0.95, 1.1), (12.0, 1e9)),
            Variant((1.9, 1.9), (2.1, 2.1), (0.95, 1.1), (15.0, 1e9)),
        ),
        0.7,
        under_window=True,
        spread_m2=14.0,
    ),
    "Bookcases": Model(_and_long((0.8, 1.2), (0.3, 0.35), (1.8, 2.0), (1.6, 2.0)), 0.6, row=True, spread_m2=5.0),
    "CoffeeTables": Model(
        (Variant((0.7, 0.9), (0.0, 0.0), (0.4, 0.45)), Variant((0.9, 1.2), (0.5, 0.6), (0.4, 0.45))),
        0.45,
        "center",
        spread_m2=8.0,
    ),
    "ConsoleTables": Model(_and_long((0.9, 1.3), (0.3, 0.4), (1.0, 1.05), (1.6, 2.0)), 0.6, spread_m2=8.0),
    "CornerCabinets": Model(_one((0.8, 0.9), (0.8, 0.9), (1.7, 1.9)), 0.5, "corner", spread_m2=12.0),
    "DeskChairs": Model(_one((0.6, 0.65), (0.6, 0.65), (0.9, 1.0)), 0.4, spread_m2=6.0),
    "Desks": Model(_and_long((1.2, 1.6), (0.65, 0.8), (1.2, 1.2), (1.8, 2.0)), 1.0, under_window=True, spread_m2=10.0),
    "DiningChairs": Model(_one((0.45, 0.45), (0.5, 0.5), (0.85, 0.95)), 0.4, spread_m2=2.5),
    "DiningTables": Model(
        (
            Variant((0.8, 0.8), (0.0, 0.0), (0.75, 0.75), (0.0, 16.0)),
            Variant((1.0, 1.2), (0.0, 0.0), (0.75, 0.75), (12.0, 1e9)),
            Variant((1.2, 1.4), (0.8, 0.85), (0.75, 0.75)),
            Variant((1.6, 1.8), (0.9, 0.95), (0.75, 0.75), (14.0, 1e9)),
            Variant((2.0, 2.2), (0.95, 1.0), (0.75, 0.75), (22.0, 1e9)),
            Variant((2.4, 2.8), (1.1, 1.2), (0.75, 0.75), _HALLS),
        ),
        0.8,
        "center",
        spread_m2=11.0,
    ),
    "DishWashers": Model(
        (Variant((0.6, 0.6), (0.6, 0.6), (0.9, 0.9)), Variant((1.2, 1.4), (0.6, 0.6), (1.15, 1.15), (10.0, 1e9))),
        0.9,
        under_window=True,
        row=True,
        spread_m2=14.0,
    ),
    "Dressers": Model(_and_long((0.8, 1.4), (0.45, 0.5), (0.8, 1.0), (1.6, 1.8)), 0.7, spread_m2=8.0),
    "EndAndSideTables": Model(_one((0.4, 0.5), (0.0, 0.0), (0.5, 0.6)), 0.2, spread_m2=4.0),
    "FloorLamps": Model(_one((0.35, 0.4), (0.0, 0.0), (1.5, 1.7)), 0.1, "corner", spread_m2=6.0),
    "Fridges": Model(
        (
            Variant((0.6, 0.7), (0.65, 0.65), (1.75, 1.85)),
            Variant((0.9, 0.9), (0.7, 0.7), (1.8, 1.8), (18.0, 1e9)),
        ),
        0.9,
        row=True,
        spread_m2=16.0,
    ),
    "KitchenIslandsAndCarts": Model(
        (
            Variant((0.8, 0.9), (0.5, 0.5), (0.9, 0.9), (0.0, 18.0)),
            Variant((1.2, 1.8), (0.8, 1.0), (0.9, 0.9), (13.0, 1e9)),
            Variant((2.0, 2.4), (1.0, 1.2), (0.9, 0.9), _HALLS),
        ),
        0.9,
        "center",
        spread_m2=14.0,
    ),
    "LivingRoomChairs": Model(_one((0.75, 0.85), (0.75, 0.85), (0.8, 0.95)), 0.5, spread_m2=5.0),
    "MediaStorage": Model(_one((1.2, 1.8), (0.4, 0.45), (1.2, 1.25)), 0.8, spread_m2=16.0),
    "Nightstands": Model(_one((0.4, 0.5), (0.35, 0.4), (0.5, 0.6)), 0.3, spread_m2=5.0),
    "Ottomans": Model(_one((0.5, 0.6), (0.0, 0.0), (0.4, 0.45)), 0.3, spread_m2=5.0),
    "Ovens": Model(
        (Variant((0.6, 0.6), (0.6, 0.6), (0.92, 0.92)), Variant((1.2, 1.4), (0.6, 0.6), (0.92, 0.92), (10.0, 1e9))),
        0.9,
        row=True,
        spread_m2=14.0,
    ),
    "ServingCarts": Model(_one((0.7, 0.9), (0.4, 0.45), (0.95, 1.05)), 0.4, spread_m2=10.0),
    "Showers": Model(
        (
            Variant((0.8, 0.9), (0.8, 0.9), (2.0, 2.1)),
            Variant((1.0, 1.2), (0.9, 0.9), (2.0, 2.1), (9.0, 1e9)),
        ),
        0.7,
        "corner",
        row=True,
        spread_m2=10.0,
    ),
    "SideboardsAndBuffets": Model(_and_long((1.2, 1.8), (0.4, 0.5), (0.9, 0.95), (2.0, 2.4)), 0.7, spread_m2=9.0),
    "Sofas": Model(
        (
            Variant((1.6, 1.7), (0.85, 0.9), (0.8, 0.85)),
            Variant((2.0, 2.3), (0.9, 0.95), (0.8, 0.85), (14.0, 1e9)),
            Variant((2.5, 2.7), (0.95, 1.0), (0.8, 0.85), (26.0, 1e9)),
        ),
        0.8,
        under_window=True,
        spread_m2=11.0,
    ),
    "Storage": Model(
        (
            Variant((0.8, 1.2), (0.35, 0.4), (1.8, 2.0)),
            Variant((0.8, 1.2), (0.45, 0.5), (1.8, 2.0)),
            Variant((0.6, 0.6), (0.6, 0.6), (2.0, 2.1)),
            Variant((1.0, 1.0), (0.6, 0.6), (2.0, 2.1)),
            Variant((1.5, 1.5), (0.6, 0.6), (2.0, 2.1)),
            Variant((2.0, 2.0), (0.6, 0.6), (2.0, 2.1), (14.0, 1e9)),
        ),
        0.8,
        row=True,
        spread_m2=3.0,
    ),
    "StorageBenches": Model(
        _and_long((0.9, 1.3), (0.4, 0.45), (0.45, 0.5), (1.6, 2.0)), 0.5, under_window=True, spread_m2=6.0
    ),
    "Toilets": Model(_one((0.4, 0.4), (0.7, 0.7), (0.8, 0.8)), 0.6, spread_m2=9.0),
    "VanityCounters": Model(
        (
            Variant((0.6, 0.8), (0.45, 0.5), (1.8, 1.9)),
            Variant((0.9, 1.1), (0.5, 0.55), (1.8, 1.9), (8.0, 1e9)),
            Variant((1.2, 1.6), (0.5, 0.55), (1.8, 1.9), (12.0, 1e9)),
            Variant((1.8, 2.2), (0.55, 0.6), (1.8, 1.9), _HALLS),
        ),
        0.75,
        row=True,
        spread_m2=8.0,
    ),
    "WashingMachinesAndDryers": Model(
        (Variant((0.6, 0.6), (0.6, 0.6), (0.85, 0.85)), Variant((0.6, 0.6), (0.6, 0.6), (1.7, 1.7))),
        0.8,
        row=True,
        spread_m2=6.0,
    ),
}  # fmt: skip
"""A depth of 0 means as deep as wide."""
