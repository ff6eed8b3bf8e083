"""What is in the way of a group: of each of its boxes along a line, or at a place in the middle of a room."""

from typing import NamedTuple

from tasks.worlds.floorplan.floorplan import START_CLEAR_M
from tasks.worlds.furnishing.groups.group import FurnitureGroup, Member
from tasks.worlds.furnishing.scene import BackLine, LineBox, RoomScene, Taken
from tasks.worlds.furniture.catalogue import CATALOGUE
from tasks.worlds.geometry.boxes import EPSILON_M, Box

LinePlace = tuple[float, int, float, float]
"""How far along a line in whole millimetres; its rank; how well a group is held there; how far along exactly."""
_CLEAR_M2 = START_CLEAR_M**2
_FAR_M = 1e9
_EVERYWHERE = [(-_FAR_M, _FAR_M)]


class Slide(NamedTuple):
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


class Slides(NamedTuple):
    """What of a group is not its first member.

    Attributes:
        members: How many members it has.
        needed: The other members that it needs, and the floor that those and the first one use.
        others: Each member that it could do without, and the floor that this one uses.
    """

    members: int
    needed: list[Slide]
    others: list[tuple[int, list[Slide]]]

    def free_members(self, along: float) -> list[bool]:
        """Returns which members there is room for, where there is room for those that are needed."""
        free = [True] * self.members
        for number, slides in self.others:
            free[number] = all(slide.is_free(along) for slide in slides)
        return free


def first_slide(scene: RoomScene, group: FurnitureGroup, line: BackLine, across: float) -> Slide:
    """Returns a group's first member on a line.

    Args:
        scene: The room.
        group: The group.
        line: The line.
        across: Where the group's middle is across it.
    """
    taken = scene.taken[line.axis]
    bars = bars_of(taken, group.members[0])
    return _slide(group.bodies[0], bars, taken.around, line, across, clear_start=scene.holds_start)


def other_slides(scene: RoomScene, group: FurnitureGroup, line: BackLine, across: float) -> Slides:
    """Returns the rest of a group on a line: bodies keep off everything, but what they use may lie where others walk.

    Args:
        scene: The room.
        group: The group.
        line: The line.
        across: Where the group's middle is across it.
    """
    members, taken, start = group.members, scene.taken[line.axis], scene.holds_start
    slides: list[list[Slide]] = [[] for _ in members]
    for number in range(1, len(members)):
        bars, body = bars_of(taken, members[number]), group.bodies[number]
        slides[number].append(_slide(body, bars, taken.around, line, across, clear_start=start))
    for zone in group.zones:
        slides[zone.member].append(_slide(zone.box, taken.pieces, taken.around, line, across))
    needed = [slide for number in group.needed for slide in slides[number]]
    others = [(number, slides[number]) for number, member in enumerate(members) if not member.needed]
    return Slides(len(members), needed, others)


def bars_of(taken: Taken, member: Member) -> list[LineBox]:
    """Returns what a member keeps off: what is taken, and what it would stand before if it is higher than a sill."""
    if taken.sills and not CATALOGUE[member.kind].under_window:
        before = [bar for sill_m, bar in taken.sills if member.size[2] > sill_m]
        return [*taken.inside, *before] if before else taken.inside
    return taken.inside


def _slide(
    box: Box, bars: list[LineBox], around: LineBox, line: BackLine, across: float, *, clear_start: bool = False
) -> Slide:
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
        return Slide(start, end, _EVERYWHERE)
    in_way = [
        (bar_start, bar_end) for bar_near, bar_far, bar_start, bar_end in bars if near < bar_far and far > bar_near
    ]
    in_way += ((-_FAR_M, first), (last, _FAR_M))
    if not clear_start:
        return Slide(start, end, in_way)
    gap = max(near, -far, 0.0)
    return Slide(start, end, in_way, gap * gap)


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
