"""Ways between rooms: the wished ones first, then doorways until every room is reachable."""

from collections import Counter
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from specs.world import RoomType
from tasks.worlds.brief import Brief, PassageKind
from tasks.worlds.geometry import EPSILON_M, Box
from tasks.worlds.scoring import DOORWAY_M, JAMB_M, OPENING_MIN_M, WALL_M

_OPENING_MAX_M = 4.0
_OPENING_SHARE = 0.85
# How unlike people's homes a doorway between two types is; the cheapest spanning tree is built.
HUBS: dict[RoomType, int] = {
    "Hallway": 0,
    "Living": 1,
    "Dining": 2,
    "Kitchen": 3,
    "Bedroom": 5,
    "Closet": 8,
    "Bathroom": 9,
}


@dataclass(frozen=True)
class Gap:
    """A passage as geometry: rooms by index (lower first), where it lies, and the axis its wall runs along."""

    rooms: tuple[int, int]
    kind: PassageKind
    center: tuple[float, float]
    width: float
    along: Literal["x", "y"]
    desired: bool

    def box(self, depth_m: float, extra_m: float = 0.0) -> Box:
        """Returns the floor of the passage, reaching that deep to both sides of the wall's centre line."""
        half = self.width / 2 + extra_m
        half_x, half_y = (half, depth_m) if self.along == "x" else (depth_m, half)
        x, y = self.center
        return Box(x - half_x, y - half_y, x + half_x, y + half_y)

    def shifted(self, dx_m: float, dy_m: float) -> "Gap":
        """Returns the passage moved, in whole centimetres."""
        return replace(self, center=(round(self.center[0] + dx_m, 3), round(self.center[1] + dy_m, 3)))


@dataclass(frozen=True)
class _SharedWall:
    """What two cells share: the axis it runs along, where it lies, and from where to where both rooms face it."""

    along: Literal["x", "y"]
    at: float
    start: float
    end: float

    @property
    def length(self) -> float:
        return self.end - self.start

    def gap(self, rooms: tuple[int, int], kind: PassageKind, middle: float, width: float, *, desired: bool) -> Gap:
        middle = round(middle, 2)
        center = (middle, self.at) if self.along == "x" else (self.at, middle)
        return Gap(rooms, kind, center, round(width, 2), self.along, desired)


def place_passages(rng: np.random.Generator, brief: Brief, cells: list[Box]) -> tuple[Gap, ...]:
    """Returns the passages of a plan; a wished one that its walls cannot hold is narrower, or left out."""
    walls = {
        (a, b): wall
        for a in range(len(cells))
        for b in range(a + 1, len(cells))
        if (wall := _shared_wall(cells[a], cells[b])) and wall.length >= DOORWAY_M + 2 * JAMB_M - EPSILON_M
    }
    gaps: list[Gap] = []
    for wish, count in Counter(brief.connections).items():
        gaps += _wished(rng, walls.get(wish.rooms), wish.rooms, wish.kind, count)
    gaps += _joining(rng, brief, walls, gaps)
    return tuple(gaps)


def _shared_wall(a: Box, b: Box) -> _SharedWall | None:
    if abs(a.x_max - b.x_min) < EPSILON_M or abs(b.x_max - a.x_min) < EPSILON_M:
        at = a.x_max if abs(a.x_max - b.x_min) < EPSILON_M else a.x_min
        return _SharedWall("y", at, max(a.y_min, b.y_min) + WALL_M / 2, min(a.y_max, b.y_max) - WALL_M / 2)
    if abs(a.y_max - b.y_min) < EPSILON_M or abs(b.y_max - a.y_min) < EPSILON_M:
        at = a.y_max if abs(a.y_max - b.y_min) < EPSILON_M else a.y_min
        return _SharedWall("x", at, max(a.x_min, b.x_min) + WALL_M / 2, min(a.x_max, b.x_max) - WALL_M / 2)
    return None


def _wished(
    rng: np.random.Generator, wall: _SharedWall | None, rooms: tuple[int, int], kind: PassageKind, count: int
) -> list[Gap]:
    if wall is None:
        return []
    if kind == "Opening" and wall.length >= OPENING_MIN_M + 2 * JAMB_M - EPSILON_M:
        width = min(max(_OPENING_SHARE * wall.length, OPENING_MIN_M), _OPENING_MAX_M)
        spare = wall.length - width - 2 * JAMB_M
        middle = wall.start + JAMB_M + width / 2 + spare * (0.25 + 0.5 * float(rng.random()))
        return [wall.gap(rooms, "Opening", middle, width, desired=True)]
    fitting = min(count, int((wall.length - JAMB_M + EPSILON_M) / (DOORWAY_M + JAMB_M)))
    slot = (wall.length - JAMB_M) / fitting
    return [
        _doorway(rng, wall, rooms, wall.start + JAMB_M + n * slot, slot - JAMB_M, desired=True) for n in range(fitting)
    ]


def _doorway(
    rng: np.random.Generator, wall: _SharedWall, rooms: tuple[int, int], start: float, length: float, *, desired: bool
) -> Gap:
    """Returns a doorway somewhere in a stretch of wall; half of them near an end, as doors in homes are."""
    spare = max(length - DOORWAY_M, 0.0)
    where, near_end = float(rng.random()), float(rng.random()) < 0.5
    offset = where * spare
    if near_end and spare > 0.4:
        offset = 0.1 if where < 0.5 else spare - 0.1
    return wall.gap(rooms, "Doorway", start + offset + DOORWAY_M / 2, DOORWAY_M, desired=desired)


def _joining(
    rng: np.random.Generator, brief: Brief, walls: dict[tuple[int, int], _SharedWall], built: list[Gap]
) -> list[Gap]:
    """Returns the cheapest doorways that join all rooms (Kruskal), given those that are built."""
    group = list(range(len(brief.rooms)))
    for gap in built:
        _unite(group, gap.rooms)
    hubs = [HUBS[room.type] for room in brief.rooms]
    costs = {
        pair: hubs[pair[0]] * hubs[pair[1]] + min(hubs[pair[0]], hubs[pair[1]]) + 2 * rng.random() for pair in walls
    }
    extra: list[Gap] = []
    for pair in sorted(walls, key=lambda each: costs[each]):
        if group[pair[0]] == group[pair[1]]:
            continue
        _unite(group, pair)
        wall = walls[pair]
        extra.append(_doorway(rng, wall, pair, wall.start + JAMB_M, wall.length - 2 * JAMB_M, desired=False))
    return extra


def _unite(group: list[int], pair: tuple[int, int]) -> None:
    kept, gone = group[pair[0]], group[pair[1]]
    group[:] = [kept if each == gone else each for each in group]
