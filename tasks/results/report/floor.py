"""Draws a world from above as a few SVG paths, and simplifies paths to few points.

Drawings are in centimetres, x to the right, y down the page.
"""

import math
from collections.abc import Iterable

import numpy as np
from jaxtyping import Bool, Float

from specs.base import Spec
from specs.data.world import Rectangle, Solid, World

_MARGIN_CM = 8
# What hangs higher is neither met nor seen by a robot on the floor.
_HEAD_M = 1.9
_LETTER_SHARE = 0.56
_LABELS_ACROSS = 30


class RoomDrawing(Spec):
    """A room's floor and its name, in page units."""

    x: int
    y: int
    width: int
    height: int
    label: str


class FloorDrawing(Spec):
    """A world from above.

    Attributes:
        view_box: For the SVG.
        x: Left edge of the view box; ``width`` and ``height`` are its size.
        letter: Height of letters that can be read when the drawing is as wide as a phone.
        furniture: Path data of all pieces; ``walls`` and ``doors`` likewise.
    """

    view_box: str
    x: int
    width: int
    height: int
    letter: int
    rooms: tuple[RoomDrawing, ...]
    walls: str
    doors: str
    furniture: str


def draw_floor(world: World) -> FloorDrawing:
    """Returns the drawing of a world."""
    x, y, width, height = _box(world.footprint, _MARGIN_CM)
    letter = max(width, height) // _LABELS_ACROSS
    return FloorDrawing(
        view_box=f"{x} {y} {width} {height}",
        x=x,
        width=width,
        height=height,
        letter=letter,
        rooms=tuple(_room(room.name, room.floor, letter) for room in world.rooms),
        walls=_path(world.walls),
        doors=_path(door.leaf for door in world.doors),
        furniture=_path(solid for piece in world.furniture for solid in piece.solids),
    )


def way_path(way_m: Float[np.ndarray, "points 2"]) -> str:
    """Returns path data through points (x m, y m); whole centimetres, each relative to the one before."""
    points = np.rint(way_m * (100.0, -100.0)).astype(int)
    if not len(points):
        return ""
    steps = np.diff(points, axis=0)
    moved = steps[np.any(steps != 0, axis=1)].tolist()
    return f"M{points[0, 0]} {points[0, 1]}" + ("l" + _pairs(moved) if moved else "h0")


def dots_path(points_m: Float[np.ndarray, "points 2"]) -> str:
    """Returns path data that is a dot at each point, where lines have round ends."""
    return "".join(f"M{x} {y}h0" for x, y in np.rint(points_m * (100.0, -100.0)).astype(int).tolist())


def _pairs(steps: list[list[int]]) -> str:
    # A minus sign separates as well as a space.
    text = " ".join(f"{x} {y}" for x, y in steps)
    return text.replace(" -", "-")


def _path(solids: Iterable[Solid]) -> str:
    low = (solid for solid in solids if solid.center_m[2] - solid.half_extents_m[2] < _HEAD_M)
    return "".join(dict.fromkeys(_outline(solid) for solid in low))


def _outline(solid: Solid) -> str:
    x, y = _cm(solid.center_m[0]), -_cm(solid.center_m[1])
    if solid.shape == "cylinder":
        r = max(1, _cm(solid.half_extents_m[0]))
        return f"M{x - r} {y}a{r} {r} 0 1 0 {2 * r} 0a{r} {r} 0 1 0 {-2 * r} 0z"
    corners = _corners(solid)
    return f"M{corners[0][0]} {corners[0][1]}L" + " ".join(f"{cx} {cy}" for cx, cy in corners[1:]) + "z"


def _corners(solid: Solid) -> list[tuple[int, int]]:
    (x_m, y_m, _), (a_m, b_m, _) = solid.center_m, solid.half_extents_m
    c, s = math.cos(solid.yaw_rad), math.sin(solid.yaw_rad)
    signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    return [(_cm(x_m + i * a_m * c - j * b_m * s), -_cm(y_m + i * a_m * s + j * b_m * c)) for i, j in signs]


def _room(name: str, floor: Rectangle, letter: int) -> RoomDrawing:
    x, y, width, height = _box(floor, 0)
    most = int(width / (_LETTER_SHARE * letter))
    label = name if len(name) <= most else f"{name[: max(1, most - 1)]}…"
    return RoomDrawing(x=x, y=y, width=width, height=height, label=label)


def _box(rectangle: Rectangle, margin: int) -> tuple[int, int, int, int]:
    x, y = _cm(rectangle.x_min_m) - margin, -_cm(rectangle.y_max_m) - margin
    return x, y, _cm(rectangle.x_max_m) + margin - x, -_cm(rectangle.y_min_m) + margin - y


def _cm(metres: float) -> int:
    return round(100.0 * metres)


def simplify(line_m: Float[np.ndarray, "points 2"], tolerance_m: float) -> Float[np.ndarray, "kept 2"]:
    """Returns the first, the last, and as few points between them as keep all others near the line that they make.

    After Douglas and Peucker (1973, Cartographica 10:112): the farthest point from a chord is kept if it is farther
    than the tolerance, and both halves are treated likewise.

    Args:
        line_m: Points (x, y) in order.
        tolerance_m: How far a point that is left out may be from the chord that replaces it.
    """
    if len(line_m) < 3:
        return line_m
    keep = np.zeros(len(line_m), bool)
    keep[[0, -1]] = True
    _mark(line_m, keep, tolerance_m)
    return line_m[keep]


def fit_line(line_m: Float[np.ndarray, "points 2"], tolerance_m: float, most: int) -> Float[np.ndarray, "kept 2"]:
    """Returns the line with as few points as `simplify` leaves, coarser where those were more than ``most``."""
    kept = simplify(line_m, tolerance_m)
    while len(kept) > max(2, most):
        tolerance_m *= 2.0
        kept = simplify(kept, tolerance_m)
    return kept


def _mark(line_m: Float[np.ndarray, "points 2"], keep: Bool[np.ndarray, " points"], tolerance_m: float) -> None:
    waiting = [(0, len(line_m) - 1)]
    while waiting:
        first, last = waiting.pop()
        if last - first < 2:
            continue
        away_m = _distances(line_m[first + 1 : last], line_m[first], line_m[last])
        farthest = int(np.argmax(away_m))
        if away_m[farthest] > tolerance_m:
            middle = first + 1 + farthest
            keep[middle] = True
            waiting += [(first, middle), (middle, last)]


def _distances(
    points_m: Float[np.ndarray, "points 2"], begin_m: Float[np.ndarray, "2"], end_m: Float[np.ndarray, "2"]
) -> Float[np.ndarray, " points"]:
    """Returns how far points are from a segment, which may be one point."""
    along = end_m - begin_m
    length2 = float(along @ along)
    share = np.clip((points_m - begin_m) @ along / length2, 0.0, 1.0) if length2 else np.zeros(len(points_m))
    nearest = begin_m + share[:, None] * along
    return np.hypot(*(points_m - nearest).T)
