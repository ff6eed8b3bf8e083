"""Placed pieces become furniture of the world: primitives in world coordinates, named and coloured."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np

from specs.data.world import Color, Furniture
from tasks.worlds.furnishing.placement import turn_quarters
from tasks.worlds.furnishing.scene import Piece
from tasks.worlds.furniture.catalogue import compose
from tasks.worlds.furniture.furniture_type import TypeName
from tasks.worlds.furniture.primitives import Paint, Primitive, Size, Style
from tasks.worlds.geometry.boxes import QUARTER_TURN_RAD, rounded


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


@dataclass(frozen=True)
class Look:
    """How the furniture of one room looks: its shapes, and its colours."""

    style: Style
    palette: Palette


class _PlacedPrimitive(NamedTuple):
    """A primitive of a piece that is turned as it stands, about the piece's middle."""

    name: str
    shape: Literal["box", "cylinder"]
    center: tuple[float, float, float]
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
    x, y = piece.center
    parts = _turn_parts(piece.type, piece.size, look.style, piece.quarter, piece.askew_rad)
    colors = _mix_paints(piece.type, piece.size, look)
    solids = [
        {
            "name": f"{name}_{part_name}",
            "shape": shape,
            "center_m": (round(x + dx, 6) + 0.0, round(y + dy, 6) + 0.0, z),
            "half_extents_m": half,
            "yaw_rad": yaw,
            "color": color,
        }
        for (part_name, shape, (dx, dy, z), half, yaw), color in zip(parts, colors, strict=True)
    ]
    # All at once: pydantic is several times quicker with a piece of dictionaries than with solids made one by one.
    return Furniture.model_validate(
        {
            "name": name,
            "model_type": piece.type,
            "room": room,
            "center_m": (rounded(x), rounded(y)),
            "yaw_rad": _wrap_angle(piece.quarter * QUARTER_TURN_RAD + piece.askew_rad),
            "solids": solids,
        }
    )


@lru_cache(maxsize=8192)
def _turn_parts(
    kind: TypeName, size: Size, style: Style, quarter: int, askew_rad: float
) -> tuple[_PlacedPrimitive, ...]:
    """Returns the primitives of a piece that faces some way; pieces of one size and style share them."""
    return tuple(_turn_part(part, quarter, askew_rad) for part in compose(kind, size, style))


def _turn_part(part: Primitive, quarter: int, askew_rad: float) -> _PlacedPrimitive:
    """Returns a primitive turned; quarter turns swap extents, so that most boxes need no yaw at all."""
    half_x, half_y, half_z = part.half
    yaw = part.yaw
    if askew_rad == 0.0:
        x, y = turn_quarters(part.center[:2], quarter)
        if part.yaw == 0.0 and quarter % 2:
            half_x, half_y = half_y, half_x
        elif part.yaw:
            yaw += quarter * QUARTER_TURN_RAD
    else:
        turn = quarter * QUARTER_TURN_RAD + askew_rad
        cos, sin = math.cos(turn), math.sin(turn)
        x, y = cos * part.center[0] - sin * part.center[1], sin * part.center[0] + cos * part.center[1]
        yaw += turn
    half = (rounded(half_x), rounded(half_y), rounded(half_z))
    yaw = 0.0 if part.shape == "cylinder" else _wrap_angle(yaw)
    return _PlacedPrimitive(part.name, part.shape, (x, y, rounded(part.center[2])), half, yaw)


def _wrap_angle(yaw: float) -> float:
    return rounded(math.remainder(yaw, 4 * QUARTER_TURN_RAD))


@lru_cache(maxsize=8192)
def _mix_paints(kind: TypeName, size: Size, look: Look) -> tuple[Color, ...]:
    """Returns the colours of a piece's primitives."""
    return tuple(_mix(part.color, look.palette) for part in compose(kind, size, look.style))


@lru_cache(maxsize=1024)
def _mix(paint: Paint, palette: Palette) -> Color:
    """Returns the colour of a paint in a palette."""
    color: Color = getattr(palette, paint.role) if paint.role else paint.color
    red, green, blue = (round(min(1.0, paint.share * channel), 3) for channel in color)
    return red, green, blue
