"""Where a group might go: along the lines at which backs stand, flush against something, or in the room's middle."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from tasks.worlds.furnishing.groups.group import FurnitureGroup
from tasks.worlds.furnishing.scene import LineTable, RoomScene
from tasks.worlds.geometry.boxes import EPSILON_M, Box, find_meetings

_WALL_GAP_M = 0.02
_SIDE_GAP_M = 0.06
_LOOSE = 3
"""Places by chance on each line, besides those that touch something."""
_BESIDE_HELD = 0.6
_TWICE = np.array([0, 1, 0, 1])
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


_Place = tuple[float, int, float]
"""How far along a line, which line, and how well it is held there."""


class _Along(NamedTuple):
    """Places on lines: how far along which line each is, and how well it is held there."""

    along: Float[np.ndarray, " many"]
    line: Int[np.ndarray, " many"]
    held: Float[np.ndarray, " many"]


def find_spots(rng: np.random.Generator, scene: RoomScene, group: FurnitureGroup) -> Spots:
    """Returns the places to try for a group, at which its first member stands in nobody's way.

    Every place on a line can be slid along it until the group touches something, so trying what touches something is
    nearly as good as trying all.
    """
    return _in_room(rng, scene, group) if group.anchor == "center" else _at_lines(rng, scene, group)


def _stands(
    scene: RoomScene,
    group: FurnitureGroup,
    centers: Float[np.ndarray, "2 many"],
    quarters: Int[np.ndarray, " many"],
) -> Bool[np.ndarray, " many"]:
    """Returns at which places the first member is on the floor and meets nothing."""
    boxes = centers[_TWICE] + group.boxes[..., 0].take(quarters, axis=1)
    return np.logical_not(find_meetings(boxes, scene.barred[:, : scene.bars_low]).any(axis=1))


def _at_lines(rng: np.random.Generator, scene: RoomScene, group: FurnitureGroup) -> Spots:
    lines = scene.table.only(group.quarters, walls=group.walls_only)
    found = _along_lines(rng, scene, group, lines)
    line, along = found.line, found.along.round(3)
    across = (lines.at + lines.inward * (_WALL_GAP_M - group.reach[0].y_min)).round(3)[line]
    upright, quarters = (lines.axis == 1)[line], lines.quarter[line]
    centers = np.array([np.where(upright, across, along), np.where(upright, along, across)])
    free = _stands(scene, group, centers, quarters).nonzero()[0]
    line = line[free]
    aside = np.abs(2 * (found.along[free] - lines.start[line]) / (lines.end - lines.start)[line] - 1)
    return Spots(centers[:, free].T, quarters[free], found.held[free], aside, lines.wall[line])


def _along_lines(rng: np.random.Generator, scene: RoomScene, group: FurnitureGroup, lines: LineTable) -> _Along:
    """Returns places on each line: at its ends, beside what stands there, in its middle, and a few loose ones.

    There are so few on a line that Python is quicker with them than NumPy.
    """
    near = _beside(scene, group, lines)
    reach = [_ends(lines, box) for box in group.reach[: len(group.members)]]
    places: list[_Place] = []
    for ends in reach:
        places += [(first, n, row[5]) for n, (row, (first, _)) in enumerate(zip(lines.rows, ends, strict=True))]
        places += [(last, n, row[6]) for n, (row, (_, last)) in enumerate(zip(lines.rows, ends, strict=True))]
    for box in group.reach[: len(group.members)]:
        places += _touching(lines, box, near)
    for share in (0.5, *rng.random(_LOOSE).tolist()):
        places += [(first + (last - first) * share, n, 0.0) for n, (first, last) in enumerate(reach[0])]
    places += _below_windows(scene, lines) if group.taste.window else []
    bounds = [(first - EPSILON_M, last + EPSILON_M) for first, last in reach[0]]
    inside = [place for place in places if bounds[place[1]][0] <= place[0] <= bounds[place[1]][1]]
    along, line, held = zip(*inside, strict=True) if inside else ((), (), ())
    return _Along(np.array(along), np.array(line, dtype=np.int64), np.array(held))


def _ends(lines: LineTable, box: Box) -> list[tuple[float, float]]:
    """Returns where a group's middle is when a box of its frame touches the one end of each line, and the other."""
    out, middle = _WALL_GAP_M + box.width / 2, (box.x_min + box.x_max) / 2
    return [(start + out - ahead * middle, end - out - ahead * middle) for _, start, end, _, ahead, _, _ in lines.rows]


def _touching(lines: LineTable, box: Box, near: list[tuple[int, float, float]]) -> list[_Place]:
    """Returns where a group's middle is when a box of its frame stands just before something, and just after it."""
    half, middle = box.width / 2, (box.x_min + box.x_max) / 2
    shifts = [row[4] * middle for row in lines.rows]
    return [
        *((before - half - shifts[n], n, _BESIDE_HELD) for n, before, _ in near),
        *((after + half - shifts[n], n, _BESIDE_HELD) for n, _, after in near),
    ]


def _below_windows(scene: RoomScene, lines: LineTable) -> list[_Place]:
    """Returns the middles of the windows on the lines of the walls that they are in."""
    walls = list(enumerate(zip(lines.quarter.tolist(), lines.wall.tolist(), strict=True)))
    return [
        (sill.middle, n, 0.0)
        for sill in scene.sills
        for n, (quarter, wall) in walls
        if wall and quarter == sill.quarter
    ]


def _beside(scene: RoomScene, group: FurnitureGroup, lines: LineTable) -> list[tuple[int, float, float]]:
    """Returns what is in a group's way on its lines: the line's number, and the ends to stand before and after."""
    depth = group.reach[0].height + _WALL_GAP_M
    gap = 0.0 if group.flush else _SIDE_GAP_M
    found: list[tuple[int, float, float]] = []
    for n, (row, taken) in enumerate(zip(lines.rows, scene.beside(lines), strict=True)):
        low = row[0] if row[3] > 0 else row[0] - depth
        high = low + depth
        found += [
            (n, start - gap, end + gap) for nearest, furthest, start, end in taken if nearest < high and furthest > low
        ]
    return found


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
    fits = ((high >= low).all(axis=1) & _stands(scene, group, centers.T, quarters)).nonzero()[0]
    aside = np.abs(2 * share[fits] - 1).max(axis=1, initial=0.0)
    return Spots(centers[fits], quarters[fits], np.zeros(fits.size), aside, np.ones(fits.size, bool))
