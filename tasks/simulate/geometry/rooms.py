"""Which rooms of a world a robot was in, and which rooms and goals it cannot get to, with all doors as they stand.

Rooms entered are counted by the robot's position at every control step. What a robot cannot get to is found on the
floor map, for a disc of its hull's radius. A cell may be off the best way by half its diagonal, and is forgiven that
much: a room is called out of reach only where there is no way, and never because of the grid.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple, cast

import numpy as np
from jaxtyping import Float, Int32
from scipy import ndimage

from specs.data.world import FloorZone, Room
from tasks.simulate.application.contract import HostMap, Placement

_HALF_DIAGONAL = math.sqrt(0.5)
# The clearance of floor that is free at all, for robots that are smaller than a cell.
_FREE_M = 1e-6


Areas = Sequence[Room] | Sequence[FloorZone]


class RoomMap(NamedTuple):
    """The rooms of a world, and the floor that hangs together for a robot.

    Attributes:
        names: Of the rooms.
        rooms: They themselves; zones where a world has none.
        parts: A number for each part of the floor that the robot can drive about on, 0 where it has no room.
        held: The parts that each room has floor of.
    """

    names: tuple[str, ...]
    rooms: Areas
    floor: HostMap
    parts: Int32[np.ndarray, "rows columns"]
    held: tuple[frozenset[int], ...]


class Visit(NamedTuple):
    """Where an episode took a robot, and where it cannot get to from its start.

    Attributes:
        entered: Names of the rooms that it was in, in the order in which it came to them.
        unreachable: Names of those that it cannot get to.
        goals_reachable: How many of its goals it can get to; None where goals are no destinations.
    """

    entered: tuple[str, ...]
    unreachable: tuple[str, ...]
    goals_reachable: int | None


def room_map(rooms: Areas, floor: HostMap, radius_m: float) -> RoomMap:
    """Returns the rooms of a world as a robot finds them.

    Args:
        rooms: The world's, or its zones.
        floor: Its map.
        radius_m: Of the robot's hull.
    """
    least_m = max(radius_m - _HALF_DIAGONAL * float(floor.cell_m), _FREE_M)
    labels, _ = cast("tuple[np.ndarray, int]", ndimage.label(floor.clearance_m >= least_m, structure=np.ones((3, 3))))
    parts = labels.astype(np.int32)
    held = tuple(_parts_of(room, floor, parts) for room in rooms)
    return RoomMap(tuple(room.name for room in rooms), rooms, floor, parts, held)


def visit(rooms: RoomMap, placement: Placement, way_m: Float[np.ndarray, "steps 2"], *, known_way: bool) -> Visit:
    """Returns where an episode took its robot.

    Args:
        rooms: The world's.
        placement: Start and goals.
        way_m: Its positions at the start and at the end of each control step.
        known_way: Whether a shortest way to all goals is known, so that all of them can be reached.
    """
    return visits(rooms, [placement], way_m[None], [known_way])[0]


def visits(
    rooms: RoomMap,
    placements: Sequence[Placement],
    ways_m: Float[np.ndarray, "episodes steps 2"],
    known_ways: Sequence[bool],
) -> list[Visit]:
    """Returns where episodes in one world took their robots; the rest as in ``visit``.

    Args:
        rooms: The world's.
        placements: Starts and goals.
        ways_m: Their positions; one that ended earlier stays where it is.
        known_ways: Of each, whether a shortest way to all its goals is known.
    """
    all_entered = _rooms_entered(rooms, ways_m)
    return [
        _visit(rooms, placement, entered, known_way=known)
        for placement, entered, known in zip(placements, all_entered, known_ways, strict=True)
    ]


def rooms_entered(rooms: RoomMap, way_m: Float[np.ndarray, "steps 2"]) -> tuple[str, ...]:
    """Returns the names of the rooms that a way leads through, in the order in which it comes to them."""
    return _rooms_entered(rooms, way_m[None])[0]


def _rooms_entered(rooms: RoomMap, ways_m: Float[np.ndarray, "episodes steps 2"]) -> list[tuple[str, ...]]:
    episodes, steps, _ = ways_m.shape
    x_m, y_m = ways_m.reshape(-1, 2).T
    held = [room.holds(x_m, y_m) for room in rooms.rooms]
    inside = np.array(held, bool).reshape(len(held), episodes, steps)
    firsts = np.where(inside.any(axis=2), np.argmax(inside, axis=2), steps)
    order = np.argsort(firsts, axis=0, kind="stable").T.tolist()
    found = np.sum(firsts < steps, axis=0).tolist()
    return [tuple(rooms.names[room] for room in ranks[:count]) for ranks, count in zip(order, found, strict=True)]


def _visit(rooms: RoomMap, placement: Placement, entered: tuple[str, ...], *, known_way: bool) -> Visit:
    begin = placement.start[:2]
    near_m = float(rooms.floor.cell_m)
    reached = _parts_within(rooms.floor, rooms.parts, begin - near_m, begin + near_m)
    unreachable = tuple(
        name for name, held in zip(rooms.names, rooms.held, strict=True) if not held & reached and name not in entered
    )
    goals = len(placement.goals_m)
    if placement.arrived_m is None or known_way:
        return Visit(entered, unreachable, None if placement.arrived_m is None else goals)
    found = sum(_is_near(rooms, reached, goal, placement.arrived_m) for goal in placement.goals_m)
    return Visit(entered, unreachable, min(found, goals - 1))


def _parts_of(room: Room | FloorZone, floor: HostMap, parts: Int32[np.ndarray, "rows columns"]) -> frozenset[int]:
    """Returns the parts of the floor that have a cell's centre in a room, or in a zone."""
    low = np.array([room.floor.x_min_m, room.floor.y_min_m])
    high = np.array([room.floor.x_max_m, room.floor.y_max_m])
    if isinstance(room, FloorZone):
        y, x = np.indices(parts.shape) * float(floor.cell_m) + np.float64(floor.origin_m[::-1, None, None])
        parts = np.where(room.holds(x, y), parts, 0)
    return _parts_within(floor, parts, low, high)


def _parts_within(
    floor: HostMap,
    parts: Int32[np.ndarray, "rows columns"],
    low_m: Float[np.ndarray, "2"],
    high_m: Float[np.ndarray, "2"],
) -> frozenset[int]:
    """Returns the parts of the floor that have a cell's centre in a rectangle."""
    # Python's numbers: NumPy takes longer to begin than a few of them take.
    origin_m, cell_m = floor.origin_m.tolist(), float(floor.cell_m)
    x, y = (
        _cells(low - origin, high - origin, cell_m, count)
        for low, high, origin, count in zip(
            low_m.tolist(), high_m.tolist(), origin_m, reversed(parts.shape), strict=True
        )
    )
    return frozenset(parts[y, x].ravel().tolist()) - {0}


def _cells(low_m: float, high_m: float, cell_m: float, count: int) -> slice:
    """Returns the cells whose centres lie between two places, of so many that begin at 0 m."""
    first, last = (min(max(each / cell_m, -1.0), count) for each in (low_m, high_m))
    return slice(max(0, math.ceil(first)), math.floor(last) + 1)


def _is_near(rooms: RoomMap, reached: frozenset[int], goal_m: Float[np.ndarray, "2"], arrived_m: float) -> bool:
    """Returns whether the robot can come as near to a goal as it must."""
    floor = rooms.floor
    near_m = arrived_m + float(floor.cell_m)
    return bool(_parts_within(floor, rooms.parts, goal_m - near_m, goal_m + near_m) & reached)
