"""A finish as a picture that repeats: the same pixels for the same finish, on any machine."""

import zlib
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import UInt8

from specs.world import Color, Finish, Pattern
from tasks.export.png import encode_indexed
from tasks.export.texture_patterns import TILINGS

# The palette runs from lighter than the colour, over the accent, to darker than it.
_LEVELS = 32
_LIGHTEST, _DARKEST = -0.4, 1.4


@dataclass(frozen=True)
class Texture:
    """A picture of a finish.

    Attributes:
        png: The picture, an indexed PNG file.
        extent_m: What it covers in the world (along, then across or up), a whole number of the pattern's units.
    """

    png: bytes
    extent_m: tuple[float, float]


def texture_of(finish: Finish) -> Texture | None:
    """Returns the picture of a finish; None for a surface of one colour, which needs none."""
    if finish.pattern == "plain" and finish.color == finish.accent:
        return None
    return draw_texture(finish.pattern, finish.color, finish.accent, finish.repeat_m)


@lru_cache(maxsize=256)
def draw_texture(pattern: Pattern, color: Color, accent: Color, repeat_m: tuple[float, float]) -> Texture:
    """Returns the picture of a pattern in two colours; a job's worlds share most of theirs."""
    tiling = TILINGS[pattern]
    columns, rows = tiling.pixels
    units = (tiling.units[1], tiling.units[0])
    # The same seed for all finishes of a pattern: two rooms with one flooring differ in nothing but their colours.
    rng = np.random.default_rng(zlib.crc32(pattern.encode()))
    shares = tiling.draw(rng, (rows, columns), units)
    levels = np.rint((shares - _LIGHTEST) / (_DARKEST - _LIGHTEST) * (_LEVELS - 1))
    along_m, across_m = repeat_m
    extent_m = (round(tiling.units[0] * along_m, 6), round(tiling.units[1] * across_m, 6))
    return Texture(encode_indexed(np.clip(levels, 0, _LEVELS - 1).astype(np.uint8), _palette(color, accent)), extent_m)


def _palette(color: Color, accent: Color) -> UInt8[np.ndarray, "levels 3"]:
    shares = np.linspace(_LIGHTEST, _DARKEST, _LEVELS)[:, None]
    mixed = np.array(color) + shares * (np.array(accent) - np.array(color))
    return np.rint(255 * np.clip(mixed, 0.0, 1.0)).astype(np.uint8)
