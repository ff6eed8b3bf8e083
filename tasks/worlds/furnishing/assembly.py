"""Placed pieces become furniture of the world: primitives in world coordinates, named and coloured."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np

from specs.data.world import Color, Furniture, Solid
from tasks.worlds.furnishing.placement import turn_quarters
from tasks.worlds.furnishing.scene import Piece
from tasks.worlds.furniture.catalogue import compose
from tasks.worlds.furniture.furniture_type import Paint, Primitive, Size, Style, TypeName
from tasks.worlds.geometry import QUARTER_TURN_RAD, rounded


class Palette(NamedTuple):
    """The colours that the furniture of one room shares."""

    wood: Color
    front: Color
    worktop: Color
    fabric: Color
    cushion: Color


_WHITE_OAK, _OAK, _BEECH = (0.82, 0.7, 0.53), (0.72, 0.55, 0.37), (0.78, 0.62, 0.44)
_WALNUT, _WENGE, _LACQUER = (0.5, 0.35, 0.23), (0.36, 0.26, 0.19), (0.89, 0.87, 0.83)
_CREAM, _SAGE, _SLATE, _SAND = (0.93, 0.92, 0.89), (0.62, 0.69, 0.64), (0.36, 0.43, 0.5), (0.83, 0.77, 0.66)
_STONE, _BLOCK, _MARBLE = (0.33, 0.33, 0.34), (0.72, 0.56, 0.38), (0.84, 0.82, 0.79)
# Wood, fronts, worktop, upholstery, cushions: what goes together.
_PALETTES: tuple[Palette, ...] = (
    Palette(_OAK, _CREAM, _STONE, (0.36, 0.45, 0.55), (0.52, 0.61, 0.7)),
    Palette(_WHITE_OAK, _SAGE, _MARBLE, (0.5, 0.54, 0.45), (0.66, 0.69, 0.58)),
    Palette(_WALNUT, _CREAM, _MARBLE, (0.66, 0.42, 0.33), (0.79, 0.58, 0.48)),
    Palette(_LACQUER, _SLATE, _BLOCK, (0.46, 0.44, 0.43), (0.66, 0.64, 0.61)),
    Palette(_BEECH, _SAND, _STONE, (0.73, 0.66, 0.55), (0.86, 0.8, 0.7)),
    Palette(_WENGE, _SAND, _MARBLE, (0.27, 0.37, 0.34), (0.44, 0.55, 0.51)),
    Palette(_WHITE_OAK, _LACQUER, _BLOCK, (0.7, 0.55, 0.27), (0.83, 0.71, 0.45)),
    Palette(_OAK, _SLATE, _STONE, (0.58, 0.55, 0.51), (0.77, 0.74, 0.69)),
)


# Half a micrometre, less what adding a place to it may be off.
_NO_TIE = 0.499


@dataclass(frozen=True)
class Look:
    """How the furniture of one room looks: its shapes, and its colours."""

    style: Style
    palette: Palette


class _PlacedPrimitive(NamedTuple):
    """A primitive of a piece that is turned as it stands, about the piece's middle.

    Attributes:
        at: Its middle in micrometres, as near as whole ones come; None where it lies half-way between two.
        z: Height of its middle.
    """

    name: str
    shape: Literal["box", "cylinder"]
    center: tuple[float, float]
    at: tuple[int, int] | None
    z: float
    half: tuple[float, float, float]
    yaw: float


def draw_look(rng: np.random.Generator) -> Look:
    """Returns how the furniture of one room looks: one wood, one upholstery, one kind of fronts."""
    palette, raised, round_ones = rng.random(3).tolist()
    return Look(Style(raised=raised < 0.6, round=round_ones < 0.5), _PALETTES[int(palette * len(_PALETTES))])


def assemble(piece: Piece, name: str, room: str, look: Look) -> Furniture:
    """Returns a piece as the world holds it.

    Args:
        piece: The piece where it stands.
        name: Its name in the world.
        room: The name of its room.
        look: The shapes and colours of the room's furniture.
    """
    parts = _turn_parts(piece.type, piece.size, look.style, piece.quarter, piece.askew_rad)
    colors = _mix_paints(piece.type, piece.size, look.style, look.palette)
    x, y = piece.center
    solids = [
        Solid.unchecked(
            {
                "name": f"{name}_{part.name}",
                "shape": part.shape,
                "center_m": center,
                "half_extents_m": part.half,
                "yaw_rad": part.yaw,
                "color": color,
                "outline_m": None,
            }
        )
        for part, center, color in zip(parts, _centers(piece, parts), colors, strict=True)
    ]
    return Furniture.unchecked(
        {
            "name": name,
            "model_type": piece.type,
            "room": room,
            "center_m": (rounded(x), rounded(y)),
            "yaw_rad": _wrap_angle(piece.quarter * QUARTER_TURN_RAD + piece.askew_rad),
            "solids": tuple(solids),
        }
    )


def _centers(piece: Piece, parts: Sequence[_PlacedPrimitive]) -> list[tuple[float, float, float]]:
    """Returns the middles of a piece's primitives in the world, rounded to a millionth.

    A piece stands at whole millimetres, so that its primitives' whole micrometres only have to be added.
    """
    x, y = piece.center
    whole_x, whole_y = round(x * 1e3), round(y * 1e3)
    if whole_x / 1e3 != x or whole_y / 1e3 != y:
        return [(rounded(x + part.center[0]), rounded(y + part.center[1]), part.z) for part in parts]
    whole_x, whole_y = whole_x * 1_000, whole_y * 1_000
    return [
        ((whole_x + at[0]) / 1e6, (whole_y + at[1]) / 1e6, z) if at else (rounded(x + dx), rounded(y + dy), z)
        for _, _, (dx, dy), at, z, _, _ in parts
    ]


@lru_cache(maxsize=8192)
def _turn_parts(
    kind: TypeName, size: Size, style: Style, quarter: int, askew_rad: float
) -> tuple[_PlacedPrimitive, ...]:
    """Returns the primitives of a piece that faces some way; pieces of one size and style share them.

    Quarter turns swap extents, so that most boxes need no yaw at all.
    """
    parts = _rounded_parts(kind, size, style)
    if askew_rad == 0.0:
        return tuple([_turn_part(part, quarter) for part in parts])
    turn = quarter * QUARTER_TURN_RAD + askew_rad
    cos, sin = math.cos(turn), math.sin(turn)
    return tuple(
        [
            _placed(part, (cos * x - sin * y, sin * x + cos * y), part.half, part.yaw + turn)
            for part in parts
            for x, y, _ in [part.center]
        ]
    )


@lru_cache(maxsize=4096)
def _rounded_parts(kind: TypeName, size: Size, style: Style) -> tuple[Primitive, ...]:
    """Returns the primitives of a piece with heights and extents as a world has them."""
    return tuple(
        [
            part._replace(center=(x, y, rounded(z)), half=(rounded(half_x), rounded(half_y), rounded(half_z)))
            for part in compose(kind, size, style)
            for x, y, z in [part.center]
            for half_x, half_y, half_z in [part.half]
        ]
    )


def _turn_part(part: Primitive, quarter: int) -> _PlacedPrimitive:
    half_x, half_y, half_z = part.half
    swap = quarter % 2 and part.yaw == 0.0
    return _placed(
        part,
        turn_quarters(part.center[:2], quarter),
        (half_y, half_x, half_z) if swap else part.half,
        part.yaw and part.yaw + quarter * QUARTER_TURN_RAD,
    )


def _placed(
    part: Primitive, center: tuple[float, float], half: tuple[float, float, float], yaw: float
) -> _PlacedPrimitive:
    """Returns a primitive where it lies in its piece as that faces.

    Args:
        part: The primitive, with its extents rounded.
        center: Its middle, turned.
        half: Its extents, turned.
        yaw: How far it is turned itself.
    """
    yaw = 0.0 if part.shape == "cylinder" else _wrap_angle(yaw)
    return _PlacedPrimitive(part.name, part.shape, center, _micrometres(center), part.center[2], half, yaw)


def _micrometres(point: tuple[float, float]) -> tuple[int, int] | None:
    """Returns a point in whole micrometres; None where one of its figures lies half-way between two."""
    x, y = point[0] * 1e6, point[1] * 1e6
    whole_x, whole_y = round(x), round(y)
    return (whole_x, whole_y) if abs(x - whole_x) < _NO_TIE and abs(y - whole_y) < _NO_TIE else None


def _wrap_angle(yaw: float) -> float:
    return rounded(math.remainder(yaw, 4 * QUARTER_TURN_RAD))


@lru_cache(maxsize=8192)
def _mix_paints(kind: TypeName, size: Size, style: Style, palette: Palette) -> tuple[Color, ...]:
    """Returns the colours of a piece's primitives."""
    return tuple([_mix(part.color, palette) for part in compose(kind, size, style)])


@lru_cache(maxsize=1024)
def _mix(paint: Paint, palette: Palette) -> Color:
    """Returns the colour of a paint in a palette."""
    color: Color = getattr(palette, paint.role) if paint.role else paint.color
    red, green, blue = (round(min(1.0, paint.share * channel), 3) for channel in color)
    return red, green, blue
