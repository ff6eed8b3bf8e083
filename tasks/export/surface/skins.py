"""The faces of the walls as each room sees them: which parts of its sides are wall, and where its windows are.

Walls stay what the world says they are. A skin is a sheet just in front of a wall's face that is seen and not touched.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from specs.data.world import Rectangle, Room, Solid, Window, World

SKIN_LIFT_M = 0.001
_TOLERANCE_M = 0.002


@dataclass(frozen=True)
class Side:
    """One of the four sides of a room, seen from within.

    Attributes:
        along: The axis that it runs along.
        at_m: Where the walls' faces are, on the other axis.
        inwards: Where the room lies from there, on the other axis.
        start_m: Where it begins, along its axis.
        end_m: Where it ends.
    """

    along: Literal["x", "y"]
    at_m: float
    inwards: Literal[1, -1]
    start_m: float
    end_m: float

    def point_m(self, along_m: float, lift_m: float) -> tuple[float, float]:
        """Returns the point of the floor at a place along the side, ``lift_m`` in front of it."""
        across_m = self.at_m + self.inwards * lift_m
        return (along_m, across_m) if self.along == "x" else (across_m, along_m)


@dataclass(frozen=True)
class Panel:
    """A rectangle of wall on a side of a room.

    Attributes:
        side: Where it is.
        start_m: Where it begins, along the side's axis.
        end_m: Where it ends.
        bottom_m: From what height.
        top_m: To what height.
    """

    side: Side
    start_m: float
    end_m: float
    bottom_m: float
    top_m: float


def sides(floor: Rectangle) -> tuple[Side, Side, Side, Side]:
    """Returns a room's sides: south, north, west, east."""
    return (
        Side("x", floor.y_min_m, 1, floor.x_min_m, floor.x_max_m),
        Side("x", floor.y_max_m, -1, floor.x_min_m, floor.x_max_m),
        Side("y", floor.x_min_m, 1, floor.y_min_m, floor.y_max_m),
        Side("y", floor.x_max_m, -1, floor.y_min_m, floor.y_max_m),
    )


def wall_panels(world: World, room: Room) -> tuple[Panel, ...]:
    """Returns what of the walls one sees in a room: nothing where a passage or a window is, lintels above passages."""
    panels = (panel for side in sides(room.floor) for panel in _covered(side, world.walls))
    holes = [_opening(side, window) for side, window in windows_of(world, room)]
    return tuple(part for panel in panels for part in _without(panel, holes))


def windows_of(world: World, room: Room) -> list[tuple[Side, Window]]:
    """Returns the windows of a room, each with the side that it is in."""
    return [(_side_of(window, room), window) for window in world.windows if window.room == room.name]


def _side_of(window: Window, room: Room) -> Side:
    across_m = window.center_m[1] if window.along == "x" else window.center_m[0]
    parallel = [side for side in sides(room.floor) if side.along == window.along]
    return min(parallel, key=lambda side: abs(side.at_m - across_m))


def _opening(side: Side, window: Window) -> Panel:
    middle_m = window.center_m[0] if window.along == "x" else window.center_m[1]
    half_m = window.width_m / 2
    return Panel(side, middle_m - half_m, middle_m + half_m, window.bottom_m, window.top_m)


def _covered(side: Side, walls: Sequence[Solid]) -> Iterator[Panel]:
    """Yields the part of a side that each wall whose face lies in it covers."""
    along, across = (0, 1) if side.along == "x" else (1, 0)
    for wall in walls:
        half_m = wall.half_extents_m
        face_m = wall.center_m[across] + side.inwards * half_m[across]
        start_m = max(side.start_m, wall.center_m[along] - half_m[along])
        end_m = min(side.end_m, wall.center_m[along] + half_m[along])
        if not wall.yaw_rad and abs(face_m - side.at_m) < _TOLERANCE_M and end_m - start_m > _TOLERANCE_M:
            yield Panel(side, start_m, end_m, wall.center_m[2] - half_m[2], wall.center_m[2] + half_m[2])


def _without(panel: Panel, holes: Sequence[Panel]) -> list[Panel]:
    """Returns a panel as the rectangles that the holes in it leave."""
    parts = [panel]
    for hole in holes:
        if hole.side == panel.side:
            parts = [rest for part in parts for rest in _cut(part, hole)]
    return parts


def _cut(panel: Panel, hole: Panel) -> list[Panel]:
    start_m, end_m = max(panel.start_m, hole.start_m), min(panel.end_m, hole.end_m)
    bottom_m, top_m = max(panel.bottom_m, hole.bottom_m), min(panel.top_m, hole.top_m)
    if start_m >= end_m or bottom_m >= top_m:
        return [panel]
    rests = [
        Panel(panel.side, panel.start_m, start_m, panel.bottom_m, panel.top_m),
        Panel(panel.side, end_m, panel.end_m, panel.bottom_m, panel.top_m),
        Panel(panel.side, start_m, end_m, panel.bottom_m, bottom_m),
        Panel(panel.side, start_m, end_m, top_m, panel.top_m),
    ]
    return [rest for rest in rests if rest.end_m > rest.start_m and rest.top_m > rest.bottom_m]
