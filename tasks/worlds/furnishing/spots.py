"""Where a group fits: along the lines at which backs stand, flush against something, or in the room's middle.

There are some fifty places to try, and most have something in the way. On a line, what is in the way of a box is a few
intervals, with which Python is quicker than NumPy.
"""

from operator import itemgetter
from typing import NamedTuple

import numpy as np

from tasks.worlds.furnishing.groups.group import FurnitureGroup
from tasks.worlds.furnishing.scene import BackLine, RoomScene
from tasks.worlds.furnishing.slides import first_slide, mid_room, other_slides
from tasks.worlds.geometry.boxes import EPSILON_M, Box, bounding_box

_WALL_GAP_M = 0.02
_SIDE_GAP_M = 0.06
_LOOSE = 3
"""Places by chance on each line, besides those that touch something."""
_BESIDE_HELD = 0.6
_IN_ROOM = 40


class Spot(NamedTuple):
    """A place where a group fits.

    Attributes:
        center: The middle of its frame.
        quarter: Which way it faces.
        held: 1 in a corner that lies as the group's does, less in others and beside things, 0 loose.
        aside: How far from the middle of the line, or of the room, 0-1.
        at_wall: Whether it is at a wall, or at no line at all.
        free: Which of its members there is room for.
    """

    center: tuple[float, float]
    quarter: int
    held: float
    aside: float
    at_wall: bool
    free: list[bool]


_Found = tuple[int, Spot]
"""A place, and its rank among all that are tried."""
_rank = itemgetter(0)


def find_spots(rng: np.random.Generator, scene: RoomScene, group: FurnitureGroup) -> list[Spot]:
    """Returns the places, of those that are tried, that have room for what a group needs.

    Every place on a line can be slid along it until the group touches something, so trying what touches something is
    nearly as good as trying all.
    """
    if group.anchor == "center":
        return _in_room(rng, scene, group)
    loose = [0.5, *rng.random(_LOOSE).tolist()]
    found: list[_Found] = []
    for line in scene.lines:
        if line.quarter in group.quarters and (line.wall or not group.walls_only):
            found += _at_line(scene, group, line, loose)
    found.sort(key=_rank)
    return [spot for _, spot in found]


def _at_line(scene: RoomScene, group: FurnitureGroup, line: BackLine, loose: list[float]) -> list[_Found]:
    """Returns the places on a line.

    Args:
        scene: The room.
        group: The group.
        line: The line.
        loose: Shares of the line at which it is tried, too.
    """
    quarter, at, start, end, wall, axis, inward = line[:7]
    across = round((at + inward * (_WALL_GAP_M - group.reach[0].y_min)) * 1000.0) / 1000.0
    slide = first_slide(scene, group, line, across)
    if not slide.has_room:
        return []
    first, last = _ends(line, group.reach[0])
    places = _places(scene, group, line, (first, last), loose)
    first, last = first - EPSILON_M, last + EPSILON_M
    stands = slide.free_places(
        [(round(far * 1000.0) / 1000.0, rank, held, far) for rank, held, far in places if first <= far <= last]
    )
    if not stands:
        return []
    others = other_slides(scene, group, line, across)
    for other in others.needed:
        stands = other.free_places(stands)
    found: list[_Found] = []
    for along, rank, held, far in stands:
        aside = abs(2 * (far - start) / (end - start) - 1)
        center = (across, along) if axis else (along, across)
        found.append((rank, Spot(center, quarter, held, aside, wall, others.free_members(along))))
    return found


def _places(
    scene: RoomScene, group: FurnitureGroup, line: BackLine, ends: tuple[float, float], loose: list[float]
) -> list[tuple[int, float, float]]:
    """Returns places to try: a line's ends, beside what stands there, its middle, below windows, and a few loose ones.

    Each has its rank, how well a group is held there, and how far along the line its middle is.

    Args:
        scene: The room.
        group: The group.
        line: The line.
        ends: Where the group's middle is at most.
        loose: Shares of the line at which it is tried, too.
    """
    near = _beside(scene, group, line)
    places: list[tuple[int, float, float]] = []
    for rank, box in enumerate(group.reach):
        first, last = _ends(line, box) if rank else ends
        places += ((2 * rank, line.left, first), (2 * rank + 1, line.right, last))
        if near:
            half, middle = box.width / 2, line.ahead * ((box.x_min + box.x_max) / 2)
            places += [(2 * rank + 4, _BESIDE_HELD, before - half - middle) for before, _ in near]
            places += [(2 * rank + 5, _BESIDE_HELD, after + half - middle) for _, after in near]
    first, last = ends
    places += [(rank, 0.0, first + (last - first) * share) for rank, share in enumerate(loose, start=8)]
    if group.taste.window and line.wall:
        quarter = line.quarter
        places += [(n, 0.0, sill.middle) for n, sill in enumerate(scene.sills, start=20) if sill.quarter == quarter]
    return places


def _ends(line: BackLine, box: Box) -> tuple[float, float]:
    """Returns where a group's middle is when a box of its frame touches the one end of a line, and the other."""
    x_min, _, x_max, _ = box
    out, middle = _WALL_GAP_M + (x_max - x_min) / 2, line.ahead * ((x_min + x_max) / 2)
    return line.start + out - middle, line.end - out - middle


def _beside(scene: RoomScene, group: FurnitureGroup, line: BackLine) -> list[tuple[float, float]]:
    """Returns the ends to stand before, and after, of each thing that is in a group's way on a line."""
    depth = group.reach[0].height + _WALL_GAP_M
    gap = 0.0 if group.flush else _SIDE_GAP_M
    low = line.at if line.inward > 0 else line.at - depth
    high = low + depth
    taken = scene.taken[line.axis].whole
    return [(start - gap, end + gap) for near, far, start, end in taken if near < high and far > low]


def _in_room(rng: np.random.Generator, scene: RoomScene, group: FurnitureGroup) -> list[Spot]:
    """Returns places in the room, among them its middle."""
    facings = rng.integers(0, len(group.quarters), _IN_ROOM).tolist()
    shares: list[list[float]] = rng.random((_IN_ROOM, 2)).tolist()
    shares[: len(group.quarters) * 2] = [[0.5, 0.5]] * (len(group.quarters) * 2)
    turned = [group.turned(quarter) for quarter in group.quarters]
    floor = mid_room(scene, group)
    frames = [_frame(scene.floor, [boxes[number] for number in group.needed]) for boxes in turned]
    found: list[Spot] = []
    for facing, (x, y) in zip(facings, shares, strict=True):
        low_x, low_y, high_x, high_y = frames[facing]
        if high_x < low_x or high_y < low_y:
            continue
        center = (
            round((low_x + x * (high_x - low_x)) * 100.0) / 100.0,
            round((low_y + y * (high_y - low_y)) * 100.0) / 100.0,
        )
        free = floor.free_members(group, turned[facing], center)
        if free:
            aside = max(abs(2 * x - 1), abs(2 * y - 1))
            found.append(Spot(center, group.quarters[facing], 0.0, aside, True, free))  # noqa: FBT003
    return found


def _frame(floor: Box, needed: list[Box]) -> Box:
    """Returns where a group's middle may be in a room that holds the boxes that it needs."""
    around = bounding_box(needed)
    return Box(
        floor.x_min + _WALL_GAP_M - around.x_min,
        floor.y_min + _WALL_GAP_M - around.y_min,
        floor.x_max - _WALL_GAP_M - around.x_max,
        floor.y_max - _WALL_GAP_M - around.y_max,
    )
