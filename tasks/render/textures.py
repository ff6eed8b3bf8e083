"""A finish as a picture that repeats, the same pixels for the same finish on any machine; and pictures as PNG files.

PNG (W3C recommendation, third edition) as Simyard writes it: 8 bits a sample, one filter for all rows.

Every pattern is an array of shares: 0 shows the finish's colour, 1 its accent, what lies outside is lighter or darker
than both. All arrays repeat seamlessly, and are drawn with exact arithmetic only (no sines, no exponentials), so that
they are the same on any machine.
"""

import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int, UInt8

from specs.data.world import Color, Finish, Pattern

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_TRUE_COLOUR, _INDEXED = 2, 3
_BITS = 8
_UP = 2  # each row as its difference from the one above: rows of a picture resemble each other


def encode_rgb(pixels: UInt8[np.ndarray, "rows columns 3"]) -> bytes:
    """Returns a picture, its first row the upper one, as a PNG file."""
    above = np.zeros_like(pixels)
    above[1:] = pixels[:-1]
    # uint8 wraps around, as the filter wants it.
    return _file(pixels, _TRUE_COLOUR, (pixels - above).reshape(len(pixels), -1), _UP)


def encode_indexed(pixels: UInt8[np.ndarray, "rows columns"], palette: UInt8[np.ndarray, "colours 3"]) -> bytes:
    """Returns a picture of at most 256 colours, each pixel an index into the palette, as a PNG file."""
    return _file(pixels, _INDEXED, pixels, 0, _chunk(b"PLTE", palette.tobytes()))


def _file(
    picture: np.ndarray, color_type: int, samples: UInt8[np.ndarray, "rows bytes"], row_filter: int, extra: bytes = b""
) -> bytes:
    rows, columns = picture.shape[:2]
    header = struct.pack(">IIBBBBB", columns, rows, _BITS, color_type, 0, 0, 0)
    filtered = np.insert(samples, 0, row_filter, axis=1)
    body = _chunk(b"IDAT", zlib.compress(filtered.tobytes(), 6))
    return _SIGNATURE + _chunk(b"IHDR", header) + extra + body + _chunk(b"IEND", b"")


def _chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


Shares = Float[np.ndarray, "rows columns"]
Draw = Callable[[np.random.Generator, tuple[int, int], tuple[int, int]], Shares]

_SEAM = 1.25  # darker than the accent: a gap between boards lies in shadow


# How the surfaces of finishes are divided, drawn by NumPy: planks, tiles, bricks and what else there is.
@dataclass(frozen=True)
class Tiling:
    """How a pattern is drawn.

    Attributes:
        units: Units of the pattern in the picture (along, across).
        pixels: Columns and rows of the picture.
        draw: Takes randomness, (rows, columns) and (units across, units along).
    """

    units: tuple[int, int]
    pixels: tuple[int, int]
    draw: Draw


def draw_mottle(rng: np.random.Generator, shape: tuple[int, int], units: tuple[int, int]) -> Shares:
    """Returns a surface without divisions: soft clouds and a little grain."""
    del units
    return 0.15 + 0.8 * _clouds(rng, shape, 8) + 0.5 * _clouds(rng, shape, 32) + 0.25 * _noise(rng, shape)


def fibres(rng: np.random.Generator, shape: tuple[int, int], units: tuple[int, int]) -> Shares:
    """Returns the tufts of a carpet."""
    del units
    return 0.35 + 1.1 * _noise(rng, shape) + 0.5 * _clouds(rng, shape, 8)


