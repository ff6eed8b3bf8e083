"""Where a group fits: along the lines at which backs stand, flush against something, or in the room's middle.

There are some fifty places to try, and most have something in the way. On a line, what is in the way of a box is a few
intervals, with which Python is quicker than NumPy.
"""

from operator import itemgetter
from typing import NamedTuple

import numpy as np

from tasks.worlds.floorplan.passages import START_CLEAR_M
from tasks.worlds.furnishing.groups import FurnitureGroup, Member
from tasks.worlds.furnishing.scene import LineBox, RoomScene, Taken, WallLine
from tasks.worlds.furniture.catalogue import CATALOGUE
from tasks.worlds.geometry import EPSILON_M, Box, bounding_box

LinePlace = tuple[float, int, float, float]
"""How far along a line in whole millimetres; its rank; how well a group is held there; how far along exactly."""
_CLEAR_M2 = START_CLEAR_M**2
_FAR_M = 1e9
_EVERYWHERE = [(-_FAR_M, _FAR_M)]
_WALL_GAP_M = 0.02
_SIDE_GAP_M = 0.06
_LOOSE = 3
"""Places by chance on each line, besides those that touch something."""
_BESIDE_HELD = 0.6
_IN_ROOM = 40
_rank = itemgetter(0)


class Interval(NamedTuple):
    """A box of a group on a line along which it slides.

    Attributes:
        start: Its low side along the line, seen from the group's middle.
        end: Its high side.
        bars: From where to where something is in its way, without the borders.
        aside_m2: The square of its distance across from (0, 0), or more where the start does not matter.
    """

    start: float
    end: float
    bars: list[tuple[float, float]]
    aside_m2: float = _CLEAR_M2

    def is_free(self, along: float) -> bool:
        """Returns whether nothing is in its way when the group's middle is so far along the line."""
        own_start, own_end, bars, aside_m2 = self
        low, high = along + own_start, along + own_end
        for start, end in bars:
            if low < end and high > start:
                return False
        if aside_m2 >= _CLEAR_M2:
            return True
        gap = max(low, -high, 0.0)
        return gap * gap + aside_m2 >= _CLEAR_M2

    @property
    def has_room(self) -> bool:
        """Whether there is a gap between what is in its way that is as wide as the box; on most lines there is none."""
        if len(self.bars) == 1:
            return False
        wide, reached = self.end - self.start - EPSILON_M, -_FAR_M
        for start, end in sorted(self.bars):
            if start - reached >= wide:
                return True
            reached = max(reached, end)
        return False

    def free_places(self, places: list[LinePlace]) -> list[LinePlace]:
        """Returns the places at which nothing is in its way."""
        own_start, own_end, bars, aside_m2 = self
        found: list[LinePlace] = []
        for place in places:
            low, high = place[0] + own_start, place[0] + own_end
            for start, end in bars:
                if low < end and high > start:
                    break
            else:
                found.append(place)
        return found if aside_m2 >= _CLEAR_M2 else [place for place in found if self.is_free(place[0])]


class GroupIntervals(NamedTuple):
    """What of a group is not its first member.

    Attributes:
        members: How many members it has.
        needed: The other members that it needs, and the floor that those and the first one use.
        others: Each member that it could do without, and the floor that this one uses.
    """

    members: int
    needed: list[Interval]
    others: list[tuple[int, list[Interval]]]

    def free_members(self, along: float) -> list[bool]:
        """Returns which members there is room for, where there is room for those that are needed."""
        free = [True] * self.members
        for number, intervals in self.others:
            free[number] = all(interval.is_free(along) for interval in intervals)
        return free


def first_interval(scene: RoomScene, group: FurnitureGroup, line: WallLine, across: float) -> Interval:
    """Returns a group's first member on a line.

    Args:
        scene: The room.
        group: The group.
        line: The line.
        across: Where the group's middle is across it.
    """
    taken = scene.taken[line.axis]
    bars = bars_of(taken, group.members[0])
    return _interval(group.bodies[0], bars, taken.around, line, across, clear_start=scene.holds_start)


def other_intervals(scene: RoomScene, group: FurnitureGroup, line: WallLine, across: float) -> GroupIntervals:
    """Returns the rest of a group on a line: bodies keep off everything, but what they use may lie where others walk.

    Args:
        scene: The room.
        group: The group.
        line: The line.
        across: Where the group's middle is across it.
    """
    members, taken, start = group.members, scene.taken[line.axis], scene.holds_start
    intervals: list[list[Interval]] = [[] for _ in members]
    for number in range(1, len(members)):
        bars, body = bars_of(taken, members[number]), group.bodies[number]
        intervals[number].append(_interval(body, bars, taken.around, line, across, clear_start=start))
    for zone in group.zones:
        intervals[zone.member].append(_interval(zone.box, taken.pieces, taken.around, line, across))
    needed = [interval for number in group.needed for interval in intervals[number]]
    others = [(number, intervals[number]) for number, member in enumerate(members) if not member.needed]
    return GroupIntervals(len(members), needed, others)


def bars_of(taken: Taken, member: Member) -> list[LineBox]:
    """Returns what a member keeps off: what is taken, and what it would stand before if it is higher than a sill."""
    if taken.sills and not CATALOGUE[member.kind].under_window:
        before = [bar for sill_m, bar in taken.sills if member.size[2] > sill_m]
        return [*taken.inside, *before] if before else taken.inside
    return taken.inside


