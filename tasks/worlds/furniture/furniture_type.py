"""The primitives of which furniture is made, and the record of a furniture type: shape, sizes, place, and rooms.

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

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

from specs.data.world import Color, RoomType

Size = tuple[float, float, float]
"""Width, depth and height (metres)."""
Range = tuple[float, float]
"""From where to where along one axis (metres)."""

FRONT_M = 0.02
"""Thickness of doors and drawer fronts."""
STAND_M = 0.1
"""Height of what a cabinet stands on."""
BOARD_M = 0.03
"""Thickness of tops and boards."""
REVEAL_M = 0.01
"""Gap between two fronts, through which one sees the darker body."""
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


# x runs along the piece's back, y from its back (-depth / 2) to its front, z up from the floor.
class Paint(NamedTuple):
    """What a part is coloured with: a colour of its own, or one that the room's palette decides.

    Attributes:
        role: What the palette calls it, or nothing.
        color: The colour, where there is no role.
        share: How bright it is beside that; 1 for as it is.
    """

    role: Literal["", "wood", "front", "worktop", "fabric", "cushion"]
    color: Color = (0.0, 0.0, 0.0)
    share: float = 1.0


WOOD, FRONT, WORKTOP, FABRIC, CUSHION = (
    Paint("wood"),
    Paint("front"),
    Paint("worktop"),
    Paint("fabric"),
    Paint("cushion"),
)
WHITE, PORCELAIN, LINEN = Paint("", (0.95, 0.95, 0.94)), Paint("", (0.98, 0.98, 0.97)), Paint("", (0.93, 0.91, 0.87))
STEEL, DARK, SCREEN = Paint("", (0.74, 0.76, 0.78)), Paint("", (0.16, 0.16, 0.18)), Paint("", (0.07, 0.08, 0.1))
WATER, GLASS = Paint("", (0.66, 0.82, 0.88)), Paint("", (0.75, 0.87, 0.9))
IRON = Paint("", (0.36, 0.35, 0.36))
BASKET, BOTTLE, SPIRIT = Paint("", (0.74, 0.63, 0.46)), Paint("", (0.2, 0.36, 0.26)), Paint("", (0.5, 0.3, 0.16))


class Primitive(NamedTuple):
    """One primitive of a piece.

    Attributes:
        yaw: Turn about z against the piece (radians, counter-clockwise); boxes only.
    """

    name: str
    shape: Literal["box", "cylinder"]
    center: tuple[float, float, float]
    half: tuple[float, float, float]
    color: Paint
    yaw: float = 0.0

    def moved(self, dy_m: float) -> "Primitive":
        """Returns the part further to the front of its piece."""
        x, y, z = self.center
        return self._replace(center=(x, y + dy_m, z))


class Style(NamedTuple):
    """The shapes that the furniture of one room shares.

    Attributes:
        raised: Whether beds and cabinets stand on legs or runners rather than on a plinth.
        round: Whether small tables and ottomans are round.
    """

    raised: bool
    round: bool


Composition = Callable[[Size, Style], tuple[Primitive, ...]]


def block(name: str, x: Range, y: Range, z: Range, color: Paint) -> Primitive:
    """Returns a box.

    Args:
        name: Its name in the piece.
        x: From where to where along the piece's back (metres).
        y: From where to where from back to front (metres).
        z: From where to where above the floor (metres).
        color: Its paint.
    """
    center = ((x[0] + x[1]) / 2, (y[0] + y[1]) / 2, (z[0] + z[1]) / 2)
    half = ((x[1] - x[0]) / 2, (y[1] - y[0]) / 2, (z[1] - z[0]) / 2)
    return Primitive(name, "box", center, half, color)


def post(name: str, at: tuple[float, float], radius: float, z: Range, color: Paint) -> Primitive:
    """Returns an upright cylinder.

    Args:
        name: Its name in the piece.
        at: Its axis (metres).
        radius: Its radius (metres).
        z: From where to where above the floor (metres).
        color: Its paint.
    """
    return Primitive(name, "cylinder", (*at, (z[0] + z[1]) / 2), (radius, radius, (z[1] - z[0]) / 2), color)


def legs(
    size: tuple[float, float], height: float, thickness: float, color: Paint, inset: float = 0.02
) -> tuple[Primitive, ...]:
    """Returns four square legs under the corners of something of that width and depth.

    Args:
        size: Width and depth of what they carry.
        height: How high they reach.
        thickness: Side of a leg.
        color: Of all four.
        inset: How far they stand in from the edges.
    """
    x, y, half = size[0] / 2 - inset - thickness / 2, size[1] / 2 - inset - thickness / 2, thickness / 2
    corners = ((-x, -y), (x, -y), (-x, y), (x, y))
    return tuple(
        block(f"leg_{n}", (cx - half, cx + half), (cy - half, cy + half), (0.0, height), color)
        for n, (cx, cy) in enumerate(corners, start=1)
    )


def stand(size: tuple[float, float], height: float, style: Style) -> tuple[Primitive, ...]:
    """Returns what a cabinet of that width and depth stands on: two runners, or a plinth set back from its front."""
    x, y = size[0] / 2, size[1] / 2
    if style.raised:
        return runners(size, height, shade(WOOD, 0.7))
    return (block("plinth", (-x + 0.02, x - 0.02), (-y, y - 0.06), (0.0, height), DARK),)


def runners(size: tuple[float, float], height: float, color: Paint, inset: float = 0.05) -> tuple[Primitive, ...]:
    """Returns two low runners from back to front under a piece.

    Args:
        size: Width and depth of the piece (metres).
        height: Their height (metres).
        color: Their paint.
        inset: Distance from the edges (metres).
    """
    x, y = size[0] / 2 - inset, size[1] / 2 - inset
    return tuple(
        block(f"runner_{n}", (at - 0.02, at + 0.02), (-y, y), (0.0, height), color)
        for n, at in enumerate((-x, x), start=1)
    )


def fronts(
    columns: int, rows: int, x: Range, z: Range, y: float, *, color: Paint = FRONT, name: str = "front"
) -> tuple[Primitive, ...]:
    """Returns a grid of doors or drawers, with reveals between and around them.

    Args:
        columns: How many stand side by side.
        rows: How many lie above each other.
        x: From where to where the grid reaches along the back (metres).
        z: From where to where it reaches above the floor (metres).
        y: Where the outer faces lie (metres).
        color: Their paint.
        name: Their name in the piece; a number is added.
    """
    width, height = (x[1] - x[0] - REVEAL_M) / columns, (z[1] - z[0] - REVEAL_M) / rows
    return tuple(
        block(
            f"{name}_{row * columns + column + 1}",
            (x[0] + column * width + REVEAL_M, x[0] + (column + 1) * width),
            (y - FRONT_M, y),
            (z[0] + row * height + REVEAL_M, z[0] + (row + 1) * height),
            color,
        )
        for row in range(rows)
        for column in range(columns)
    )


def cabinet_body(size: Size, style: Style, *, top: bool = False) -> tuple[Primitive, ...]:
    """Returns what a cabinet stands on and its body, with room for fronts; a top reaches over them."""
    width, depth, height = size
    x, y = width / 2, depth / 2
    under = height - BOARD_M if top else height
    body = block("body", (-x, x), (-y, y - 0.02), (STAND_M, under), shade(WOOD, 0.72 if top else 0.85))
    board = block("top", (-x, x), (-y, y), (under, height), WOOD)
    return (*stand((width, depth), STAND_M, style), body, *((board,) if top else ()))


def front_face(size: Size) -> tuple[Range, Range, float]:
    """Returns where the fronts of a cabinet go: along x, along z, and how far out."""
    return (-size[0] / 2, size[0] / 2), (STAND_M, size[2] - BOARD_M), size[1] / 2


def shade(paint: Paint, share: float) -> Paint:
    """Returns a paint that is so much brighter, or below 1 darker."""
    return paint._replace(share=paint.share * share)


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
