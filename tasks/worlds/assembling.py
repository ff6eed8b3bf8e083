"""Placed pieces become furniture of the world: primitives in world coordinates, named and coloured."""

import math

import numpy as np

from specs.world import Furniture, Solid
from tasks.worlds.furnishing import compose
from tasks.worlds.geometry import QUARTER_TURN_RAD, rounded
from tasks.worlds.materials import Color
from tasks.worlds.parts import Part, Tints
from tasks.worlds.placing import Piece, turned

_WOODS: tuple[Color, ...] = (
    (0.55, 0.38, 0.24),
    (0.72, 0.55, 0.37),
    (0.82, 0.7, 0.53),
    (0.36, 0.24, 0.16),
    (0.9, 0.89, 0.86),
)
_FABRICS: tuple[Color, ...] = (
    (0.36, 0.45, 0.55),
    (0.55, 0.58, 0.5),
    (0.7, 0.45, 0.35),
    (0.52, 0.5, 0.48),
    (0.8, 0.74, 0.62),
    (0.3, 0.4, 0.36),
)


def draw_tints(rng: np.random.Generator) -> Tints:
    """Returns the colours of one room's furniture: one wood, one upholstery."""
    wood = _WOODS[int(rng.integers(len(_WOODS)))]
    fabric = _FABRICS[int(rng.integers(len(_FABRICS)))]
    accent = tuple(rounded(0.82 * channel) for channel in wood)
    return Tints(wood, (accent[0], accent[1], accent[2]), fabric)


def assemble(piece: Piece, name: str, room: str, tints: Tints) -> Furniture:
    """Returns a piece as the world holds it."""
    yaw = piece.quarter * QUARTER_TURN_RAD + piece.askew_rad
    return Furniture(
        name=name,
        model_type=piece.type,
        room=room,
        center_m=(rounded(piece.center[0]), rounded(piece.center[1])),
        yaw_rad=rounded(math.remainder(yaw, 4 * QUARTER_TURN_RAD)),
        solids=tuple(_solid(part, piece, name, yaw) for part in compose(piece.type, piece.size, tints)),
    )


def _solid(part: Part, piece: Piece, name: str, yaw: float) -> Solid:
    """Returns a primitive in the world; quarter turns swap extents, so that most boxes need no yaw at all."""
    half_x, half_y, half_z = part.half
    if piece.askew_rad == 0.0:
        x, y = turned(part.center[:2], piece.quarter)
        yaw = 0.0
        half_x, half_y = (half_x, half_y) if piece.quarter % 2 == 0 else (half_y, half_x)
    else:
        cos, sin = math.cos(yaw), math.sin(yaw)
        x = cos * part.center[0] - sin * part.center[1]
        y = sin * part.center[0] + cos * part.center[1]
    return Solid(
        name=f"{name}_{part.name}",
        shape=part.shape,
        center_m=(rounded(piece.center[0] + x), rounded(piece.center[1] + y), rounded(part.center[2])),
        half_extents_m=(rounded(half_x), rounded(half_y), rounded(half_z)),
        yaw_rad=0.0 if part.shape == "cylinder" else rounded(math.remainder(yaw, 4 * QUARTER_TURN_RAD)),
        color=part.color,
    )
