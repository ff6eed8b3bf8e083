"""Windows in outer walls: data for drawings and renders, the walls stay solid."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from specs.data.world import RoomType
from tasks.worlds.brief import Brief
from tasks.worlds.floorplan.scoring import LIT, WALL_M
from tasks.worlds.geometry.boxes import EPSILON_M, Box, bounding_box

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


def place_windows(brief: Brief, cells: Sequence[Box]) -> tuple[Pane, ...]:
    """Returns the windows of a plan, room by room; a closet has none, and nor has a room without an outer wall."""
    outline = bounding_box(cells)
    return tuple(
        pane
        for room, wish in enumerate(brief.rooms)
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
