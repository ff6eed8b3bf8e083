"""One floor plan for a brief: cells, inner walls, passages, windows, and the start at (0, 0)."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

from tasks.worlds.brief import Brief
from tasks.worlds.floorplan.passages import Gap, place_passages
from tasks.worlds.floorplan.room_layouts import Layouts
from tasks.worlds.floorplan.scoring import WALL_M
from tasks.worlds.floorplan.search import draw_layout
from tasks.worlds.floorplan.start import START_CLEAR_M, choose_start, hindrance
from tasks.worlds.floorplan.windows import Pane, place_windows
from tasks.worlds.geometry.boxes import Box, bounding_box
from tasks.worlds.rejection import WorldRejected
from tasks.worlds.streams import floor_plan_stream

__all__ = ["START_CLEAR_M", "Cut", "FloorPlan", "plan_floor"]
_ATTEMPTS = 8


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
        cells: Each room's rectangle between wall centre lines, in the brief's order.
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
def plan_floor(brief: Brief, seed: int, floorplan_index: int, redraw: int = 0) -> FloorPlan:
    """Returns the floor plan with that index, the same for each of its interiors.

    Its walls alone leave the start's clear disc free and let the brief's robot into every room.

    Args:
        brief: What the template asks for.
        seed: At least 0.
        floorplan_index: From 1.
        redraw: Another number gives another plan of the same index.

    Raises:
        WorldRejected: InvalidInput, when no layout found does.
    """
    found = ""
    for attempt in range(redraw * _ATTEMPTS, (redraw + 1) * _ATTEMPTS):
        rng = floor_plan_stream(seed, floorplan_index, attempt)
        layout = draw_layout(rng, brief)
        cells = [Box(*corners) for corners in layout.cells()[:, :, 0].T.tolist()]
        gaps = place_passages(rng, brief, cells)
        start = choose_start(rng, brief, cells, gaps)
        found = hindrance(brief, cells, gaps, start)
        if start is not None and not found:
            return _move_to_start(brief, layout, cells, gaps, start)
    raise WorldRejected("InvalidInput", f"no floor plan of {_ATTEMPTS} can be driven through: {found}")


def _move_to_start(
    brief: Brief, layout: Layouts, cells: Sequence[Box], gaps: Sequence[Gap], start: tuple[float, float]
) -> FloorPlan:
    """Returns the plan with the start as its origin."""
    dx, dy = -start[0], -start[1]
    return FloorPlan(
        cells=tuple(Box(*(round(side, 2) for side in cell.shifted(dx, dy))) for cell in cells),
        cuts=tuple(_cut(layout, line, cells).shifted(dx, dy) for line in range(4, len(layout.lines))),
        gaps=tuple(gap.shifted(dx, dy) for gap in gaps),
        windows=tuple(pane.shifted(dx, dy) for pane in place_windows(brief, cells)),
    )


def _cut(layout: Layouts, line: int, cells: Sequence[Box]) -> Cut:
    """Returns the inner wall on a line: as long as the rooms that it bounds reach along it."""
    along = 1 if layout.vertical[line, 0] else 0
    beside = [cells[room] for room, at in enumerate(layout.sides[:, :, 0].tolist()) if line in at]
    start, end = min(cell[along] for cell in beside), max(cell[along + 2] for cell in beside)
    return Cut("y" if along else "x", float(layout.lines[line, 0]), start, end)
