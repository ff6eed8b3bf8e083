"""Khronos' validator takes the GLB, and trimesh finds in it what the world says, where the world says."""

import io
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from specs.data.world import World, solids
from tasks.export.format.glb import glb
from tasks.render.sheets import sheets
from tasks.render.textures import texture_of
from tests.export.validators import gltf_errors
from tests.export.variants import DOOR, HINGE_M, with_door, with_windows
from tests.factories.worlds import apartment

WORLD = with_windows(with_door(30.0))
# From glTF's frame, whose y is up, to the world's.
Z_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])


def loaded(world: World) -> trimesh.Scene:
    """Returns the file as trimesh reads it, in the world's frame."""
    scene = trimesh.load_scene(io.BytesIO(glb(world)), file_type="glb")
    scene.apply_transform(Z_UP)
    return scene


def named(scene: trimesh.Scene, name: str) -> trimesh.Trimesh:
    """Returns the mesh of a node, in the world's frame."""
    matrix, geometry = scene.graph[name]
    mesh = scene.geometry[geometry].copy()
    assert isinstance(mesh, trimesh.Trimesh)
    mesh.apply_transform(matrix)
    return mesh


def test_khronos_validator_finds_no_error(tmp_path: Path):
    (tmp_path / "world.glb").write_bytes(glb(WORLD))
    assert gltf_errors(tmp_path / "world.glb") == []


def test_khronos_validator_would_find_one(tmp_path: Path):
    body = glb(WORLD)
    (tmp_path / "world.glb").write_bytes(body.replace(b'"target":', b'"tarjet":').replace(b'"VEC3"', b'"VEC5"'))
    assert gltf_errors(tmp_path / "world.glb") != []


def test_every_solid_is_a_node_of_its_name_where_the_world_says():
    scene = loaded(WORLD)
    for solid in solids(WORLD):
        mesh = named(scene, solid.name)
        np.testing.assert_allclose(mesh.bounding_box.centroid, solid.center_m, atol=1e-5)
        assert mesh.extents[2] == pytest.approx(2 * solid.half_extents_m[2], abs=1e-5)
        volume = np.prod(solid.half_extents_m) * (8 if solid.shape == "box" else 2 * np.pi)
        assert mesh.volume == pytest.approx(volume, rel=0.01)


def test_solids_have_the_worlds_colours():
    scene = loaded(WORLD)
    for solid in solids(WORLD):
        material = scene.geometry[scene.graph[solid.name][1]].visual.material
        linear = np.array(material.baseColorFactor[:3], dtype=float) / 255.0
        shown = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
        np.testing.assert_allclose(shown, solid.color, atol=0.02)


def test_floors_and_walls_show_their_pictures_and_face_the_room():
    scene = loaded(WORLD)
    for sheet in sheets(WORLD):
        mesh = named(scene, sheet.name)
        texture = texture_of(sheet.finish)
        if texture is not None:
            picture = scene.geometry[scene.graph[sheet.name][1]].visual.material.baseColorTexture
            assert picture.convert("RGB").tobytes() == Image.open(io.BytesIO(texture.png)).convert("RGB").tobytes()
        room = next(room for room in WORLD.rooms if sheet.name.endswith(room.name))
        middle = np.array(
            [(room.floor.x_min_m + room.floor.x_max_m) / 2, (room.floor.y_min_m + room.floor.y_max_m) / 2, 1.3]
        )
        assert np.all(np.einsum("ij,ij->i", mesh.face_normals, middle - mesh.triangles_center) > 0)


def test_a_door_hangs_in_a_frame_at_its_hinge():
    matrix, _ = loaded(WORLD).graph[f"{DOOR}/frame"]
    assert matrix[:2, 3] == pytest.approx(HINGE_M)


def test_the_same_world_gives_the_same_bytes():
    assert glb(WORLD) == glb(WORLD) != glb(apartment())
