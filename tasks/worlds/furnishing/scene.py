"""A room while it is being furnished: its floor, what stands there, and the lines along which things stand."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

from tasks.worlds.floorplan.floorplan import Pane
from tasks.worlds.floorplan.passages import START_CLEAR_M
from tasks.worlds.furniture.furniture_type import Size, TypeName
from tasks.worlds.geometry import EPSILON_M, Box

_WINDOW_DEPTH_M = 0.6
# Rooms at least this deep have lines in their middle, so far from each other at least, along which things stand back
# to back; a line is broken by ways across.
_BAY_M = 2.7
_SPINE_END_M = 1.2
_SPINE_M = 4.0
_WRONG_CORNER = 0.7


class Piece(NamedTuple):
    """A piece that stands in a room.

    Attributes:
        quarter: Which way it faces, in quarter turns from +y, counter-clockwise.
        askew_rad: How far it is turned beyond that.
        body: The axis-aligned box around it.
        covers_m2: Floor that it covers and nothing else of its group does.
    """

    type: TypeName
    size: Size
    center: tuple[float, float]
    quarter: int
    askew_rad: float
    body: Box
    covers_m2: float = 0.0


class WallLine(NamedTuple):
    """Where backs stand: facing ``quarter``, at a coordinate across, from one along to another.

    Attributes:
        wall: Whether it is a wall, or a line in the middle of a large room.
        axis: 0 for a line along x, 1 for one along y.
        inward: 1 where the room lies on the line's upper side, else -1.
        ahead: 1 where what faces that way has its left at the line's start, else -1.
        left: How well what stands at the line's start is held there, 1 in a corner that is on its left.
        right: The same of the line's end.
    """

    quarter: int
    at: float
    start: float
    end: float
    wall: bool
    axis: int
    inward: float
    ahead: float
    left: float
    right: float


def _line(quarter: int, at: float, start: float, end: float, *, wall: bool) -> WallLine:
    ahead = 1.0 if quarter < 2 else -1.0
    left, right = (wall * (1.0 if side * ahead > 0 else _WRONG_CORNER) for side in (1, -1))
    return WallLine(quarter, at, start, end, wall, quarter % 2, 1.0 if quarter in {0, 3} else -1.0, ahead, left, right)


LineBox = tuple[float, float, float, float]
"""A box as lines of one axis have it: its low and high side across them, and along them."""


def _bars(boxes: Iterable[Box], axis: int) -> list[LineBox]:
    if axis:
        return [(x_min, x_max, y_min, y_max) for x_min, y_min, x_max, y_max in boxes]
    return [(y_min, y_max, x_min, x_max) for x_min, y_min, x_max, y_max in boxes]


def _inside(bars: Iterable[LineBox], by_m: float = EPSILON_M) -> list[LineBox]:
    """Returns boxes without their borders, so that what only touches them does not meet them."""
    return [(near + by_m, far - by_m, start + by_m, end - by_m) for near, far, start, end in bars]


@dataclass
class _Bars:
    """Boxes as lines of one axis have them, with their borders and without."""

    axis: int
    whole: list[LineBox] = field(default_factory=list[LineBox])
    inside: list[LineBox] = field(default_factory=list[LineBox])

    def add(self, boxes: Iterable[Box]) -> None:
        """Puts boxes at the end."""
        bars = _bars(boxes, self.axis)
        self.whole += bars
        self.inside += _inside(bars)


def _both_axes(boxes: tuple[Box, ...] = ()) -> tuple[_Bars, _Bars]:
    (along_x := _Bars(0)).add(boxes)
    (along_y := _Bars(1)).add(boxes)
    return along_x, along_y


class Taken(NamedTuple):
    """What is taken, as lines of one axis have it: pieces, then the floor that their use needs and that before ways.

    Attributes:
        whole: With its borders.
        inside: Without them.
        pieces: The pieces of it, without their borders.
        around: The floor and its border; what reaches beyond it meets what is around.
        sills: Height of the sill, and the floor below, of each window.
    """

    whole: list[LineBox]
    inside: list[LineBox]
    pieces: list[LineBox]
    around: LineBox
    sills: list[tuple[float, LineBox]]


class Sill(NamedTuple):
    """A window: the quarter that a piece below it faces, its middle along the wall, and the height of its sill."""

    quarter: int
    middle: float
    height: float
    zone: Box


class PlacedGroup(NamedTuple):
    """A group where it stands: its pieces, and the floor that their use needs."""

    pieces: tuple[Piece, ...]
    zones: tuple[Box, ...]


@dataclass
class RoomScene:
    """A room while it is being furnished.

    Attributes:
        floor: The room's floor.
        keep_clear: Floor before passages, where nothing stands.
        way_m: Width of the ways that a robot needs.
        lines: Where backs stand.
        sills: Its windows.
        entries: Where a robot stands that has just come in, or starts.
        holds_start: Whether the clear disc around (0, 0) reaches into it.
        groups: What stands already.
        pieces: The pieces of all groups, in order.
    """

    floor: Box
    keep_clear: tuple[Box, ...]
    way_m: float
    lines: tuple[WallLine, ...]
    sills: tuple[Sill, ...] = ()
    entries: tuple[tuple[float, float], ...] = ()
    holds_start: bool = True
    groups: list[PlacedGroup] = field(default_factory=list[PlacedGroup])
    pieces: list[Piece] = field(default_factory=list[Piece])
    _counts: Counter[TypeName] = field(default_factory=Counter[TypeName])
    _taken: tuple[Taken, Taken] | None = None
    _bodies: tuple[_Bars, _Bars] = field(default_factory=_both_axes)
    _zones: tuple[_Bars, _Bars] = field(default_factory=_both_axes)

    def add(self, group: PlacedGroup) -> None:
        """Puts a group into the room."""
        self.groups.append(group)
        self.pieces += group.pieces
        self._counts.update([piece.type for piece in group.pieces])
        self._hold(group)

    def remove(self, number: int) -> PlacedGroup:
        """Takes a group out of the room again."""
        group = self.groups.pop(number)
        self.pieces = [piece for each in self.groups for piece in each.pieces]
        self._counts.subtract([piece.type for piece in group.pieces])
        self._bodies, self._zones, self._taken = _both_axes(), _both_axes(), None
        for each in self.groups:
            self._hold(each)
        return group

    def _hold(self, group: PlacedGroup) -> None:
        for bodies, zones in zip(self._bodies, self._zones, strict=True):
            bodies.add([piece.body for piece in group.pieces])
            zones.add(group.zones)
        self._taken = None

    @property
    def taken(self) -> tuple[Taken, Taken]:
        """Where nothing may stand, for lines along x and along y."""
        if self._taken is None:
            self._taken = self._take(0), self._take(1)
        return self._taken

    def _take(self, axis: int) -> Taken:
        bodies, zones, clear = self._bodies[axis], self._zones[axis], self._clear[axis]
        inside = bodies.inside + zones.inside + clear.inside
        return Taken(bodies.whole + zones.whole + clear.whole, inside, [*bodies.inside], *self._edges[axis])

    @cached_property
    def _clear(self) -> tuple[_Bars, _Bars]:
        """The floor before passages."""
        return _both_axes(self.keep_clear)

    @cached_property
    def _edges(self) -> list[tuple[LineBox, list[tuple[float, LineBox]]]]:
        """The floor, and the windows, as lines of each axis have them."""
        heights = [sill.height for sill in self.sills]
        return [
            (
                _inside(_bars([self.floor], axis), -EPSILON_M)[0],
                list(zip(heights, _inside(_bars([sill.zone for sill in self.sills], axis)), strict=True)),
            )
            for axis in (0, 1)
        ]

    def count(self, kind: TypeName) -> int:
        """Returns how many pieces of a type stand there."""
        return self._counts[kind]


def open_scene(
    floor: Box,
    keep_clear: tuple[Box, ...],
    radius_m: float,
    panes: Sequence[Pane] = (),
    entries: tuple[tuple[float, float], ...] = (),
) -> RoomScene:
    """Returns an empty room.

    Args:
        floor: Its floor.
        keep_clear: Floor before its passages.
        radius_m: Radius of the robot that shall get around in it.
        panes: Its windows.
        entries: Where a robot stands that has just come in, or starts.
    """
    way = way_width(radius_m)
    lines = (*_walls(floor), *_spines(floor, way))
    sills = tuple(_sill(floor, pane) for pane in panes)
    holds_start = floor.grown(START_CLEAR_M).meets(Box(0.0, 0.0, 1e-3, 1e-3))
    return RoomScene(floor, keep_clear, way, lines, sills, entries, holds_start=holds_start)


def way_width(radius_m: float) -> float:
    """Returns how wide a way must be for a robot, the play of the clearance grid included (metres)."""
    return round(2 * (radius_m + 0.11), 2)


def _walls(floor: Box) -> tuple[WallLine, ...]:
    # The back stands at the south, east, north or west wall for 0, 1, 2 or 3 quarter turns.
    return (
        _line(0, floor.y_min, floor.x_min, floor.x_max, wall=True),
        _line(1, floor.x_max, floor.y_min, floor.y_max, wall=True),
        _line(2, floor.y_max, floor.x_min, floor.x_max, wall=True),
        _line(3, floor.x_min, floor.y_min, floor.y_max, wall=True),
    )


def _spines(floor: Box, way_m: float) -> tuple[WallLine, ...]:
    """Returns the lines in the middle of a large room, along its longer side; both faces of each."""
    wide = floor.width >= floor.height
    across, along = (floor.height, floor.width) if wide else (floor.width, floor.height)
    base, first = (floor.y_min, floor.x_min) if wide else (floor.x_min, floor.y_min)
    bays, margin = int(across / _BAY_M), max(_SPINE_END_M, way_m)
    length = along - 2 * margin
    if bays < 2 or length < 1.0:
        return ()
    runs = max(1, round(length / (_SPINE_M + margin)))
    run = (length - (runs - 1) * margin) / runs
    lines: list[WallLine] = []
    for bay in range(1, bays):
        at = round(base + across * bay / bays, 2)
        starts = [round(first + margin + n * (run + margin), 2) for n in range(runs)]
        lines += [
            _line(quarter, at, start, round(start + run, 2), wall=False)
            for start in starts
            for quarter in ((0, 2) if wide else (1, 3))
        ]
    return tuple(lines)


def _sill(floor: Box, pane: Pane) -> Sill:
    x, y = pane.center
    half = pane.width / 2
    if pane.along == "x":
        quarter = 0 if abs(y - floor.y_min) < abs(y - floor.y_max) else 2
        edge = floor.y_min if quarter == 0 else floor.y_max - _WINDOW_DEPTH_M
        return Sill(quarter, x, pane.bottom, Box(x - half, edge, x + half, edge + _WINDOW_DEPTH_M))
    quarter = 3 if abs(x - floor.x_min) < abs(x - floor.x_max) else 1
    edge = floor.x_min if quarter == 3 else floor.x_max - _WINDOW_DEPTH_M
    return Sill(quarter, y, pane.bottom, Box(edge, y - half, edge + _WINDOW_DEPTH_M, y + half))
