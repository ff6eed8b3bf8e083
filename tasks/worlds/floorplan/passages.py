"""Ways between rooms, and the place where the robot starts.

The wished ways come first, then doorways until every room is reachable. The robot starts in a room where one would put
it down, near a way out. Whether it gets about a bare floor plan is known exactly, because rooms are rectangles and
passages lie in their walls.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from specs.data.world import RoomType
from tasks.worlds.floorplan.scoring import JAMB_M, OPENING_MIN_M, PRIVATE, WALL_M, doorway_width, passable_width
from tasks.worlds.geometry import EPSILON_M, Box
from tasks.worlds.resolved_template import ConnectionWish, PassageKind, ResolvedTemplate

HUBS: dict[RoomType, int] = {
    "Hallway": 0,
    "Living": 1,
    "Dining": 2,
    "Kitchen": 3,
    "Bedroom": 5,
    "Closet": 8,
    "Bathroom": 9,
}
"""How unlike people's homes it is that doorways lead to a type; the cheapest spanning tree is built."""
_OPENING_MAX_M = 4.0
_OPENING_SHARE = 0.85
# Where a doorway may lie in its stretch of wall: at either end, and so many places between.
_BETWEEN = 4
# What counts against a place: metres from the room's corner (furniture wants long walls, a leaf wants a wall to lean
# on), as far as that matters; leaves that meet; metres to the room's other ways, because paths cut rooms up.
_FROM_CORNER, _CORNER_MAX_M = 1.0, 1.2
_LEAVES_MEET, _PATH, _TASTE = 1.5, 0.1, 0.8
_HALLWAY_SHARE = 0.25  # hallways hold little furniture
START_CLEAR_M = 1.02
_SPOTS = 6
# Rooms in the order in which one would look for a robot; of two alike the larger one.
_RANKS: dict[RoomType, int] = {
    "Hallway": 0,
    "Living": 0,
    "Dining": 1,
    "Kitchen": 1,
    "Bedroom": 2,
    "Closet": 3,
    "Bathroom": 3,
}
# What a leaf that can swing into the clear disc costs, in metres from the next way out.
_SWING_M = 4.0
_TASTE_M = 0.5


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
        """Returns the passage moved, in whole millimetres."""
        return replace(self, center=(round(self.center[0] + dx_m, 3), round(self.center[1] + dy_m, 3)))


@dataclass(frozen=True)
class SharedWall:
    """What two cells share: the axis it runs along, where it lies, and from where to where both rooms face it."""

    along: Literal["x", "y"]
    at: float
    start: float
    end: float

    @property
    def length(self) -> float:
        """Extent along the wall (metres)."""
        return self.end - self.start

    def gap(self, rooms: tuple[int, int], kind: PassageKind, start: float, width: float, *, desired: bool) -> Gap:
        """Returns a gap in the wall.

        Args:
            rooms: The two rooms, lower index first.
            kind: Doorway or opening.
            start: Where it begins along the wall (metres).
            width: Its extent along the wall (metres).
            desired: Whether the template wishes for it.
        """
        middle = round(start + width / 2, 3)
        center = (middle, self.at) if self.along == "x" else (self.at, middle)
        return Gap(rooms, kind, center, round(width, 2), self.along, desired)


def shared_wall(a: Box, b: Box) -> SharedWall | None:
    """Returns the wall between two cells, None where they do not touch; its length can be negative at a corner."""
    if abs(a.x_max - b.x_min) < EPSILON_M or abs(b.x_max - a.x_min) < EPSILON_M:
        at = a.x_max if abs(a.x_max - b.x_min) < EPSILON_M else a.x_min
        return SharedWall("y", at, max(a.y_min, b.y_min) + WALL_M / 2, min(a.y_max, b.y_max) - WALL_M / 2)
    if abs(a.y_max - b.y_min) < EPSILON_M or abs(b.y_max - a.y_min) < EPSILON_M:
        at = a.y_max if abs(a.y_max - b.y_min) < EPSILON_M else a.y_min
        return SharedWall("x", at, max(a.x_min, b.x_min) + WALL_M / 2, min(a.x_max, b.x_max) - WALL_M / 2)
    return None


def place_passages(rng: np.random.Generator, resolved: ResolvedTemplate, cells: Sequence[Box]) -> tuple[Gap, ...]:
    """Returns the passages of a plan; a wished one that its walls cannot hold is narrower, or left out."""
    builder = _Builder(rng, resolved, cells)
    for wish, count in Counter(resolved.connections).items():
        builder.add_wished(wish, count)
    builder.join()
    return tuple(builder.gaps)


