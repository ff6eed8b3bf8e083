"""The record of a furniture type: its shape, its sizes, where it stands, and which rooms have it.

Where the figures of the records come from (metres):

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
from typing import Literal, NamedTuple

from specs.data.world import RoomType
from tasks.worlds.furniture.primitives import Composition, Range, Size

TypeName = str
"""The name of a furniture type, such as ``Sofas``."""
Anchor = Literal["wall", "corner", "center"]
Tier = Literal["essential", "likely", "occasional"]
GroupName = Literal[
    "single", "storage", "bed", "desk", "dining table", "sofa", "armchair", "television", "kitchen row", "laundry"
]  # fmt: skip
"""With what a piece is placed; ``tasks/worlds/furnishing/arrangements.py`` has the function for each name."""
STEP_M = 0.05
"""Sizes are drawn in steps of this: shops do not sell tables of 1.37 m, and homes share what is made of them."""
HALLS = (50.0, 1e9)
"""Area of rooms the size of a hall (square metres)."""
LAST = 99
"""The place of what comes after everything that has a place of its own."""


@dataclass(frozen=True)
class Variant:
    """A usual size of a type.

    Attributes:
        width_m: Least and greatest extent along its back.
        depth_m: Least and greatest extent from its back to its front; 0 for as deep as wide.
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


def one_size(width: Range, depth: Range, height: Range) -> tuple[Variant, ...]:
    """Returns the variants of a type that has one usual size."""
    return (Variant(width, depth, height),)


def usual_and_long(width: Range, depth: Range, height: Range, long: Range) -> tuple[Variant, ...]:
    """Returns the variants of a type that is longer in halls.

    Args:
        width: Least and greatest width (metres) in other rooms.
        depth: Least and greatest depth (metres).
        height: Least and greatest height (metres).
        long: Least and greatest width (metres) in halls.
    """
    return Variant(width, depth, height), Variant(long, depth, height, HALLS)


@dataclass(frozen=True)
class Taste:
    """Where a piece or a group likes to stand, among the places that are free; a figure is the cost of missing it.

    Attributes:
        corner: In a corner, or flush beside something.
        middle: In the middle of its wall, or of the room.
        window: Below a window.
        away: Away from passages.
        chance: How much is left to chance.
        near: Close to pieces of these types.
        facing: Across from a piece of this type.
        apart: Away from others of its own type.
    """

    corner: float = 0.0
    middle: float = 0.0
    window: float = 0.0
    away: float = 0.0
    chance: float = 0.3
    near: tuple[TypeName, ...] = ()
    facing: TypeName = ""
    apart: bool = False


class RoomUse(NamedTuple):
    """A room type that has a furniture type, when the template leaves the furniture open.

    Attributes:
        room: The room type.
        tier: How usual the furniture is there.
        place: Its place in the tier. Seeded draws follow the places, so another place gives other worlds.
        floor_m2: Floor for which the room has one piece (square metres); not used where it is essential.
    """

    room: RoomType
    tier: Tier
    place: int
    floor_m2: float = 0.0


def essential(room: RoomType, place: int) -> RoomUse:
    """Returns the use of what makes a room that room; of several types in one place, one is drawn."""
    return RoomUse(room, "essential", place)


def likely(room: RoomType, floor_m2: float, place: int = LAST) -> RoomUse:
    """Returns the use of what most rooms of a type have, one piece for so much floor (square metres)."""
    return RoomUse(room, "likely", place, floor_m2)


def occasional(room: RoomType, floor_m2: float, place: int = LAST) -> RoomUse:
    """Returns the use of what some rooms of a type have, one piece for so much floor (square metres)."""
    return RoomUse(room, "occasional", place, floor_m2)


@dataclass(frozen=True)
class FurnitureType:
    """One type of furniture.

    Attributes:
        name: What templates and worlds call it.
        shape: The function that makes a piece of primitives.
        variants: Its usual sizes, smallest first.
        front_m: Floor kept free before it, or around it when it stands in the middle of a room.
        use_width_m: Least width of the floor that it takes, for what is narrower than its user.
        anchor: Where it stands when it is placed alone.
        under_window: Whether it belongs under a window, however high it is.
        row: Whether it stands flush beside others of a row, as kitchen units do.
        spread_m2: A room holds one for so much floor, at most; but always one.
        taste: Where it likes to stand when it is placed alone.
        group: With what it is placed.
        rooms: The rooms that have it when the template leaves the furniture open.
    """

    name: TypeName
    shape: Composition
    variants: tuple[Variant, ...]
    front_m: float = 0.6
    use_width_m: float = 0.0
    anchor: Anchor = "wall"
    under_window: bool = False
    row: bool = False
    spread_m2: float = 8.0
    taste: Taste = Taste()
    group: GroupName = "single"
    rooms: tuple[RoomUse, ...] = ()

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
