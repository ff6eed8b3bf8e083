"""Slicing trees in bulk: thousands of ways to cut a rectangle into rooms, evaluated at once.

A tree is an order of the rooms and an order of cuts between neighbours in it; a cut divides the piece that holds it
in proportion to the areas on both sides, so areas are exact by construction (Otten 1982, "Automatic floorplan
design"). Axes: ``trees``, ``rooms``, and ``cuts`` = rooms - 1.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

# Fixed-point iteration from wall-less to walled areas; the error shrinks by about wall / room width each time.
AREA_PASSES = 8


@dataclass(frozen=True)
class Trees:
    """Slicing trees.

    Attributes:
        order: Which room stands at which place.
        position: For each cut, in the order they are made, the place before which it separates.
        vertical: Whether a cut runs along y (separating left from right).
        aspect: Width over height of the rectangle that is cut.
    """

    order: Int[np.ndarray, "trees rooms"]
    position: Int[np.ndarray, "trees cuts"]
    vertical: Bool[np.ndarray, "trees cuts"]
    aspect: Float[np.ndarray, " trees"]

    def __getitem__(self, chosen: Int[np.ndarray, " some"]) -> "Trees":
        """Returns some of the trees."""
        return Trees(self.order[chosen], self.position[chosen], self.vertical[chosen], self.aspect[chosen])


@dataclass(frozen=True)
class Layouts:
    """What trees cut: cells from wall centre line to wall centre line, and the cuts (metres).

    Attributes:
        cells: x_min, y_min, x_max, y_max of each room's cell; the rectangle's lower left corner is the origin.
        cuts: Where each cut lies across its direction, where it starts and where it ends along it.
        vertical: Whether a cut runs along y.
    """

    cells: Float[np.ndarray, "trees rooms 4"]
    cuts: Float[np.ndarray, "trees cuts 3"]
    vertical: Bool[np.ndarray, "trees cuts"]

    def __getitem__(self, chosen: Int[np.ndarray, " some"]) -> "Layouts":
        """Returns some of the layouts."""
        return Layouts(self.cells[chosen], self.cuts[chosen], self.vertical[chosen])


def random_trees(rng: np.random.Generator, rooms: int, aspect: Float[np.ndarray, " trees"]) -> Trees:
    """Returns random trees for that many rooms, one for each aspect ratio."""
    count = aspect.shape[0]
    return Trees(
        order=np.argsort(rng.random((count, rooms)), axis=1, kind="stable"),
        position=1 + np.argsort(rng.random((count, rooms - 1)), axis=1, kind="stable"),
        vertical=rng.random((count, rooms - 1)) < 0.5,
        aspect=aspect,
    )


def lay_out(trees: Trees, areas_m2: Float[np.ndarray, " rooms"], wall_m: float, passes: int) -> Layouts:
    """Returns the layouts whose rooms have the wanted floor area between the faces of their walls.

    A room of area A in a cell of w x h has A = (w - t)(h - t), so cells are cut for wh = A + t(w + h) - t^2 with w
    and h of the pass before.

    Args:
        trees: The trees.
        areas_m2: Wanted floor area by room.
        wall_m: Wall thickness t.
        passes: Corrections for the thickness; 1 is right to a few percent, ``AREA_PASSES`` to a millionth.
    """
    side = np.sqrt(areas_m2) + wall_m
    cell_areas = np.broadcast_to(side * side, trees.order.shape)
    layouts = _cut(trees, cell_areas)
    for _ in range(passes):
        extent = layouts.cells[..., 2:] - layouts.cells[..., :2]
        cell_areas = areas_m2 + wall_m * (extent[..., 0] + extent[..., 1]) - wall_m * wall_m
        layouts = _cut(trees, cell_areas)
    return layouts


def _cut(trees: Trees, cell_areas: Float[np.ndarray, "trees rooms"]) -> Layouts:
    """Returns the layouts for given cell areas, by making every tree's first cut, then every tree's second, ..."""
    count, rooms = trees.order.shape
    every, place = np.arange(count), np.arange(rooms)
    summed = np.zeros((count, rooms + 1))
    np.cumsum(np.take_along_axis(cell_areas, trees.order, axis=1), axis=1, out=summed[:, 1:])
    width = np.sqrt(summed[:, -1] * trees.aspect)
    first, last = np.zeros((count, rooms), dtype=int), np.full((count, rooms), rooms)
    # Lower and upper sides of every cell, by axis (x, y).
    low = [np.zeros((count, rooms)), np.zeros((count, rooms))]
    high = [np.repeat(each[:, None], rooms, axis=1) for each in (width, summed[:, -1] / width)]
    cuts = np.zeros((count, rooms - 1, 3))
    for cut in range(rooms - 1):
        at, vertical = trees.position[:, cut], trees.vertical[:, cut]
        begin, end = first[every, at], last[every, at]
        share = (summed[every, at] - summed[every, begin]) / (summed[every, end] - summed[every, begin])
        sides = [(low[axis][every, at], high[axis][every, at]) for axis in (0, 1)]
        x, y = (start + share * (stop - start) for start, stop in sides)
        before = (place >= begin[:, None]) & (place < at[:, None])
        after = (place >= at[:, None]) & (place < end[:, None])
        for axis, line, mine in ((0, x, vertical), (1, y, ~vertical)):
            high[axis] = np.where(before & mine[:, None], line[:, None], high[axis])
            low[axis] = np.where(after & mine[:, None], line[:, None], low[axis])
        last = np.where(before, at[:, None], last)
        first = np.where(after, at[:, None], first)
        cuts[:, cut, 0] = np.where(vertical, x, y)
        cuts[:, cut, 1] = np.where(vertical, sides[1][0], sides[0][0])
        cuts[:, cut, 2] = np.where(vertical, sides[1][1], sides[0][1])
    by_room = np.empty((count, rooms, 4))
    np.put_along_axis(by_room, trees.order[:, :, None], np.stack([*low, *high], axis=2), axis=1)
    return Layouts(by_room, cuts, trees.vertical)
