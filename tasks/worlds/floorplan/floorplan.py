"""One floor plan of a template: cells, inner walls, passages, windows, the start at (0, 0), and its walls as boxes.

Windows are data for drawings and renders; the walls stay solid there.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

from specs.data.world import RoomType, Solid
from tasks.worlds.floorplan.passages import Gap, choose_start, hindrance, place_passages
from tasks.worlds.floorplan.scoring import LIT, WALL_M, Layouts
from tasks.worlds.floorplan.search import WorldRejected, draw_layout
from tasks.worlds.geometry import EPSILON_M, Box, bounding_box, rounded
from tasks.worlds.materials import Color
from tasks.worlds.resolved_template import ResolvedTemplate
from tasks.worlds.streams import floor_plan_stream

GLAZING_SHARE = 0.08
"""Least glazing of a habitable room over its floor area (International Residential Code R303.1)."""
HEAD_M = 2.1
"""Upper edge, that of doorways."""
_WIDTH_MAX_M, _WIDTH_MIN_M, _WIDTH_STEP_M = 2.0, 0.6, 0.1
# Left standing beside a window: at least half of it at the corners of a room, and this much between two windows.
_BETWEEN_M = 0.3
_CORNER_M = 0.15
# Sills: above a robot's lidar, above worktops, above eyes.
_SILLS_M: dict[RoomType, float] = {"Kitchen": 1.1, "Bathroom": 1.5}
_SILL_M = 0.9
# Glazing of other rooms (m2): of bathrooms 0.3 (R303.3), of hallways as much.
_SMALL_M2: dict[RoomType, float] = {"Bathroom": 0.3, "Hallway": 0.3}
_ATTEMPTS = 8
LINTEL_BOTTOM_M = 2.1
_HALF = WALL_M / 2


@dataclass(frozen=True)
class Pane:
    """A window as geometry: its room by index, its middle on the wall's centre line, and the axis of its wall."""

    room: int
    center: tuple[float, float]
    width: float
    along: Literal["x", "y"]
    bottom: float
    top: float

    def shifted(self, dx_m: float, dy_m: float) -> "Pane":
        """Returns the window moved, in whole millimetres."""
        return replace(self, center=(round(self.center[0] + dx_m, 3), round(self.center[1] + dy_m, 3)))


@dataclass(frozen=True)
class _Side:
    """A stretch of outer wall behind one room."""

    along: Literal["x", "y"]
    at: float
    start: float
    end: float

    def fits(self, width: float) -> int:
        """Returns how many windows of a width there is wall for."""
        return int((self.end - self.start + EPSILON_M) / (width + _BETWEEN_M))


def place_windows(resolved: ResolvedTemplate, cells: Sequence[Box]) -> tuple[Pane, ...]:
    """Returns the windows of a plan, room by room; a closet has none, and nor has a room without an outer wall."""
    outline = bounding_box(cells)
    return tuple(
        pane
        for room, wish in enumerate(resolved.rooms)
        for pane in _windows(room, wish.type, cells[room], _sides(cells[room], outline))
    )


def _windows(room: int, kind: RoomType, cell: Box, sides: list[_Side]) -> list[Pane]:
    """Returns a room's windows: enough glazing, in as few windows and walls as hold it."""
    sill = _SILLS_M.get(kind, _SILL_M)
    glazing = GLAZING_SHARE * cell.grown(-WALL_M / 2).area if kind in LIT else _SMALL_M2.get(kind, 0.0)
    if glazing == 0.0 or not sides:
        return []
    needed = glazing / (HEAD_M - sill)
    sides = sorted(sides, key=lambda side: side.start - side.end)
    width, count = _choose_width(needed, sides)
    panes: list[Pane] = []
    for side in sides:
        here = min(side.fits(width), count - len(panes))
        for n in range(here):
            middle = round(side.start + (n + 0.5) * (side.end - side.start) / here, 2)
            center = (middle, side.at) if side.along == "x" else (side.at, middle)
            panes.append(Pane(room, center, width, side.along, sill, HEAD_M))
    return panes


def _choose_width(needed: float, sides: Sequence[_Side]) -> tuple[float, int]:
    """Returns how wide windows are and how many: the fewest that are enough, or as many wide ones as the walls hold."""
    first = math.ceil(needed / _WIDTH_MAX_M - EPSILON_M)
    for count in range(first, 4 * first + 4):
        width = max(math.ceil(needed / count / _WIDTH_STEP_M - EPSILON_M) * _WIDTH_STEP_M, _WIDTH_MIN_M)
        if sum(side.fits(width) for side in sides) >= count:
            return round(width, 2), count
    steps = range(round(_WIDTH_MIN_M / _WIDTH_STEP_M), round(_WIDTH_MAX_M / _WIDTH_STEP_M) + 1)
    widths = [round(step * _WIDTH_STEP_M, 2) for step in steps]
    glazed = [width * sum(side.fits(width) for side in sides) for width in widths]
    best = widths[glazed.index(max(glazed))]
    return best, sum(side.fits(best) for side in sides)


