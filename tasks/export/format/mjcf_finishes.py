"""Floors and walls of an MJCF as they look: materials from finishes, sheets in front of the walls, windows.

Everything here is seen by cameras and hit by rays, and touches nothing.
"""

import math
from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float, Int

from specs.data.world import Finish, Room, World
from tasks.export.format.mjcf_geoms import GRID_SPACING_M, WALL_GROUP, add_plane, add_solid_geom
from tasks.export.surface.sheets import FLOOR_PREFIX, WALLS_PREFIX, finish_key
from tasks.export.surface.skins import SKIN_LIFT_M, Panel, wall_panels
from tasks.export.surface.textures import texture_of
from tasks.export.surface.window_boxes import window_parts

TEXTURE_FOLDER = "textures"

FLOOR_LIFT_M = 0.001


def add_floor(spec: mujoco.MjSpec, room: Room) -> None:
    """Adds the sheet that shows a room's flooring, a millimetre above the ground."""
    geom = add_plane(spec, FLOOR_PREFIX + room.name, room.floor, FLOOR_LIFT_M)
    geom.material = name = f"floor-{finish_key(room.flooring)}"
    _untouchable(geom)
    if spec.material(name) is not None:
        return
    material = _add_material(spec, name, room.flooring)
    texture = texture_of(room.flooring)
    if texture is not None:
        # Measured on MuJoCo 3.17: on a plane, "repetitions per unit" counts units of two metres.
        material.texuniform = True
        material.texrepeat = [2.0 / texture.extent_m[0], 2.0 / texture.extent_m[1]]


def add_walls(spec: mujoco.MjSpec, world: World, room: Room, number: int) -> None:
    """Adds one mesh with all that one sees of the walls in a room; seen from behind it is not there.

    Args:
        spec: The model.
        world: Whose walls.
        room: The room that they are seen from.
        number: The room's place among the world's, for the mesh's name.
    """
    panels = wall_panels(world, room)
    if not panels:
        return
    texture = texture_of(room.walls)
    grids = [_grid(panel, texture.extent_m if texture else (1.0, 1.0)) for panel in panels]
    offsets = np.cumsum([0, *(len(vertices) for vertices, _, _ in grids[:-1])])
    mesh = spec.add_mesh(name=f"walls-{number}", inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    mesh.uservert = np.concatenate([vertices for vertices, _, _ in grids]).ravel()
    mesh.usertexcoord = np.concatenate([coordinates for _, coordinates, _ in grids]).ravel()
    mesh.userface = np.concatenate(
        [faces + offset for (_, _, faces), offset in zip(grids, offsets, strict=True)]
    ).ravel()
    geom = spec.worldbody.add_geom(
        name=WALLS_PREFIX + room.name,
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=mesh.name,
        group=WALL_GROUP,
    )
    _untouchable(geom)
    geom.material = name = f"walls-{finish_key(room.walls)}"
    if spec.material(name) is None:
        _add_material(spec, name, room.walls)


def add_windows(spec: mujoco.MjSpec, world: World, room: Room) -> None:
    """Adds a room's windows."""
    for part in window_parts(world, room):
        _untouchable(add_solid_geom(spec.worldbody, part, WALL_GROUP))


def _add_material(spec: mujoco.MjSpec, name: str, finish: Finish) -> mujoco.MjsMaterial:
    """Returns a new material; its texture's file is in ``spec.assets`` under the name that the model says."""
    material = spec.add_material(name=name, specular=0.1, shininess=0.1)
    texture = texture_of(finish)
    if texture is None:
        material.rgba = [*finish.color, 1.0]
        return material
    key = finish_key(finish)
    if spec.texture(key) is None:
        file = f"{TEXTURE_FOLDER}/{key}.png"
        spec.assets = {**spec.assets, file: texture.png}
        spec.add_texture(name=key, type=mujoco.mjtTexture.mjTEXTURE_2D, file=file)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = key
    return material


def _untouchable(geom: mujoco.MjsGeom) -> None:
    geom.contype = 0
    geom.conaffinity = 0


def _grid(
    panel: Panel, extent_m: tuple[float, float]
) -> tuple[Float[np.ndarray, "points 3"], Float[np.ndarray, "points 2"], Int[np.ndarray, "faces 3"]]:
    """Returns a panel as vertices, texture coordinates and triangles that face the room."""
    along_m, up_m = _steps(panel.start_m, panel.end_m), _steps(panel.bottom_m, panel.top_m)
    points = [(a_m, z_m) for z_m in up_m for a_m in along_m]
    vertices = np.array([(*panel.side.point_m(a_m, SKIN_LIFT_M), z_m) for a_m, z_m in points])
    coordinates = np.array(points) / np.array(extent_m)
    columns = len(along_m)
    first = np.array([row * columns + column for row in range(len(up_m) - 1) for column in range(columns - 1)])
    second, above = first + 1, first + columns
    lower, upper = np.stack([first, second, above], axis=1), np.stack([second, above + 1, above], axis=1)
    faces = np.concatenate([lower, upper])
    # Anticlockwise from within: x runs to the left of one who looks north to south, y to the right from east to west.
    turned = (panel.side.along == "x") == (panel.side.inwards == 1)
    return vertices, coordinates, faces[:, ::-1] if turned else faces


def _steps(start_m: float, end_m: float) -> Sequence[float]:
    count = max(1, math.ceil((end_m - start_m) / (2 * GRID_SPACING_M)))
    return [start_m + (end_m - start_m) * number / count for number in range(count + 1)]
