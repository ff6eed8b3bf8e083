"""Floors, walls and windows as they look: flat meshes with texture coordinates, and windows as boxes.

Walls stay what the world says they are. A sheet is seen and not touched; it lies a millimetre in front of what it
covers, so that nothing flickers.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from jaxtyping import Float64, Int64

from specs.base import digest
from specs.data.world import Color, Finish, Rectangle, Room, Solid, Window, World
from tasks.render.textures import texture_of

SKIN_LIFT_M = 0.001
_TOLERANCE_M = 0.002


# Walls stay what the world says they are. A skin is a sheet just in front of a wall's face that is seen and not
# touched.
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
        if (
            wall.shape == "box"
            and not wall.yaw_rad
            and abs(face_m - side.at_m) < _TOLERANCE_M
            and end_m - start_m > _TOLERANCE_M
        ):
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


WINDOW_PREFIX = "window/"

_FRAME_M, _FRAME_DEPTH_M = 0.05, 0.02
_PANE_COLOR: Color = (0.72, 0.84, 0.93)
_FRAME_COLOR: Color = (0.95, 0.95, 0.94)


def window_parts(world: World, room: Room) -> list[Solid]:
    """Returns the panes and bars of a room's windows, named ``window/<room>/<number>/<in or out>/<part>``."""
    parts: list[Solid] = []
    for number, (side, window) in enumerate(windows_of(world, room), start=1):
        outside = Side(side.along, side.at_m - side.inwards * world.wall_thickness_m, _opposite(side), 0.0, 0.0)
        for face, where in ((side, "in"), (outside, "out")):
            parts += _on_face(face, window, f"{WINDOW_PREFIX}{room.name}/{number}/{where}")
    return parts


def _opposite(side: Side) -> Literal[1, -1]:
    return -1 if side.inwards == 1 else 1


def _on_face(face: Side, window: Window, name: str) -> list[Solid]:
    middle_m = window.center_m[0] if window.along == "x" else window.center_m[1]
    half_m, height_m = window.width_m / 2, (window.top_m + window.bottom_m) / 2
    tall_m, bar_m = (window.top_m - window.bottom_m) / 2, _FRAME_M / 2
    return [
        _part(face, f"{name}/{part}", (along_m, z_m), (half_along_m, half_up_m), is_pane=part == "pane")
        for part, along_m, z_m, half_along_m, half_up_m in (
            ("pane", middle_m, height_m, half_m, tall_m),
            ("sill", middle_m, window.bottom_m + bar_m, half_m, bar_m),
            ("head", middle_m, window.top_m - bar_m, half_m, bar_m),
            ("first", middle_m - half_m + bar_m, height_m, bar_m, tall_m - 2 * bar_m),
            ("last", middle_m + half_m - bar_m, height_m, bar_m, tall_m - 2 * bar_m),
            ("mullion", middle_m, height_m, bar_m, tall_m - 2 * bar_m),
        )
    ]


def _part(face: Side, name: str, middle_m: tuple[float, float], half_m: tuple[float, float], *, is_pane: bool) -> Solid:
    """Returns a box on a face of a wall, its middle and half sizes given along the wall and up."""
    depth_m = SKIN_LIFT_M if is_pane else _FRAME_DEPTH_M
    x_m, y_m = face.point_m(middle_m[0], depth_m / 2)
    flat_m = (half_m[0], depth_m / 2) if face.along == "x" else (depth_m / 2, half_m[0])
    return Solid(
        name=name,
        shape="box",
        center_m=(x_m, y_m, middle_m[1]),
        half_extents_m=(*flat_m, half_m[1]),
        yaw_rad=0.0,
        color=_PANE_COLOR if is_pane else _FRAME_COLOR,
    )


FLOOR_PREFIX = "floor/"
BARE_FLOOR = "floor"
_CONCRETE: Color = (0.62, 0.62, 0.6)
_BARE = Finish(material="Concrete", pattern="plain", color=_CONCRETE, accent=_CONCRETE, repeat_m=(1.0, 1.0))
WALLS_PREFIX = "walls/"
_DIGITS = 6