def _sides(cell: Box, outline: Box) -> list[_Side]:
    """Returns the outer walls of a cell, without its corners."""
    inner = cell.grown(-WALL_M / 2 - _CORNER_M)
    every = (
        _Side("x", cell.y_min, inner.x_min, inner.x_max) if cell.y_min < outline.y_min + EPSILON_M else None,
        _Side("x", cell.y_max, inner.x_min, inner.x_max) if cell.y_max > outline.y_max - EPSILON_M else None,
        _Side("y", cell.x_min, inner.y_min, inner.y_max) if cell.x_min < outline.x_min + EPSILON_M else None,
        _Side("y", cell.x_max, inner.y_min, inner.y_max) if cell.x_max > outline.x_max - EPSILON_M else None,
    )
    return [side for side in every if side]


@dataclass(frozen=True)
class Cut:
    """An inner wall's centre line: the axis it runs along, where it lies across it, from where to where (metres)."""

    along: Literal["x", "y"]
    at: float
    start: float
    end: float

    def shifted(self, dx_m: float, dy_m: float) -> "Cut":
        """Returns the wall moved, in whole centimetres."""
        across, along = (dx_m, dy_m) if self.along == "y" else (dy_m, dx_m)
        return Cut(self.along, round(self.at + across, 2), round(self.start + along, 2), round(self.end + along, 2))


@dataclass(frozen=True)
class FloorPlan:
    """A floor plan, with the start at (0, 0).

    Attributes:
        cells: Each room's rectangle between wall centre lines, in the template's order.
        gaps: The passages.
        windows: The windows.
    """

    cells: tuple[Box, ...]
    cuts: tuple[Cut, ...]
    gaps: tuple[Gap, ...]
    windows: tuple[Pane, ...] = ()

    @property
    def floors(self) -> tuple[Box, ...]:
        """Each room's floor between the faces of its walls."""
        return tuple(cell.grown(-WALL_M / 2) for cell in self.cells)

    @property
    def footprint(self) -> Box:
        """The outer faces of the outer walls."""
        return bounding_box(self.cells).grown(WALL_M / 2)


@lru_cache(maxsize=64)
def plan_floor(resolved: ResolvedTemplate, seed: int, floorplan_index: int, redraw: int = 0) -> FloorPlan:
    """Returns the floor plan with that index, the same for each of its interiors.

    Its walls alone leave the start's clear disc free and let the template's robot into every room.

    Args:
        resolved: What the template asks for.
        seed: At least 0.
        floorplan_index: From 1.
        redraw: Another number gives another plan of the same index.

    Raises:
        WorldRejected: InvalidInput, when no layout found does.
    """
    found = ""
    for attempt in range(redraw * _ATTEMPTS, (redraw + 1) * _ATTEMPTS):
        rng = floor_plan_stream(seed, floorplan_index, attempt)
        layout = draw_layout(rng, resolved)
        cells = [Box(*corners) for corners in layout.cells()[:, :, 0].T.tolist()]
        gaps = place_passages(rng, resolved, cells)
        start = choose_start(rng, resolved, cells, gaps)
        found = hindrance(resolved, cells, gaps, start)
        if start is not None and not found:
            dx, dy = -start[0], -start[1]
            return FloorPlan(
                cells=tuple(Box(*(round(side, 2) for side in cell.shifted(dx, dy))) for cell in cells),
                cuts=tuple(_cut(layout, line, cells).shifted(dx, dy) for line in range(4, len(layout.lines))),
                gaps=tuple(gap.shifted(dx, dy) for gap in gaps),
                windows=tuple(pane.shifted(dx, dy) for pane in place_windows(resolved, cells)),
            )
    raise WorldRejected("InvalidInput", f"no floor plan of {_ATTEMPTS} can be driven through: {found}")


def _cut(layout: Layouts, line: int, cells: Sequence[Box]) -> Cut:
    """Returns the inner wall on a line: as long as the rooms that it bounds reach along it."""
    along = 1 if layout.vertical[line, 0] else 0
    beside = [cells[room] for room, at in enumerate(layout.sides[:, :, 0].tolist()) if line in at]
    start, end = min(cell[along] for cell in beside), max(cell[along + 2] for cell in beside)
    return Cut("y" if along else "x", float(layout.lines[line, 0]), start, end)


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
    return tuple(
        [
            Solid.unchecked({**fields, "color": colors[room], "outline_m": None})
            for fields, room in _bare(plan, ceiling_height_m)
        ]
    )


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
        strip = _strip(cut, cut.start + _HALF, cut.end - _HALF)
        room = next(room for room, cell in enumerate(plan.cells) if cell.meets(strip))
        gaps = sorted((gap for gap in plan.gaps if _in_wall(gap, cut)), key=lambda gap: _span(gap)[0])
        borders = [cut.start + _HALF, *(edge for gap in gaps for edge in _span(gap)), cut.end - _HALF]
        standing = zip(borders[::2], borders[1::2], strict=True)
        for n, (start, end) in enumerate(standing, start=1):
            pieces.append(_WallPiece(f"wall_inner_{number}_{n}", _strip(cut, start, end), 0.0, room))
        for n, gap in enumerate((gap for gap in gaps if gap.kind == "Doorway"), start=1):
            pieces.append(_WallPiece(f"lintel_{number}_{n}", _strip(cut, *_span(gap)), LINTEL_BOTTOM_M, room))
    return pieces


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
