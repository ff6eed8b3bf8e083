"""Where the robot starts: in a room where one would put it down, near a way out.

Whether a robot gets about a bare floor plan: exact, because rooms are rectangles and passages lie in their walls.
"""

from collections.abc import Sequence

import numpy as np

from specs.data.world import RoomType
from tasks.worlds.brief import Brief
from tasks.worlds.floorplan.passages import Gap
from tasks.worlds.floorplan.scoring import WALL_M, doorway_width, passable_width
from tasks.worlds.geometry.boxes import EPSILON_M, Box

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


def choose_start(
    rng: np.random.Generator, brief: Brief, cells: Sequence[Box], gaps: Sequence[Gap]
) -> tuple[float, float] | None:
    """Returns where the robot starts, in whole centimetres; None when no room holds the clear disc.

    Floor that is kept free for walking anyway is the best place for a disc that must be free.

    Args:
        rng: The floor plan's stream.
        brief: What the template asks for.
        cells: Each room's cell, in the brief's order.
        gaps: The passages.
    """
    fitting = [room for room, cell in enumerate(cells) if min(_inner(cell).width, _inner(cell).height) >= -1e-9]
    if not fitting:
        return None
    room = min(fitting, key=lambda each: (_RANKS[brief.rooms[each].type], -cells[each].area))
    inner, exits = _inner(cells[room]), [gap for gap in gaps if room in gap.rooms]
    spots = [
        (inner.x_min + u * inner.width, inner.y_min + v * inner.height) for u, v in rng.random((_SPOTS, 2)).tolist()
    ]
    spots += [_clamp(gap.center, inner, reach) for gap in exits for reach in _reaches(brief, gap)]
    taste = rng.random(len(spots)).tolist()
    costs = [_cost(brief, exits, spot) + _TASTE_M * each for spot, each in zip(spots, taste, strict=True)]
    x, y = spots[costs.index(min(costs))]
    return round(x, 2), round(y, 2)


def _inner(cell: Box) -> Box:
    """Returns where the centre of the clear disc can be; its sides are whole centimetres, as those of cells."""
    return cell.grown(-WALL_M / 2 - START_CLEAR_M)


def _reaches(brief: Brief, gap: Gap) -> tuple[float, ...]:
    """Returns how far from the wall of a way out to begin: at once, or beyond the reach of its leaf."""
    return (0.0,) if brief.doors is None else (0.0, gap.width)


def _clamp(point: tuple[float, float], inner: Box, reach: float) -> tuple[float, float]:
    """Returns the place next to a point that is inside by that much, where there is so much."""
    in_x, in_y = min(reach, inner.width / 2), min(reach, inner.height / 2)
    x = min(max(point[0], inner.x_min + in_x), inner.x_max - in_x)
    y = min(max(point[1], inner.y_min + in_y), inner.y_max - in_y)
    return x, y


def _cost(brief: Brief, exits: Sequence[Gap], spot: tuple[float, float]) -> float:
    """Returns how far it is to the next way out, and what leaves are in the way."""
    x, y = spot
    cost = min((abs(gap.center[0] - x) + abs(gap.center[1] - y) for gap in exits), default=0.0)
    if brief.doors is None:
        return cost
    for gap in (each for each in exits if each.kind == "Doorway"):
        swing = gap.box(gap.width + WALL_M / 2)
        dx, dy = max(swing.x_min - x, x - swing.x_max, 0.0), max(swing.y_min - y, y - swing.y_max, 0.0)
        cost += _SWING_M * (dx * dx + dy * dy < START_CLEAR_M * START_CLEAR_M)
    return cost


def hindrance(brief: Brief, cells: Sequence[Box], gaps: Sequence[Gap], start: tuple[float, float] | None) -> str:
    """Returns what keeps the brief's robot from the start or from a room, for a person; empty for nothing.

    In a room without furniture a disc gets everywhere that it fits, and through every gap wider than itself.

    Args:
        brief: What the template asks for.
        cells: Each room's cell, in the brief's order.
        gaps: The passages.
        start: Where the robot starts; None for nowhere.
    """
    names = [room.name for room in brief.rooms]
    floors = [cell.grown(-WALL_M / 2) for cell in cells]
    if start is None or not any(_holds(floor, start) for floor in floors):
        return f"no room holds the {START_CLEAR_M} m around the start that are kept clear"
    for name, floor in zip(names, floors, strict=True):
        if min(floor.width, floor.height) < passable_width(brief) - EPSILON_M:
            return f"{name} is {floor.width:.2f} x {floor.height:.2f} m, too narrow for the robot"
    reached = {next(room for room, floor in enumerate(floors) if _holds(floor, start))}
    wide = [gap.rooms for gap in gaps if gap.width > doorway_width(brief) - EPSILON_M]
    for _ in names:
        reached |= {room for pair in wide if reached & set(pair) for room in pair}
    if apart := [name for room, name in enumerate(names) if room not in reached]:
        return f"no way leads to {', '.join(apart)}"
    return ""


def _holds(floor: Box, start: tuple[float, float]) -> bool:
    x, y = start
    inner = floor.grown(EPSILON_M - START_CLEAR_M)
    return inner.x_min <= x <= inner.x_max and inner.y_min <= y <= inner.y_max
