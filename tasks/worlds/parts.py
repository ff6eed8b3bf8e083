"""The primitives that furniture is put together from, in the piece's own frame.

x runs along the piece's back, y from its back (-depth / 2) to its front, z up from the floor.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from tasks.worlds.materials import Color

Size = tuple[float, float, float]
"""Width, depth and height (metres)."""


@dataclass(frozen=True)
class Part:
    """One primitive of a piece."""

    name: str
    shape: Literal["box", "cylinder"]
    center: tuple[float, float, float]
    half: tuple[float, float, float]
    color: Color


@dataclass(frozen=True)
class Tints:
    """The colours of one piece: its body, its accents, and its upholstery."""

    body: Color
    accent: Color
    fabric: Color


Composition = Callable[[Size, Tints], tuple[Part, ...]]


def block(name: str, x: tuple[float, float], y: tuple[float, float], z: tuple[float, float], color: Color) -> Part:
    """Returns a box from its extents along each axis."""
    center = ((x[0] + x[1]) / 2, (y[0] + y[1]) / 2, (z[0] + z[1]) / 2)
    half = ((x[1] - x[0]) / 2, (y[1] - y[0]) / 2, (z[1] - z[0]) / 2)
    return Part(name, "box", center, half, color)


def post(name: str, at: tuple[float, float], radius: float, z: tuple[float, float], color: Color) -> Part:
    """Returns an upright cylinder."""
    return Part(name, "cylinder", (*at, (z[0] + z[1]) / 2), (radius, radius, (z[1] - z[0]) / 2), color)


def legs(width: float, depth: float, height: float, thickness: float, color: Color) -> tuple[Part, ...]:
    """Returns four legs under the corners of a top, 2 cm in from its edge."""
    x, y, half = width / 2 - 0.02 - thickness / 2, depth / 2 - 0.02 - thickness / 2, thickness / 2
    corners = ((-x, -y), (x, -y), (-x, y), (x, y))
    return tuple(
        block(f"leg_{n}", (cx - half, cx + half), (cy - half, cy + half), (0.0, height), color)
        for n, (cx, cy) in enumerate(corners, start=1)
    )
