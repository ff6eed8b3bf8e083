"""Where a group might go: along the lines at which backs stand, flush against something, or in the room's middle."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from tasks.worlds.furnishing.groups.group import FurnitureGroup
from tasks.worlds.furnishing.scene import LineTable, RoomScene
from tasks.worlds.geometry.boxes import EPSILON_M, Box

_WALL_GAP_M = 0.02
_SIDE_GAP_M = 0.06
_LOOSE = 3
"""Places by chance on each line, besides those that touch something."""
_BESIDE_HELD = 0.6
_NONE, _NO_LINES = np.zeros(0), np.zeros(0, dtype=np.int64)
_IN_ROOM = 40


class Spots(NamedTuple):
    """Places to try: middles and facings, and what is known about each.

    Attributes:
        held: 1 in a corner that lies as the group's does, less in others and beside things, 0 loose.
        aside: How far from the middle of the line, or of the room, 0-1.
        at_wall: Whether it is at a wall, or at no line at all.
    """

    centers: Float[np.ndarray, "many 2"]
    quarters: Int[np.ndarray, " many"]
    held: Float[np.ndarray, " many"]
    aside: Float[np.ndarray, " many"]
    at_wall: Bool[np.ndarray, " many"]


class _Along(NamedTuple):
    """Places on lines: how far along which line each is."""

    along: Float[np.ndarray, " many"]
    line: Int[np.ndarray, " many"]
    held: Float[np.ndarray, " many"]


def find_spots(rng: np.random.Generator, scene: RoomScene, group: FurnitureGroup) -> Spots:
    """Returns the places to try for a group; some may be taken.

    Every place on a line can be slid along it until the group touches something, so trying what touches something is
    nearly as good as trying all.
    """
    if group.anchor == "center":
        return _in_room(rng, scene, group)
    lines = scene.table.only(group.quarters, walls=group.walls_only)
    found = _along_lines(rng, scene, group, lines)
    centers = np.empty((len(found.along), 2))
    each, axis = np.arange(len(found.along)), lines.axis[found.line]
    across = lines.at + lines.inward * (_WALL_GAP_M - group.reach[0].y_min)
    centers[each, axis], centers[each, 1 - axis] = found.along, across[found.line]
    aside = np.abs(2 * (found.along - lines.start[found.line]) / (lines.end - lines.start)[found.line] - 1)
    return Spots(centers.round(3), lines.quarter[found.line], found.held, aside, lines.wall[found.line])


def _along_lines(rng: np.random.Generator, scene: RoomScene, group: FurnitureGroup, lines: LineTable) -> _Along:
    """Returns places on each line: at its ends, beside what stands there, in its middle, and a few loose ones."""
    needed, everyone = group.reach
    first, last = _ends(lines, needed)
    line, before, after = _beside(scene, group, lines)
    ends, touching = [first, last], _touching(lines, needed, line, before, after)
    if len(group.members) > 1:
        ends += _ends(lines, everyone)
        touching += _touching(lines, everyone, line, before, after)
    loose = first + (last - first) * np.concatenate([[0.5], rng.random(_LOOSE)])[:, None]
    below, lit = _below_windows(scene, lines) if group.taste.window else (_NONE, _NO_LINES)
    each = np.arange(len(first))
    along = np.concatenate([*ends, *touching, *loose, below])
    number = np.concatenate([each] * len(ends) + [line] * len(touching) + [each] * len(loose) + [lit])
    held = np.zeros(len(along))
    count = len(each) * len(ends)
    held[:count] = np.concatenate([lines.left, lines.right] * (len(ends) // 2))
    held[count : count + len(line) * len(touching)] = _BESIDE_HELD
    inside = (along >= first[number] - EPSILON_M) & (along <= last[number] + EPSILON_M)
    return _Along(along[inside], number[inside], held[inside])


def _ends(lines: LineTable, box: Box) -> list[Float[np.ndarray, " lines"]]:
    """Returns where a group's middle is when a box of its frame touches either end of each line."""
    shift, half = lines.ahead * ((box.x_min + box.x_max) / 2), box.width / 2
    return [lines.start + (_WALL_GAP_M + half) - shift, lines.end - (_WALL_GAP_M + half) - shift]


def _touching(
    lines: LineTable,
    box: Box,
    line: Int[np.ndarray, " some"],
    before: Float[np.ndarray, " some"],
    after: Float[np.ndarray, " some"],
) -> list[Float[np.ndarray, " some"]]:
    """Returns where a group's middle is when a box of its frame stands just before or after something."""
    shift, half = (lines.ahead * ((box.x_min + box.x_max) / 2))[line], box.width / 2
    return [before - half - shift, after + half - shift]


def _below_windows(
    scene: RoomScene, lines: LineTable
) -> tuple[Float[np.ndarray, " windows"], Int[np.ndarray, " windows"]]:
    """Returns the middles of the windows, and the lines of the walls that they are in."""
    middles = np.array([sill.middle for sill in scene.sills], dtype=np.float64)
    quarters = np.array([sill.quarter for sill in scene.sills], dtype=np.int64)
    window, line = np.nonzero((quarters[:, None] == lines.quarter) & lines.wall)
    return middles[window], line


def _beside(
    scene: RoomScene, group: FurnitureGroup, lines: LineTable
) -> tuple[Int[np.ndarray, " some"], Float[np.ndarray, " some"], Float[np.ndarray, " some"]]:
    """Returns what is in a group's way on its lines: the line's number, and the ends to stand before and after."""
    depth = group.reach[0].height + _WALL_GAP_M
    low = np.where(lines.inward > 0, lines.at, lines.at - depth)[:, None]
    sides, across = scene.taken, 1 - lines.axis
    near = (sides[across] < low + depth) & (sides[across + 2] > low)
    line, box = near.nonzero()
    axis = lines.axis[line]
    gap = 0.0 if group.flush else _SIDE_GAP_M
    return line, sides[axis, box] - gap, sides[axis + 2, box] + gap


def _in_room(rng: np.random.Generator, scene: RoomScene, group: FurnitureGroup) -> Spots:
    """Returns places in the room, among them its middle."""
    floor = scene.floor
    quarters = np.array(group.quarters)[rng.integers(0, len(group.quarters), _IN_ROOM)]
    around = group.boxes[:, quarters][..., group.needed]
    low = np.array(floor[:2]) + _WALL_GAP_M - around[:2].min(axis=2).T
    high = np.array(floor[2:]) - _WALL_GAP_M - around[2:].max(axis=2).T
    share = rng.random((_IN_ROOM, 2))
    share[: len(group.quarters) * 2] = 0.5
    centers = np.round(low + share * (high - low), 2)
    fits = (high >= low).all(axis=1)
    aside = np.abs(2 * share - 1).max(axis=1)
    return Spots(centers[fits], quarters[fits], np.zeros(int(fits.sum())), aside[fits], np.ones(int(fits.sum()), bool))
