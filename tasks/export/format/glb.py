"""A world as GLB (glTF 2.0, one file): a node a solid, named, furniture and doors grouped, pictures inside.

glTF has y up and knows metres; the root node turns the world's z there, so a program that converts back has the world's
own frame.
"""

import io
import math
from typing import cast

import numpy as np
import trimesh
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from specs.data.world import Color, Finish, Solid, World
from tasks.render.sheets import finish_key, prism_mesh, sheets, triangles_of, window_parts
from tasks.render.textures import texture_of

CYLINDER_SIDES = 32
_ROOT = "world"
_Y_UP = trimesh.transformations.rotation_matrix(-math.pi / 2, (1.0, 0.0, 0.0)).round(12) + 0.0
_ROUGHNESS = 0.9
_DIGITS = 6


def glb(world: World) -> bytes:
    """Returns the file; the same bytes for the same world."""
    scene = trimesh.Scene(base_frame=_ROOT)
    scene.graph.update(frame_to="building", frame_from=_ROOT, matrix=_Y_UP)
    colors: dict[Color, PBRMaterial] = {}
    for wall in world.walls:
        _add_solid(scene, wall, "building", colors)
    for room in world.rooms:
        for part in window_parts(world, room):
            _add_solid(scene, part, "building", colors)
    for sheet in sheets(world):
        mesh = trimesh.Trimesh(sheet.vertices_m, sheet.triangles, process=False)
        material = _finish(sheet.finish)
        mesh.visual = TextureVisuals(uv=sheet.coordinates, material=material)
        scene.add_geometry(mesh, node_name=sheet.name, geom_name=sheet.name, parent_node_name="building")
    for door in world.doors:
        _add_solid(scene, door.leaf, _group(scene, door.name, (*door.hinge_m, 0.0)), colors, origin_m=door.hinge_m)
    for piece in world.furniture:
        group = _group(scene, piece.name, (*piece.center_m, 0.0))
        for solid in piece.solids:
            _add_solid(scene, solid, group, colors, origin_m=piece.center_m)
    return cast("bytes", scene.export(file_type="glb"))


def _group(scene: trimesh.Scene, name: str, place_m: tuple[float, float, float]) -> str:
    """Returns the frame of a thing that is moved as a whole."""
    frame = f"{name}/frame"
    scene.graph.update(
        frame_to=frame, frame_from="building", matrix=trimesh.transformations.translation_matrix(place_m)
    )
    return frame


def _add_solid(
    scene: trimesh.Scene,
    solid: Solid,
    parent: str,
    colors: dict[Color, PBRMaterial],
    *,
    origin_m: tuple[float, float] = (0.0, 0.0),
) -> None:
    half_m = solid.half_extents_m
    if solid.shape == "cylinder":
        mesh = trimesh.creation.cylinder(radius=half_m[0], height=2 * half_m[2], sections=CYLINDER_SIDES)
    elif solid.shape == "prism":
        corners, faces = prism_mesh(solid)
        mesh = trimesh.Trimesh(corners, np.array(triangles_of(faces)), process=False)
    else:
        mesh = trimesh.creation.box(extents=[2 * side for side in half_m])
    mesh.vertices = np.round(mesh.vertices, _DIGITS)
    material = colors.setdefault(solid.color, _plain(solid.color))
    mesh.visual = TextureVisuals(material=material)
    place = (solid.center_m[0] - origin_m[0], solid.center_m[1] - origin_m[1], solid.center_m[2])
    matrix = trimesh.transformations.rotation_matrix(solid.yaw_rad, (0.0, 0.0, 1.0))
    matrix[:3, 3] = place
    matrix = np.round(matrix, 9) + 0.0
    scene.add_geometry(mesh, node_name=solid.name, geom_name=solid.name, parent_node_name=parent, transform=matrix)


def _finish(finish: Finish) -> PBRMaterial:
    texture = texture_of(finish)
    if texture is None:
        return _plain(finish.color)
    picture = Image.open(io.BytesIO(texture.png))
    return PBRMaterial(
        name=finish_key(finish), baseColorTexture=picture, metallicFactor=0.0, roughnessFactor=_ROUGHNESS
    )


def _plain(color: Color) -> PBRMaterial:
    """Returns a matt material of an sRGB colour; glTF's own factors are linear."""
    linear = [_linear(channel) for channel in color]
    name = "color-" + "".join(f"{round(255 * channel):02x}" for channel in color)
    return PBRMaterial(name=name, baseColorFactor=[*linear, 1.0], metallicFactor=0.0, roughnessFactor=_ROUGHNESS)


def _linear(channel: float) -> float:
    """Returns a channel of sRGB as linear light (IEC 61966-2-1)."""
    return channel / 12.92 if channel <= 0.04045 else ((channel + 0.055) / 1.055) ** 2.4
