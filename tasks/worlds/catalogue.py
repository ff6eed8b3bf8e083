"""The 31 furniture types: how large they are, where they stand, and what is put beside them.

Sizes are what furniture shops and kitchen norms call usual (EN 1116 for kitchens: 0.6 m modules, 0.9 m worktops).
"""

from dataclasses import dataclass
from typing import Literal

Anchor = Literal["wall", "corner", "center"]
ModelType = str


@dataclass(frozen=True)
class Companion:
    """A piece that belongs to another.

    Attributes:
        type: What it is.
        side: Where it stands, seen from the owner: in front, at the back, or left and right; ``row`` is left and
            right, close to the owner's back.
        gap_m: Free floor between the two.
        turned: Quarter turns against the owner's facing.
    """

    type: ModelType
    side: Literal["front", "back", "left", "right", "row-left", "row-right"]
    gap_m: float
    turned: int


@dataclass(frozen=True)
class Model:
    """One type of furniture.

    Attributes:
        width_m: Least and greatest extent along its back.
        depth_m: Least and greatest extent from its back to its front.
        height_m: Least and greatest height.
        anchor: Where it stands by itself.
        front_m: Floor kept free before it (around it when it stands in the middle of a room).
        companions: What is put with it.
        turns: Whether it may stand a little askew.
        row: Whether it likes to stand flush beside others of its kind, as kitchen units do.
    """

    width_m: tuple[float, float]
    depth_m: tuple[float, float]
    height_m: tuple[float, float]
    anchor: Anchor = "wall"
    front_m: float = 0.5
    companions: tuple[Companion, ...] = ()
    turns: bool = False
    row: bool = False


_SEATS = (
    Companion("DiningChairs", "front", 0.03, 2),
    Companion("DiningChairs", "back", 0.03, 0),
    Companion("DiningChairs", "left", 0.03, 3),
    Companion("DiningChairs", "right", 0.03, 1),
)

CATALOGUE: dict[ModelType, Model] = {
    "Baths": Model((1.6, 1.8), (0.7, 0.8), (0.55, 0.6), "corner", 0.6),
    "BarCabinets": Model((0.8, 1.1), (0.4, 0.5), (1.0, 1.2)),
    "Beds": Model(
        (1.4, 1.8), (2.0, 2.1), (0.5, 0.55), "wall", 0.6,
        (Companion("Nightstands", "row-left", 0.04, 0), Companion("Nightstands", "row-right", 0.04, 0)),
    ),
    "Bookcases": Model((0.8, 1.2), (0.28, 0.35), (1.8, 2.0)),
    "CoffeeTables": Model((0.9, 1.2), (0.5, 0.65), (0.4, 0.45), "center", 0.6),
    "ConsoleTables": Model((0.9, 1.3), (0.3, 0.4), (0.78, 0.85)),
    "CornerCabinets": Model((0.7, 0.8), (0.7, 0.8), (1.6, 1.9), "corner"),
    "DeskChairs": Model((0.5, 0.55), (0.5, 0.55), (0.85, 0.95), "wall", 0.4, turns=True),
    "Desks": Model(
        (1.2, 1.6), (0.6, 0.75), (0.73, 0.76), "wall", 1.0, (Companion("DeskChairs", "front", 0.03, 2),)
    ),
    "DiningChairs": Model((0.42, 0.46), (0.45, 0.5), (0.85, 0.95), "wall", 0.3),
    "DiningTables": Model((1.3, 1.8), (0.8, 0.95), (0.74, 0.76), "center", 0.9, _SEATS),
    "DishWashers": Model((0.6, 0.6), (0.6, 0.6), (0.88, 0.88), "wall", 0.7, row=True),
    "Dressers": Model((0.9, 1.4), (0.45, 0.5), (0.75, 1.0), "wall", 0.6),
    "EndAndSideTables": Model((0.4, 0.5), (0.4, 0.5), (0.5, 0.6), "wall", 0.2),
    "FloorLamps": Model((0.35, 0.4), (0.35, 0.4), (1.5, 1.7), "corner", 0.1),
    "Fridges": Model((0.6, 0.75), (0.62, 0.7), (1.7, 1.85), "wall", 0.7, row=True),
    "LivingRoomChairs": Model((0.75, 0.85), (0.75, 0.85), (0.8, 0.95), "wall", 0.5, turns=True),
    "KitchenIslandsAndCarts": Model((1.1, 1.6), (0.65, 0.85), (0.9, 0.92), "center", 0.8),
    "MediaStorage": Model((1.2, 1.7), (0.4, 0.45), (0.45, 0.55), "wall", 0.7),
    "Nightstands": Model((0.4, 0.5), (0.38, 0.42), (0.5, 0.6), "wall", 0.3),
    "Ottomans": Model((0.5, 0.65), (0.5, 0.65), (0.4, 0.45), "wall", 0.3),
    "Ovens": Model((0.6, 0.6), (0.6, 0.6), (0.9, 0.9), "wall", 0.7, row=True),
    "ServingCarts": Model((0.6, 0.8), (0.4, 0.45), (0.8, 0.88), "wall", 0.3),
    "Showers": Model((0.9, 1.0), (0.9, 1.0), (2.0, 2.0), "corner", 0.6),
    "SideboardsAndBuffets": Model((1.3, 1.8), (0.42, 0.5), (0.8, 0.9), "wall", 0.6),
    "Sofas": Model(
        (1.7, 2.2), (0.85, 0.95), (0.8, 0.88), "wall", 0.9,
        (
            Companion("CoffeeTables", "front", 0.4, 0),
            Companion("EndAndSideTables", "row-left", 0.05, 0),
            Companion("FloorLamps", "row-right", 0.05, 0),
        ),
    ),
    "Storage": Model((0.9, 1.5), (0.5, 0.6), (1.8, 2.05), "wall", 0.6),
    "StorageBenches": Model((0.9, 1.3), (0.4, 0.45), (0.45, 0.5)),
    "Toilets": Model((0.38, 0.4), (0.65, 0.7), (0.78, 0.82), "wall", 0.6),
    "VanityCounters": Model((0.8, 1.2), (0.48, 0.55), (0.83, 0.87), "wall", 0.7),
    "WashingMachinesAndDryers": Model((0.6, 0.6), (0.6, 0.62), (0.85, 0.85), "wall", 0.7, row=True),
}  # fmt: skip
