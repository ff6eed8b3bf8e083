"""Walls as boxes: outer walls by room, inner walls with their gaps, lintels above doorways."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

from specs.data.world import Solid
from tasks.worlds.floorplan.floorplan import Cut, FloorPlan
from tasks.worlds.floorplan.passages import Gap
from tasks.worlds.floorplan.scoring import WALL_M
from tasks.worlds.geometry.boxes import EPSILON_M, Box, rounded
from tasks.worlds.materials import Color

LINTEL_BOTTOM_M = 2.1
_HALF = WALL_M / 2


@dataclass(frozen=True)
class _WallPiece:
    """A straight piece of wall: its base on the floor, from what height, and whose colour it has."""

    name: str
    base: Box
    bottom: float
    room: int


def build_walls(plan: FloorPlan, ceiling_height_m: float, colors: Sequence[Color]) -> tuple[Solid, ...]:
    """Returns all walls of a plan, none overlapping another, floor to ceiling but for lintels.

    Args:
        plan: The floor plan.
        ceiling_height_m: Height of every wall.
        colors: Colour of each room's walls; an inner wall takes that of the first room beside it.
    """
    return tuple([Solid.unchecked({**fields, "color": colors[room]}) for fields, room in _bare(plan, ceiling_height_m)])


@lru_cache(maxsize=64)
def _bare(plan: FloorPlan, ceiling_height_m: float) -> tuple[tuple[dict[str, object], int], ...]:
    """Returns the walls without their colours, which alone the interiors of a plan do not share, and their rooms."""
    return tuple([(_fields(piece, ceiling_height_m), piece.room) for piece in [*_outer(plan), *_inner(plan)]])


def _outer(plan: FloorPlan) -> list[_WallPiece]:
    outline = plan.footprint
    sides: tuple[tuple[str, Literal["x", "y"], int, float, float], ...] = (
        ("south", "x", 1, outline.x_min, outline.x_max),
        ("north", "x", 3, outline.x_min, outline.x_max),
        ("west", "y", 0, outline.y_min + WALL_M, outline.y_max - WALL_M),
        ("east", "y", 2, outline.y_min + WALL_M, outline.y_max - WALL_M),
    )
    edge = outline.grown(-_HALF)
    return [
        piece
        for name, along, side, start, end in sides
        for piece in _outer_side(plan, name, Cut(along, edge[side], start, end), side)
    ]


def _outer_side(plan: FloorPlan, name: str, line: Cut, side: int) -> list[_WallPiece]:
    """Returns one side's pieces, a piece for each room behind it; the first and last reach the corners."""
    axis = 0 if line.along == "x" else 1
    rooms = [room for room, cell in enumerate(plan.cells) if abs(cell[side] - line.at) < EPSILON_M]
    rooms.sort(key=lambda room: plan.cells[room][axis])
    borders = [line.start, *(plan.cells[room][axis] for room in rooms[1:]), line.end]
    return [
        _WallPiece(f"wall_{name}_{n + 1}", _strip(line, borders[n], borders[n + 1]), 0.0, room)
        for n, room in enumerate(rooms)
    ]


def _inner(plan: FloorPlan) -> list[_WallPiece]:
    pieces: list[_WallPiece] = []
    for number, cut in enumerate(plan.cuts, start=1):
        room = _first_room_beside(plan, cut)
        gaps = sorted((gap for gap in plan.gaps if _in_wall(gap, cut)), key=lambda gap: _span(gap)[0])
        borders = [cut.start + _HALF, *(edge for gap in gaps for edge in _span(gap)), cut.end - _HALF]
        standing = zip(borders[::2], borders[1::2], strict=True)
        for n, (start, end) in enumerate(standing, start=1):
            pieces.append(_WallPiece(f"wall_inner_{number}_{n}", _strip(cut, start, end), 0.0, room))
        for n, gap in enumerate((gap for gap in gaps if gap.kind == "Doorway"), start=1):
            pieces.append(_WallPiece(f"lintel_{number}_{n}", _strip(cut, *_span(gap)), LINTEL_BOTTOM_M, room))
    return pieces


def _first_room_beside(plan: FloorPlan, cut: Cut) -> int:
    """Returns the first room that has the wall at one of its sides."""
    strip = _strip(cut, cut.start + _HALF, cut.end - _HALF)
    return next(room for room, cell in enumerate(plan.cells) if cell.meets(strip))


def _in_wall(gap: Gap, cut: Cut) -> bool:
    along, across = gap.center if gap.along == "x" else gap.center[::-1]
    return gap.along == cut.along and abs(across - cut.at) < EPSILON_M and cut.start < along < cut.end


def _span(gap: Gap) -> tuple[float, float]:
    middle = gap.center[0] if gap.along == "x" else gap.center[1]
    return middle - gap.width / 2, middle + gap.width / 2


def _strip(line: Cut, start: float, end: float) -> Box:
    if line.along == "x":
        return Box(start, line.at - _HALF, end, line.at + _HALF)
    return Box(line.at - _HALF, start, line.at + _HALF, end)


def _fields(piece: _WallPiece, top: float) -> dict[str, object]:
    """Returns the fields of a wall's solid but for its colour, which is the last one."""
    x, y = piece.base.center
    half = (piece.base.width / 2, piece.base.height / 2, (top - piece.bottom) / 2)
    return {
        "name": piece.name,
        "shape": "box",
        "center_m": (rounded(x), rounded(y), rounded((piece.bottom + top) / 2)),
        "half_extents_m": (rounded(half[0]), rounded(half[1]), rounded(half[2])),
        "yaw_rad": 0.0,
    }
