"""PNG files (W3C recommendation, third edition), as Simyard writes them: 8 bits a sample, one filter for all rows."""

import struct
import zlib

import numpy as np
from jaxtyping import UInt8

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
