"""Slicing plans: every way to cut a rectangle into rooms, up to mirror images.

A slicing plan is a tree: a piece is cut from side to side into parts, those are cut across, and so on (Otten 1982,
"Automatic floorplan design"). There are few enough of them for up to six rooms to try them all: one, 2, 6, 22, 90 and
394 (the Schröder numbers) times the orders of the rooms, and a quarter of that when mirror images count once. What
slicing leaves out are pinwheels, 2 more of five rooms and 28 of six. They were tried (all Baxter permutations, areas
solved for): over 17 templates of five and six rooms the best pinwheel beat the best slicing plan for one only, the
complete graph of five, and there by shapes alone.

Axes: ``places`` of a shape, ``lines`` (places + 3), and ``labelings``, ways to put rooms into places.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import permutations, product
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float, Int

Form: TypeAlias = "tuple[Form, ...]"
"""Parts of a piece in a row, each cut across in its turn; a room has no parts."""
OUTLINE = (0, 1, 2, 3)
"""The lines around the whole: lowest x, lowest y, highest x, highest y."""


@dataclass(frozen=True)
class Step:
    """One cut: the line that it makes, between which two it lies, and the places first to at - 1 | at to last - 1."""

    line: int
    low: int
    high: int
    first: int
    at: int
    last: int


@dataclass(frozen=True)
class Shape:
    """A slicing plan without sizes and names.

    Attributes:
        sides: The lines at the lowest x, lowest y, highest x and highest y of each place.
        vertical: Whether a line runs along y.
        steps: The cuts, each after those that make its piece.
        symmetries: For each mirror image that is the shape itself, the place that comes to stand at each place.
    """

    sides: Int[np.ndarray, "places 4"]
    vertical: Bool[np.ndarray, " lines"]
    steps: tuple[Step, ...]
    symmetries: tuple[tuple[int, ...], ...]

    def faces(self) -> Bool[np.ndarray, "places places"]:
        """Returns which places lie at opposite sides of one line, and so can have a wall in common."""
        low, high = self.sides[:, None, :2], self.sides[None, :, 2:]
        touching = np.asarray((low == high).any(axis=-1))
        return touching | touching.T


@dataclass
class _Draft:
    """A shape while it is cut."""

    sides: list[tuple[int, ...]] = field(default_factory=list[tuple[int, ...]])
    vertical: list[bool] = field(default_factory=lambda: [True, False, True, False])
    steps: list[Step] = field(default_factory=list[Step])

    def cut(self, form: Form, axis: int, around: tuple[int, ...]) -> None:
        """Cuts the piece between four lines along an axis (0: into columns), and its parts across."""
        if not form:
            self.sides.append(around)
            return
        lines = [around[axis], *(len(self.vertical) + n for n in range(len(form) - 1)), around[axis + 2]]
        self.vertical += [axis == 0] * (len(form) - 1)
        at = first = len(self.sides)
        last = first + sum(map(_size, form))
        for line, part in zip(lines[1:-1], form, strict=False):
            at += _size(part)
            self.steps.append(Step(line, around[axis], around[axis + 2], first, at, last))
        for n, part in enumerate(form):
            inside = list(around)
            inside[axis], inside[axis + 2] = lines[n], lines[n + 1]
            self.cut(part, 1 - axis, tuple(inside))


@lru_cache(maxsize=8)
def shapes(rooms: int) -> tuple[Shape, ...]:
    """Returns every slicing plan for so many rooms, one of each family of mirror images."""
    found: list[Shape] = []
    for form in _forms(rooms):
        for axis in (0, 1) if rooms > 1 else (0,):
            images = {flips: _mirror(form, axis, flips) for flips in ((0,), (1,), (0, 1))}
            if any(image < form for image in images.values()):
                continue
            draft = _Draft()
            draft.cut(form, axis, OUTLINE)
            symmetries = (tuple(_places(form, axis, flips)) for flips, image in images.items() if image == form)
            moving = tuple(each for each in symmetries if each != tuple(range(rooms)))
            found.append(Shape(np.array(draft.sides), np.array(draft.vertical), tuple(draft.steps), moving))
    return tuple(found)


@lru_cache(maxsize=512)
def _orders(symmetries: tuple[tuple[int, ...], ...], rooms: int) -> Int[np.ndarray, "places labelings"]:
    orders = np.array(list(permutations(range(rooms)))).T
    first = np.ones(orders.shape[1], dtype=bool)
    for moved in symmetries:
        place = next(n for n, other in enumerate(moved) if other != n)
        first &= orders[place] < orders[moved[place]]
    return np.ascontiguousarray(orders[:, first])


def labelings(shape: Shape) -> Int[np.ndarray, "places labelings"]:
    """Returns the room at each place, for all ways to put rooms into a shape that are no mirror images of others."""
    return _orders(shape.symmetries, len(shape.sides))


def lay_out(shape: Shape, areas_m2: Float[np.ndarray, "places labelings"]) -> Float[np.ndarray, "lines labelings"]:
    """Returns where the lines of a square plan lie whose places have these areas exactly (metres)."""
    places, count = areas_m2.shape
    summed = np.zeros((places + 1, count))
    np.cumsum(areas_m2, axis=0, out=summed[1:])
    lines = np.zeros((places + 3, count))
    lines[2] = lines[3] = np.sqrt(summed[-1])
    for step in shape.steps:
        share = (summed[step.at] - summed[step.first]) / (summed[step.last] - summed[step.first])
        lines[step.line] = lines[step.low] + share * (lines[step.high] - lines[step.low])
    return lines


def _forms(rooms: int) -> list[Form]:
    """Returns all trees with that many leaves in which every piece has two parts or more."""
    if rooms == 1:
        return [()]
    return [parts for sizes in _compositions(rooms) for parts in product(*map(_forms, sizes))]


def _compositions(rooms: int) -> Iterator[tuple[int, ...]]:
    """Yields the ways to write a number as a sum of two or more."""
    for first in range(1, rooms):
        yield first, rooms - first
        for rest in _compositions(rooms - first):
            yield first, *rest


def _size(form: Form) -> int:
    return sum(map(_size, form)) if form else 1


def _mirror(form: Form, axis: int, flips: tuple[int, ...]) -> Form:
    """Returns the mirror image of a piece that is cut along an axis, the axes in flips turned round."""
    parts = tuple(_mirror(part, 1 - axis, flips) for part in form)
    return parts[::-1] if axis in flips else parts


def _places(form: Form, axis: int, flips: tuple[int, ...], first: int = 0) -> list[int]:
    """Returns the places of a piece in the order in which they stand in its mirror image."""
    if not form:
        return [first]
    parts: list[list[int]] = []
    for part in form:
        parts.append(_places(part, 1 - axis, flips, first))
        first += _size(part)
    return [place for part in (parts[::-1] if axis in flips else parts) for place in part]