class _Builder:
    """Breaks gaps into walls, one after the other."""

    def __init__(self, rng: np.random.Generator, resolved: ResolvedTemplate, cells: Sequence[Box]) -> None:
        self.gaps: list[Gap] = []
        self._rng, self._brief = rng, resolved
        self._floors = [cell.grown(-WALL_M / 2) for cell in cells]
        self._width = doorway_width(resolved)
        self._opening = max(OPENING_MIN_M, self._width)
        pairs = ((a, b) for a in range(len(cells)) for b in range(a + 1, len(cells)))
        walls = ((pair, shared_wall(cells[pair[0]], cells[pair[1]])) for pair in pairs)
        least = self._width + 2 * JAMB_M - EPSILON_M
        self._walls = {pair: wall for pair, wall in walls if wall and wall.length >= least}

    def add_wished(self, wish: ConnectionWish, count: int) -> None:
        """Adds an opening, or as many doorways side by side as the wall holds."""
        wall = self._walls.get(wish.rooms)
        if wall is None:
            return
        if wish.kind == "Opening" and wall.length >= self._opening + 2 * JAMB_M - EPSILON_M:
            width = round(min(max(_OPENING_SHARE * wall.length, self._opening), _OPENING_MAX_M), 2)
            spare = wall.length - width - 2 * JAMB_M
            start = wall.start + JAMB_M + spare * (0.25 + 0.5 * float(self._rng.random()))
            self.gaps.append(wall.gap(wish.rooms, "Opening", round(start, 2), width, desired=True))
            return
        fitting = min(count, int((wall.length - JAMB_M + EPSILON_M) / (self._width + JAMB_M)))
        slot = (wall.length - JAMB_M) / fitting
        for n in range(fitting):
            start = wall.start + JAMB_M + n * slot
            self._add_doorway(wish.rooms, wall, start, start + slot - JAMB_M, desired=True)

    def join(self) -> None:
        """Adds the cheapest doorways that join all rooms (Kruskal), given those that are there.

        Those between rooms that people walk through come first: a bathroom or closet hangs at the end of a way
        unless the template says otherwise or no other wall is long enough.
        """
        group = list(range(len(self._floors)))
        for gap in self.gaps:
            _unite(group, gap.rooms)
        for pair in sorted(self._walls, key=self._unlikeness):
            if group[pair[0]] != group[pair[1]]:
                _unite(group, pair)
                wall = self._walls[pair]
                self._add_doorway(pair, wall, wall.start + JAMB_M, wall.end - JAMB_M, desired=False)

    def _unlikeness(self, pair: tuple[int, int]) -> tuple[int, float]:
        rooms = [self._brief.rooms[room] for room in pair]
        product = (HUBS[rooms[0].type] + 1) * (HUBS[rooms[1].type] + 1)
        return sum(room.type in PRIVATE for room in rooms), product * (1.0 + 0.2 * float(self._rng.random()))

    def _add_doorway(
        self, rooms: tuple[int, int], wall: SharedWall, start: float, end: float, *, desired: bool
    ) -> None:
        """Adds a doorway at the best place of a stretch of wall, as its rooms see it, with some taste."""
        spare = max(end - start - self._width, 0.0)
        shares = [0.0, 1.0, *self._rng.random(_BETWEEN).tolist()]
        taste = self._rng.random(len(shares)).tolist()
        ways = [
            wall.gap(rooms, "Doorway", round(start + share * spare, 2), self._width, desired=desired)
            for share in shares
        ]
        costs = [self._awkwardness(way) + _TASTE * chance for way, chance in zip(ways, taste, strict=True)]
        self.gaps.append(ways[costs.index(min(costs))])

    def _awkwardness(self, way: Gap) -> float:
        cost = 0.0
        for room in way.rooms:
            others = [gap for gap in self.gaps if room in gap.rooms]
            share = _HALLWAY_SHARE if self._brief.rooms[room].type == "Hallway" else 1.0
            cost += _FROM_CORNER * share * min(_corner_distance(way, self._floors[room]), _CORNER_MAX_M)
            cost += sum(_PATH * share * _distance(way, gap) for gap in others)
            if self._brief.doors is not None:
                swing = way.box(self._width)
                cost += _LEAVES_MEET * sum(swing.meets(gap.box(self._width)) for gap in others)
        return cost


def _corner_distance(gap: Gap, floor: Box) -> float:
    axis = 0 if gap.along == "x" else 1
    return min(gap.center[axis] - floor[axis], floor[axis + 2] - gap.center[axis]) - gap.width / 2


def _distance(one: Gap, other: Gap) -> float:
    return abs(one.center[0] - other.center[0]) + abs(one.center[1] - other.center[1])


def _unite(group: list[int], pair: tuple[int, int]) -> None:
    kept, gone = group[pair[0]], group[pair[1]]
    group[:] = [kept if each == gone else each for each in group]