def _interval(
    box: Box, bars: list[LineBox], around: LineBox, line: WallLine, across: float, *, clear_start: bool = False
) -> Interval:
    """Returns a box on a line.

    Args:
        box: The box in the group's frame.
        bars: What it keeps off.
        around: What it does not reach beyond.
        line: The line.
        across: Where the group's middle is across the line.
        clear_start: Whether it keeps off the start.
    """
    x_min, y_min, x_max, y_max = box
    start, end = (x_min, x_max) if line.ahead > 0 else (-x_max, -x_min)
    near, far = (across + y_min, across + y_max) if line.inward > 0 else (across - y_max, across - y_min)
    low, high, first, last = around
    if near < low or far > high:
        return Interval(start, end, _EVERYWHERE)
    in_way = [
        (bar_start, bar_end) for bar_near, bar_far, bar_start, bar_end in bars if near < bar_far and far > bar_near
    ]
    in_way += ((-_FAR_M, first), (last, _FAR_M))
    if not clear_start:
        return Interval(start, end, in_way)
    gap = max(near, -far, 0.0)
    return Interval(start, end, in_way, gap * gap)


class MidRoom(NamedTuple):
    """A room for a group that stands at no line.

    Attributes:
        around: The floor.
        bars: What each member keeps off, as lines along x have it.
        zone_bars: What the floor that they use keeps off.
        clear_start: Whether the members keep off the start.
    """

    around: LineBox
    bars: list[list[LineBox]]
    zone_bars: list[LineBox]
    clear_start: bool

    def free_members(self, group: FurnitureGroup, boxes: list[Box], center: tuple[float, float]) -> list[bool]:
        """Returns which members of a group there is room for at a place; none where one that is needed has none.

        Args:
            group: The group.
            boxes: Its boxes as it faces, about its middle.
            center: The place.
        """
        count = len(group.members)
        if not _is_free(boxes[0], center, self.bars[0], self.around):
            return []
        free = [True] * count
        for zone, box in zip(group.zones, boxes[count:], strict=True):
            free[zone.member] = free[zone.member] and _is_free(box, center, self.zone_bars, self.around)
        for number, bars in enumerate(self.bars):
            if free[number]:
                free[number] = _is_free(boxes[number], center, bars, self.around) and not (
                    self.clear_start and _meets_start(boxes[number], center)
                )
            if not free[number] and group.members[number].needed:
                return []
        return free


def mid_room(scene: RoomScene, group: FurnitureGroup) -> MidRoom:
    """Returns a room as a group has it that stands at no line."""
    taken = scene.taken[0]
    bars = [bars_of(taken, member) for member in group.members]
    return MidRoom(taken.around, bars, taken.pieces, scene.holds_start)


def _is_free(box: Box, center: tuple[float, float], bars: list[LineBox], around: LineBox) -> bool:
    """Returns whether a box about a place meets nothing.

    Args:
        box: The box.
        center: The place.
        bars: What it keeps off, as lines along x have it.
        around: What it does not reach beyond.
    """
    (x, y), (x_min, y_min, x_max, y_max) = center, box
    x_min, y_min, x_max, y_max = x + x_min, y + y_min, x + x_max, y + y_max
    low_y, high_y, low_x, high_x = around
    if x_min < low_x or y_min < low_y or x_max > high_x or y_max > high_y:
        return False
    for near, far, start, end in bars:  # noqa: SIM110 - a generator takes twice the time
        if x_min < end and x_max > start and y_min < far and y_max > near:
            return False
    return True


def _meets_start(box: Box, center: tuple[float, float]) -> bool:
    (x, y), (x_min, y_min, x_max, y_max) = center, box
    gap_x, gap_y = max(x + x_min, -(x + x_max), 0.0), max(y + y_min, -(y + y_max), 0.0)
    return gap_x * gap_x + gap_y * gap_y < _CLEAR_M2


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


def _at_line(scene: RoomScene, group: FurnitureGroup, line: WallLine, loose: list[float]) -> list[_Found]:
    """Returns the places on a line.

    Args:
        scene: The room.
        group: The group.
        line: The line.
        loose: Shares of the line at which it is tried, too.
    """
    quarter, at, start, end, wall, axis, inward = line[:7]
    across = round((at + inward * (_WALL_GAP_M - group.reach[0].y_min)) * 1000.0) / 1000.0
    interval = first_interval(scene, group, line, across)
    if not interval.has_room:
        return []
    first, last = _ends(line, group.reach[0])
    places = _places(scene, group, line, (first, last), loose)
    first, last = first - EPSILON_M, last + EPSILON_M
    stands = interval.free_places(
        [(round(far * 1000.0) / 1000.0, rank, held, far) for rank, held, far in places if first <= far <= last]
    )
    if not stands:
        return []
    others = other_intervals(scene, group, line, across)
    for other in others.needed:
        stands = other.free_places(stands)
    found: list[_Found] = []
    for along, rank, held, far in stands:
        aside = abs(2 * (far - start) / (end - start) - 1)
        center = (across, along) if axis else (along, across)
        found.append((rank, Spot(center, quarter, held, aside, wall, others.free_members(along))))
    return found


def _places(
    scene: RoomScene, group: FurnitureGroup, line: WallLine, ends: tuple[float, float], loose: list[float]
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


def _ends(line: WallLine, box: Box) -> tuple[float, float]:
    """Returns where a group's middle is when a box of its frame touches the one end of a line, and the other."""
    x_min, _, x_max, _ = box
    out, middle = _WALL_GAP_M + (x_max - x_min) / 2, line.ahead * ((x_min + x_max) / 2)
    return line.start + out - middle, line.end - out - middle


def _beside(scene: RoomScene, group: FurnitureGroup, line: WallLine) -> list[tuple[float, float]]:
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
