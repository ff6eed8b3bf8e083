"""Maps of ROS, drawn as text: # is occupied, . is free, and a space is unknown."""

from pathlib import Path

import numpy as np

LEVELS = {"#": 0, ".": 254, " ": 205}
HALL = (
    "##########",
    "#........#",
    "#..##....#",
    "#..##....#",
    "#........#",
    "##########",
)


def levels(rows: tuple[str, ...]) -> np.ndarray:
    """Returns the grey of each pixel, the upper row first."""
    return np.array([[LEVELS[mark] for mark in row] for row in rows], np.uint8)


def pgm(pixels: np.ndarray, comment: str = "") -> bytes:
    """Returns a picture in binary PGM."""
    head = f"P5\n{comment}{pixels.shape[1]} {pixels.shape[0]}\n255\n"
    return head.encode() + pixels.astype(np.uint8).tobytes()


def write_map(
    folder: Path, rows: tuple[str, ...] = HALL, *, image: str = "map.pgm", body: bytes | None = None, **fields: object
) -> Path:
    """Returns the YAML file of a map of 0.05 m cells whose lower left corner is at (1, 2); fields replace lines of it.

    Args:
        folder: Where the two files go.
        rows: What it shows.
        image: The picture's name.
        body: The picture, if it is not PGM of the rows; b"" writes none.
        fields: Lines of the YAML file; those that are None are left out.
    """
    lines = {"image": image, "resolution": 0.05, "origin": [1.0, 2.0, 0.0], "negate": 0}
    lines |= {"occupied_thresh": 0.65, "free_thresh": 0.196, **fields}
    path = folder / "map.yaml"
    path.write_text("".join(f"{name}: {value}\n" for name, value in lines.items() if value is not None))
    if body != b"":
        (folder / image).write_bytes(pgm(levels(rows)) if body is None else body)
    return path
