"""Reads the PNG files that tasks/export writes: an independent decoder of just these."""

import struct
import zlib

import numpy as np

SIGNATURE = b"\x89PNG\r\n\x1a\n"


def decoded(file: bytes) -> np.ndarray:
    """Returns rows x columns x 3 of a PNG of 8 bits, true colour or indexed, whose rows have filter 0 or 2."""
    assert file.startswith(SIGNATURE)
    chunks = dict(_chunks(file))
    columns, rows, bits, color_type = struct.unpack(">IIBB", chunks[b"IHDR"][:10])
    assert bits == 8
    channels = {2: 3, 3: 1}[color_type]
    raw = np.frombuffer(zlib.decompress(chunks[b"IDAT"]), np.uint8).reshape(rows, 1 + columns * channels)
    lines = raw[:, 1:].copy()
    for row in range(rows):
        assert raw[row, 0] in (0, 2)
        if raw[row, 0] == 2 and row:
            lines[row] += lines[row - 1]
    if color_type == 2:
        return lines.reshape(rows, columns, 3)
    return np.frombuffer(chunks[b"PLTE"], np.uint8).reshape(-1, 3)[lines]


def _chunks(file: bytes):
    position = len(SIGNATURE)
    while position < len(file):
        (length,) = struct.unpack(">I", file[position : position + 4])
        kind, body = file[position + 4 : position + 8], file[position + 8 : position + 8 + length]
        assert struct.unpack(">I", file[position + 8 + length : position + 12 + length])[0] == zlib.crc32(kind + body)
        yield kind, body
        position += 12 + length
