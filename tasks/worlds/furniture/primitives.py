"""The primitives that furniture is put together from, in the piece's own frame.

x runs along the piece's back, y from its back (-depth / 2) to its front, z up from the floor.
"""

from collections.abc import Callable
from typing import Literal, NamedTuple

from specs.data.world import Color

Size = tuple[float, float, float]
"""Width, depth and height (metres)."""
Range = tuple[float, float]
"""From where to where along one axis (metres)."""


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

FRONT_M = 0.02
"""Thickness of doors and drawer fronts."""
STAND_M = 0.1
"""Height of what a cabinet stands on."""
BOARD_M = 0.03
"""Thickness of tops and boards."""
REVEAL_M = 0.01
"""Gap between two fronts, through which one sees the darker body."""


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
