"""What Simyard exports, it imports as it was."""

from collections.abc import Callable
from pathlib import Path

import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from specs.data.world import World, solids
from tasks.export.format.formats import format_files
from tasks.worlds.importer.map_agreement import outline
from tasks.worlds.importer.mjcf_reader import read_mjcf
from tasks.worlds.importer.sdf_reader import read_sdf
from tasks.worlds.importer.source_scene import Scene
from tests.export.variants import with_door


def read_export(world: World, folder: Path, name: str, suffix: str, read: Callable[[Path], Scene]) -> Scene:
    for path, body in format_files(world, name).items():  # type: ignore[arg-type]
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(body)
    (source,) = (path for path in folder.rglob(f"*{suffix}"))
    return read(source)


def differ_m(world: World, scene: Scene, height_m: float) -> float:
    """Returns how far the outlines of a world and of a scene are apart at a height."""
    one, other = (
        shapely.union_all(
            [outline(each) for each in found if abs(each.center_m[2] - height_m) < each.half_extents_m[2]]
        )
        for found in (solids(world), [solid for piece in scene.pieces for solid in piece.solids])
    )
    return float(shapely.hausdorff_distance(one, other))


@given(percent=st.floats(0.0, 100.0))
@settings(max_examples=5, deadline=None)
def test_an_exported_gazebo_world_comes_back_with_the_same_outlines(
    tmp_path_factory: pytest.TempPathFactory, percent: float
):
    world = with_door(percent)
    folder = tmp_path_factory.mktemp("sdf")
    scene = read_export(world, folder, "sdf", ".world", lambda path: read_sdf(path, sorted(folder.rglob("models"))))
    assert max(differ_m(world, scene, height) for height in (0.1, 0.5, 1.0, 1.9)) <= 0.001
    assert scene.exact == scene.parts


def test_an_exported_scene_of_mujoco_comes_back_with_the_same_outlines(tmp_path: Path):
    world = with_door(30.0)
    scene = read_export(world, tmp_path, "mjcf", ".xml", read_mjcf)
    assert max(differ_m(world, scene, height) for height in (0.1, 0.5, 1.0, 1.9)) <= 0.001
