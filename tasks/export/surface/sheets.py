"""Floors and walls as they look: flat meshes with texture coordinates, for formats that know meshes.

A sheet is seen and not touched; it lies a millimetre in front of what it covers, so that nothing flickers.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from specs.data.world import Finish, Room, World
from specs.digest import digest
from tasks.export.surface.skins import SKIN_LIFT_M, Panel, wall_panels
from tasks.export.surface.textures import texture_of

FLOOR_PREFIX = "floor/"
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
    """Returns the coverings of all rooms, a floor and, where there is any wall, walls for each."""
    found: list[Covering] = []
    for room in world.rooms:
        found.append(floor_sheet(room))
        panels = wall_panels(world, room)
        if panels:
            found.append(_sheet(WALLS_PREFIX + room.name, room.walls, [_upright(panel) for panel in panels]))
    return found


def floor_sheet(room: Room) -> Covering:
    """Returns the covering of a room's floor."""
    area = room.floor
    corners = [(area.x_min_m, area.y_min_m), (area.x_max_m, area.y_min_m), (area.x_max_m, area.y_max_m)]
    corners.append((area.x_min_m, area.y_max_m))
    quad = [(x_m, y_m, SKIN_LIFT_M, x_m - area.x_min_m, y_m - area.y_min_m) for x_m, y_m in corners]
    return _sheet(FLOOR_PREFIX + room.name, room.flooring, [quad])


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