def choose_start(
    rng: np.random.Generator, resolved: ResolvedTemplate, cells: Sequence[Box], gaps: Sequence[Gap]
) -> tuple[float, float] | None:
    """Returns where the robot starts, in whole centimetres; None when no room holds the clear disc.

    Floor that is kept free for walking anyway is the best place for a disc that must be free.

    Args:
        rng: The floor plan's stream.
        resolved: What the template asks for.
        cells: Each room's cell, in the template's order.
        gaps: The passages.
    """
    fitting = [room for room, cell in enumerate(cells) if min(_inner(cell).width, _inner(cell).height) >= -1e-9]
    if not fitting:
        return None
    room = min(fitting, key=lambda each: (_RANKS[resolved.rooms[each].type], -cells[each].area))
    inner, exits = _inner(cells[room]), [gap for gap in gaps if room in gap.rooms]
    spots = [
        (inner.x_min + u * inner.width, inner.y_min + v * inner.height) for u, v in rng.random((_SPOTS, 2)).tolist()
    ]
    spots += [_clamp(gap.center, inner, reach) for gap in exits for reach in _reaches(resolved, gap)]
    taste = rng.random(len(spots)).tolist()
    costs = [_cost(resolved, exits, spot) + _TASTE_M * each for spot, each in zip(spots, taste, strict=True)]
    x, y = spots[costs.index(min(costs))]
    return round(x, 2), round(y, 2)


def _inner(cell: Box) -> Box:
    """Returns where the centre of the clear disc can be; its sides are whole centimetres, as those of cells."""
    return cell.grown(-WALL_M / 2 - START_CLEAR_M)


def _reaches(resolved: ResolvedTemplate, gap: Gap) -> tuple[float, ...]:
    """Returns how far from the wall of a way out to begin: at once, or beyond the reach of its leaf."""
    return (0.0,) if resolved.doors is None else (0.0, gap.width)


def _clamp(point: tuple[float, float], inner: Box, reach: float) -> tuple[float, float]:
    """Returns the place next to a point that is inside by that much, where there is so much."""
    in_x, in_y = min(reach, inner.width / 2), min(reach, inner.height / 2)
    x = min(max(point[0], inner.x_min + in_x), inner.x_max - in_x)
    y = min(max(point[1], inner.y_min + in_y), inner.y_max - in_y)
    return x, y


def _cost(resolved: ResolvedTemplate, exits: Sequence[Gap], spot: tuple[float, float]) -> float:
    """Returns how far it is to the next way out, and what leaves are in the way."""
    x, y = spot
    cost = min((abs(gap.center[0] - x) + abs(gap.center[1] - y) for gap in exits), default=0.0)
    if resolved.doors is None:
        return cost
    for gap in (each for each in exits if each.kind == "Doorway"):
        swing = gap.box(gap.width + WALL_M / 2)
        dx, dy = max(swing.x_min - x, x - swing.x_max, 0.0), max(swing.y_min - y, y - swing.y_max, 0.0)
        cost += _SWING_M * (dx * dx + dy * dy < START_CLEAR_M * START_CLEAR_M)
    return cost


def hindrance(
    resolved: ResolvedTemplate, cells: Sequence[Box], gaps: Sequence[Gap], start: tuple[float, float] | None
) -> str:
    """Returns what keeps the template's robot from the start or from a room, for a person; empty for nothing.

    In a room without furniture a disc gets everywhere that it fits, and through every gap wider than itself.

    Args:
        resolved: What the template asks for.
        cells: Each room's cell, in the template's order.
        gaps: The passages.
        start: Where the robot starts; None for nowhere.
    """
    names = [room.name for room in resolved.rooms]
    floors = [cell.grown(-WALL_M / 2) for cell in cells]
    if start is None or not any(_holds(floor, start) for floor in floors):
        return f"no room holds the {START_CLEAR_M} m around the start that are kept clear"
    for name, floor in zip(names, floors, strict=True):
        if min(floor.width, floor.height) < passable_width(resolved) - EPSILON_M:
            return f"{name} is {floor.width:.2f} x {floor.height:.2f} m, too narrow for the robot"
    reached = {next(room for room, floor in enumerate(floors) if _holds(floor, start))}
    wide = [gap.rooms for gap in gaps if gap.width > doorway_width(resolved) - EPSILON_M]
    for _ in names:
        reached |= {room for pair in wide if reached & set(pair) for room in pair}
    if apart := [name for room, name in enumerate(names) if room not in reached]:
        return f"no way leads to {', '.join(apart)}"
    return ""


def _holds(floor: Box, start: tuple[float, float]) -> bool:
    x, y = start
    inner = floor.grown(EPSILON_M - START_CLEAR_M)
    return inner.x_min <= x <= inner.x_max and inner.y_min <= y <= inner.y_max
