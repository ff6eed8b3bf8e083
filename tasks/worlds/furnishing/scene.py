"""A room while it is being furnished: its floor, what stands there, and the lines along which things stand."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from tasks.worlds.floorplan.floorplan import START_CLEAR_M
from tasks.worlds.floorplan.windows import Pane
from tasks.worlds.furniture.furniture_type import TypeName
from tasks.worlds.furniture.primitives import Size
from tasks.worlds.geometry.boxes import Box, inset

_WINDOW_DEPTH_M = 0.6
# Rooms at least this deep have lines in their middle, so far from each other at least, along which things stand back
# to back; a line is broken by ways across.
_BAY_M = 2.7
_SPINE_END_M = 1.2
_SPINE_M = 4.0
_WRONG_CORNER = 0.7
_FAR, _SIDES = 1e9, 4


@dataclass(frozen=True)
class Piece:
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


class BackLine(NamedTuple):
    """Where backs stand: facing ``quarter``, at a coordinate across, from one along to another.

    ``wall`` tells walls from lines in the middle of a large room.
    """

    quarter: int
    at: float
    start: float
    end: float
    wall: bool


class LineTable(NamedTuple):
    """Lines as columns.

    Attributes:
        axis: 0 for lines along x, 1 for lines along y.
        inward: 1 where the room lies on the line's upper side, else -1.
        ahead: 1 where what faces that way has its left at the line's start, else -1.
        rows: Of each line: at, start, end, inward, ahead, left and right, for what is quicker one by one.
        left: How well what stands at the line's start is held there, 1 in a corner that is on its left.
        right: The same of the line's end.
    """

    quarter: Int[np.ndarray, " lines"]
    axis: Int[np.ndarray, " lines"]
    at: Float[np.ndarray, " lines"]
    start: Float[np.ndarray, " lines"]
    end: Float[np.ndarray, " lines"]
    inward: Float[np.ndarray, " lines"]
    wall: Bool[np.ndarray, " lines"]
    ahead: Float[np.ndarray, " lines"]
    left: Float[np.ndarray, " lines"]
    right: Float[np.ndarray, " lines"]
    rows: list[tuple[float, float, float, float, float, float, float]]

    def only(self, quarters: tuple[int, ...], *, walls: bool) -> "LineTable":
        """Returns the lines that face one of these ways, without those in the middle of the room if need be."""
        if len(quarters) == 4 and (not walls or len(self.wall) == 4):
            return self
        kept = np.isin(self.quarter, quarters) & (self.wall | (not walls))
        rows = [self.rows[row] for row in kept.nonzero()[0].tolist()]
        return LineTable._make([*(column[kept] for column in self[:-1]), rows])


def _table(lines: Sequence[BackLine]) -> LineTable:
    quarter, at, start, end, wall = (np.array(column) for column in zip(*lines, strict=True))
    inward = np.where((quarter == 0) | (quarter == 3), 1.0, -1.0)
    ahead = np.where(quarter < 2, 1.0, -1.0)
    left, right = (wall * np.where(side * ahead > 0, 1.0, _WRONG_CORNER) for side in (1, -1))
    rows = list(zip(*(column.tolist() for column in (at, start, end, inward, ahead, left, right)), strict=True))
    return LineTable(quarter, quarter % 2, at, start, end, inward, wall, ahead, left, right, rows)


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
        table: Where backs stand.
        sills: Its windows.
        entries: Where a robot stands that has just come in, or starts.
        holds_start: Whether the clear disc around (0, 0) reaches into it.
        groups: What stands already.
        pieces: The pieces of all groups, in order.
    """

    floor: Box
    keep_clear: tuple[Box, ...]
    way_m: float
    table: LineTable
    sills: tuple[Sill, ...] = ()
    entries: tuple[tuple[float, float], ...] = ()
    holds_start: bool = True
    groups: list[PlacedGroup] = field(default_factory=list[PlacedGroup])
    pieces: list[Piece] = field(default_factory=list[Piece])
    _taken: Float[np.ndarray, "4 boxes"] | None = None
    _barred: Float[np.ndarray, "4 more"] | None = None
    _beside: list[list[tuple[float, float, float, float]]] | None = None

    def add(self, group: PlacedGroup) -> None:
        """Puts a group into the room."""
        self.groups.append(group)
        self.pieces += group.pieces
        self._taken = self._barred = self._beside = None

    def remove(self, number: int) -> PlacedGroup:
        """Takes a group out of the room again."""
        group = self.groups.pop(number)
        self.pieces = [piece for each in self.groups for piece in each.pieces]
        self._taken = self._barred = self._beside = None
        return group

    @property
    def taken(self) -> Float[np.ndarray, "4 boxes"]:
        """Where nothing may stand: pieces, then the floor that their use needs and the floor before passages."""
        if self._taken is None:
            zones = [zone for group in self.groups for zone in group.zones]
            boxes = [*[piece.body for piece in self.pieces], *zones, *self.keep_clear]
            self._taken = np.array(boxes, dtype=np.float64).reshape(-1, 4).T.copy()
        return self._taken

    @property
    def barred(self) -> Float[np.ndarray, "4 more"]:
        """What is around the floor, then what is taken, then the floor below windows; all without their borders."""
        if self._barred is None:
            low_x, low_y, high_x, high_y = self.floor
            around = ((-_FAR, -_FAR, low_x, _FAR), (-_FAR, -_FAR, _FAR, low_y))
            around += ((high_x, -_FAR, _FAR, _FAR), (-_FAR, high_y, _FAR, _FAR))
            sills = np.array([sill.zone for sill in self.sills], dtype=np.float64).reshape(-1, 4)
            self._barred = inset(np.concatenate([np.array(around).T, self.taken, sills.T], axis=1))
        return self._barred

    @property
    def bars_zones(self) -> int:
        """How many of what is barred also bars floor that is used: what is around the floor, and pieces."""
        return _SIDES + len(self.pieces)

    @property
    def bars_low(self) -> int:
        """How many of what is barred bars things that are lower than window sills: all but the floor below these."""
        return _SIDES + self.taken.shape[1]

    def beside(self, lines: LineTable) -> list[list[tuple[float, float, float, float]]]:
        """Returns what is taken as each line has it: low and high across the line, low and high along it."""
        if self._beside is None:
            columns = self.taken.tolist()
            self._beside = [
                list(zip(*(columns[side] for side in (1 - axis, 3 - axis, axis, 2 + axis)), strict=True))
                for axis in (0, 1)
            ]
        return [self._beside[axis] for axis in lines.axis.tolist()]

    def count(self, kind: TypeName) -> int:
        """Returns how many pieces of a type stand there."""
        return sum(piece.type == kind for piece in self.pieces)


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
    table = _table((*_walls(floor), *_spines(floor, way)))
    sills = tuple(_sill(floor, pane) for pane in panes)
    holds_start = floor.grown(START_CLEAR_M).meets(Box(0.0, 0.0, 1e-3, 1e-3))
    return RoomScene(floor, keep_clear, way, table, sills, entries, holds_start=holds_start)


def way_width(radius_m: float) -> float:
    """Returns how wide a way must be for a robot, the play of the clearance grid included (metres)."""
    return round(2 * (radius_m + 0.11), 2)


def _walls(floor: Box) -> tuple[BackLine, ...]:
    # The back stands at the south, east, north or west wall for 0, 1, 2 or 3 quarter turns.
    return (
        BackLine(0, floor.y_min, floor.x_min, floor.x_max, wall=True),
        BackLine(1, floor.x_max, floor.y_min, floor.y_max, wall=True),
        BackLine(2, floor.y_max, floor.x_min, floor.x_max, wall=True),
        BackLine(3, floor.x_min, floor.y_min, floor.y_max, wall=True),
    )


def _spines(floor: Box, way_m: float) -> tuple[BackLine, ...]:
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
    lines: list[BackLine] = []
    for bay in range(1, bays):
        at = round(base + across * bay / bays, 2)
        starts = [round(first + margin + n * (run + margin), 2) for n in range(runs)]
        lines += [
            BackLine(quarter, at, start, round(start + run, 2), wall=False)
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