@dataclass(frozen=True)
class Covering:
    """One flat covering.

    Attributes:
        name: Unique in the world: ``floor/<room>`` or ``walls/<room>``.
        finish: What it looks like.
        vertices_m: Corners, in the world's frame.
        coordinates: Of the corners in the finish's picture, a unit a picture, upwards; finishes without one have
            metres.
        triangles: Indices of corners, anticlockwise where one sees it from.
    """

    name: str
    finish: Finish
    vertices_m: Float64[np.ndarray, "corners 3"]
    coordinates: Float64[np.ndarray, "corners 2"]
    triangles: Int64[np.ndarray, "triangles 3"]


def finish_key(finish: Finish) -> str:
    """Returns a name for what a finish looks like: the same for finishes that look the same, on any machine."""
    return f"{finish.pattern}-{digest(finish)[:12]}"


def sheets(world: World) -> list[Covering]:
    """Returns the coverings of all rooms, a floor and, where there is any wall, walls for each.

    A world without rooms has one bare floor.
    """
    found: list[Covering] = [] if world.rooms else [_floor_sheet(BARE_FLOOR, world.footprint, _BARE)]
    for room in world.rooms:
        found.append(_floor_sheet(FLOOR_PREFIX + room.name, room.floor, room.flooring))
        panels = wall_panels(world, room)
        if panels:
            found.append(_sheet(WALLS_PREFIX + room.name, room.walls, [_upright(panel) for panel in panels]))
    return found


def _floor_sheet(name: str, area: Rectangle, finish: Finish) -> Covering:
    corners = [(area.x_min_m, area.y_min_m), (area.x_max_m, area.y_min_m), (area.x_max_m, area.y_max_m)]
    corners.append((area.x_min_m, area.y_max_m))
    quad = [(x_m, y_m, SKIN_LIFT_M, x_m - area.x_min_m, y_m - area.y_min_m) for x_m, y_m in corners]
    return _sheet(name, finish, [quad])


def prism_mesh(solid: Solid) -> tuple[Float64[np.ndarray, "corners 3"], list[list[int]]]:
    """Returns a prism's corners about its centre, along its own axes, and its faces, anticlockwise from outside.

    The lower corners come first, then the upper ones; the bottom is the first face, the top the second.
    """
    outline, half_m = solid.outline_m or (), solid.half_extents_m[2]
    count = len(outline)
    corners = [(x_m, y_m, z_m) for z_m in (-half_m, half_m) for x_m, y_m in outline]
    sides = [[one, (one + 1) % count, count + (one + 1) % count, count + one] for one in range(count)]
    return np.array(corners), [list(range(count))[::-1], list(range(count, 2 * count)), *sides]


def triangles_of(faces: Sequence[Sequence[int]]) -> list[tuple[int, int, int]]:
    """Returns convex faces as triangles, a fan each."""
    return [(face[0], one, other) for face in faces for one, other in pairwise(face[1:])]


def _sheet(name: str, finish: Finish, quads: list[list[tuple[float, ...]]]) -> Covering:
    """Returns quadrilaterals as one sheet; a corner is (x, y, z, along, up), metres."""
    corners = np.round(np.array(quads).reshape(-1, 5), _DIGITS)
    texture = texture_of(finish)
    extent_m = np.array(texture.extent_m if texture else (1.0, 1.0))
    first = 4 * np.arange(len(quads))[:, None]
    triangles = (first + np.array([0, 1, 2, 0, 2, 3])).reshape(-1, 3)
    return Covering(name, finish, corners[:, :3], np.round(corners[:, 3:] / extent_m, _DIGITS), triangles)


def _upright(panel: Panel) -> list[tuple[float, ...]]:
    side = panel.side
    # Anticlockwise from within: there x runs to the left on the southern side, and y on the eastern one.
    leftwards = (side.along == "x") == (side.inwards == 1)
    ends_m = (panel.end_m, panel.start_m) if leftwards else (panel.start_m, panel.end_m)
    corners = [(ends_m[0], panel.bottom_m), (ends_m[1], panel.bottom_m), (ends_m[1], panel.top_m)]
    corners.append((ends_m[0], panel.top_m))
    return [(*side.point_m(along_m, SKIN_LIFT_M), z_m, along_m, z_m) for along_m, z_m in corners]
