"""One floor plan for a brief: cells, inner walls, passages, and the start at (0, 0)."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np

from tasks.worlds.brief import Brief
from tasks.worlds.geometry import Box
from tasks.worlds.passages import Gap, place_passages
from tasks.worlds.scoring import WALL_M
from tasks.worlds.search import search_layout
from tasks.worlds.slicing import Layouts
from tasks.worlds.streams import floor_plan_stream
from tasks.worlds.windows import Pane

START_CLEAR_M = 1.02
_START_TRIES = 6


@dataclass(frozen=True)
class Cut:
    """An inner wall's centre line: the axis it runs along, where it lies across it, from where to where (metres)."""

    along: Literal["x", "y"]
    at: float
    start: float
    end: float


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
        outline = Box(
            min(cell.x_min for cell in self.cells),
            min(cell.y_min for cell in self.cells),
            max(cell.x_max for cell in self.cells),
            max(cell.y_max for cell in self.cells),
        )
        return outline.grown(WALL_M / 2)


@lru_cache(maxsize=64)
def plan_floor(brief: Brief, seed: int, floorplan_index: int) -> FloorPlan:
    """Returns the floor plan with that index, the same for each of its interiors.

    Raises:
        WorldRejected: InvalidInput, as ``search_layout`` says.
    """
    rng = floor_plan_stream(seed, floorplan_index)
    layout = search_layout(rng, brief)
    cells = [Box(*corners) for corners in layout.cells[0].tolist()]
    gaps = place_passages(rng, brief, cells)
    start_x, start_y = _start(rng, cells, gaps)
    return FloorPlan(
        cells=tuple(_moved(cell, start_x, start_y) for cell in cells),
        cuts=_cuts(layout, start_x, start_y),
        gaps=tuple(gap.shifted(-start_x, -start_y) for gap in gaps),
    )


def _start(rng: np.random.Generator, cells: list[Box], gaps: tuple[Gap, ...]) -> tuple[float, float]:
    """Returns where the robot starts: in the largest room that holds the clear disc, rather near a way out.

    Floor that is kept free for walking anyway is the best place for a disc that must be free.
    """
    floors = [cell.grown(-WALL_M / 2 - START_CLEAR_M) for cell in cells]
    wide = [floor for floor in floors if floor.width >= 0 and floor.height >= 0]
    floor = max(wide, key=lambda each: each.grown(START_CLEAR_M).area)
    exits = [gap.center for gap in gaps if floor.grown(START_CLEAR_M + WALL_M).meets(gap.box(WALL_M))]
    spots = [
        (round(floor.x_min + u * floor.width, 2), round(floor.y_min + v * floor.height, 2))
        for u, v in rng.random((_START_TRIES, 2)).tolist()
    ]
    if not exits:
        return spots[0]
    return min(spots, key=lambda spot: min((spot[0] - x) ** 2 + (spot[1] - y) ** 2 for x, y in exits))


def _moved(cell: Box, start_x: float, start_y: float) -> Box:
    return Box(*(round(side, 2) for side in cell.shifted(-start_x, -start_y)))


def _cuts(layout: Layouts, start_x: float, start_y: float) -> tuple[Cut, ...]:
    cuts: list[Cut] = []
    for (at, start, end), vertical in zip(layout.cuts[0].tolist(), layout.vertical[0].tolist(), strict=True):
        across, along = (start_x, start_y) if vertical else (start_y, start_x)
        sides = (round(at - across, 2), round(start - along, 2), round(end - along, 2))
        cuts.append(Cut("y" if vertical else "x", *sides))
    return tuple(cuts)