def planks(rng: np.random.Generator, shape: tuple[int, int], units: tuple[int, int]) -> Shares:
    """Returns boards along x, each row of them shifted against its neighbours."""
    rows, columns = np.indices(shape)
    height, width = shape[0] // units[0], shape[1] // units[1]
    board_row = rows // height
    # The second half of the rows takes other shifts, all at least a quarter of a board apart from their neighbours.
    shifted = columns + (board_row * 3 % 8) * width // 8
    board = (shifted // width) % units[1] + units[1] * board_row
    tint = rng.uniform(0.0, 0.5, board.max() + 1)[board]
    seam = (rows % height == 0) | (shifted % width == 0)
    return np.where(seam, _SEAM, tint + 0.55 * _streaks(rng, shape))


def parquet(rng: np.random.Generator, shape: tuple[int, int], units: tuple[int, int]) -> Shares:
    """Returns a herringbone: staves along x and along y, each a few times as long as wide."""
    cell = shape[0] // units[0]
    ratio = units[0] // 2
    rows, columns = np.indices(shape)
    row, column = rows // cell, columns // cell
    along = (column - row) % (2 * ratio)
    lies = along < ratio
    across = (row - column - 1) % (2 * ratio)
    # Each stave is known by the cell that it begins in.
    first_column = np.where(lies, column - along, column) % units[0]
    first_row = np.where(lies, row, row - across) % units[0]
    stave = first_row * units[0] + first_column + lies * units[0] ** 2
    tint = rng.uniform(-0.15, 0.65, stave.max() + 1)[stave]
    grain = np.where(lies, _streaks(rng, shape), _streaks(rng, (shape[1], shape[0])).T)
    return np.where(_edges(stave), _SEAM, tint + 0.35 * grain)


def tiles(rng: np.random.Generator, shape: tuple[int, int], units: tuple[int, int]) -> Shares:
    """Returns square tiles with joints."""
    return _blocks(rng, shape, units, shift=0, joint=2, tint=0.16)


def bricks(rng: np.random.Generator, shape: tuple[int, int], units: tuple[int, int]) -> Shares:
    """Returns courses of bricks, every other one shifted by half a brick."""
    return _blocks(rng, shape, units, shift=shape[1] // units[1] // 2, joint=3, tint=0.42) + 0.25 * _noise(rng, shape)


def stones(rng: np.random.Generator, shape: tuple[int, int], units: tuple[int, int]) -> Shares:
    """Returns courses of stones of uneven lengths."""
    height, width = shape[0] // units[0], shape[1] // units[1]
    rows, columns = np.indices(shape)
    course = rows // height
    stone = np.empty(shape, dtype=np.int64)
    for number in range(units[0]):
        ends = (np.arange(units[1]) * width + rng.integers(-width // 3, width // 3, units[1])) % shape[1]
        inside = course == number
        stone[inside] = np.searchsorted(np.sort(ends), columns[inside], side="right") % units[1] + units[1] * number
    tint = rng.uniform(-0.3, 0.7, stone.max() + 1)[stone]
    face = tint + 0.5 * _clouds(rng, shape, 16) + 0.3 * _noise(rng, shape)
    return np.where(_edges(stone) | np.roll(_edges(stone), 1, (0, 1)), _SEAM, face)


def panels(rng: np.random.Generator, shape: tuple[int, int], units: tuple[int, int]) -> Shares:
    """Returns upright boards with grooves between them."""
    columns = np.indices(shape)[1]
    width = shape[1] // units[1]
    tint = rng.uniform(0.0, 0.35, units[1])[columns // width % units[1]]
    groove = columns % width < 1
    return np.where(groove, _SEAM, tint + 0.4 * _streaks(rng, (shape[1], shape[0])).T)


def stripes(rng: np.random.Generator, shape: tuple[int, int], units: tuple[int, int]) -> Shares:
    """Returns upright stripes, half colour and half accent."""
    del rng
    columns = np.indices(shape)[1]
    width = shape[1] // units[1]
    return (columns % width >= width // 2).astype(float)


TILINGS: Mapping[Pattern, Tiling] = {
    "plain": Tiling((2, 2), (128, 128), draw_mottle),
    "fibres": Tiling((32, 32), (128, 128), fibres),
    "planks": Tiling((2, 8), (256, 256), planks),
    "parquet": Tiling((2, 8), (256, 256), parquet),
    "tiles": Tiling((4, 4), (256, 256), tiles),
    "bricks": Tiling((4, 8), (256, 256), bricks),
    "stones": Tiling((4, 8), (256, 256), stones),
    "panels": Tiling((16, 1), (256, 256), panels),
    "stripes": Tiling((4, 1), (128, 8), stripes),
}


def _blocks(
    rng: np.random.Generator, shape: tuple[int, int], units: tuple[int, int], *, shift: int, joint: int, tint: float
) -> Shares:
    """Returns equal blocks in rows, odd rows shifted, with joints in the accent."""
    height, width = shape[0] // units[0], shape[1] // units[1]
    rows, columns = np.indices(shape)
    course = rows // height
    shifted = columns + (course % 2) * shift
    block = (shifted // width) % units[1] + units[1] * course
    face = rng.uniform(-tint / 2, tint / 2, units[0] * units[1])[block]
    in_joint = (rows % height < joint) | (shifted % width < joint)
    return np.where(in_joint, 1.0, face)


def _edges(pieces: Int[np.ndarray, "rows columns"]) -> np.ndarray:
    """Returns where a piece borders on the one before it, in either direction."""
    return (pieces != np.roll(pieces, 1, axis=0)) | (pieces != np.roll(pieces, 1, axis=1))


def _noise(rng: np.random.Generator, shape: tuple[int, int]) -> Shares:
    return rng.uniform(-0.5, 0.5, shape)


def _clouds(rng: np.random.Generator, shape: tuple[int, int], cells: int) -> Shares:
    """Returns noise of ``cells`` patches a side, soft between them."""
    coarse = rng.uniform(-0.5, 0.5, (cells, cells))
    return _stretched(_stretched(coarse, shape[0], 0), shape[1], 1)


def _streaks(rng: np.random.Generator, shape: tuple[int, int]) -> Shares:
    """Returns grain along x: every row of pixels has its own tone, which changes slowly."""
    return _stretched(rng.uniform(-0.5, 0.5, (shape[0], 16)), shape[1], 1)


def _stretched(values: np.ndarray, size: int, axis: int) -> np.ndarray:
    """Returns values interpolated to ``size`` along an axis, the last going over into the first."""
    count = values.shape[axis]
    position = np.arange(size) * count / size
    first = position.astype(np.int64)
    share = (position - first).reshape((-1, 1) if axis == 0 else (1, -1))
    return np.take(values, first, axis) * (1.0 - share) + np.take(values, (first + 1) % count, axis) * share


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
    """Returns the picture of a pattern in two colours; a job's worlds share most of theirs.

    Args:
        pattern: How the finish is divided.
        color: The main colour, sRGB from 0 to 1.
        accent: The second colour, sRGB from 0 to 1.
        repeat_m: Width and height after which the picture repeats.
    """
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
