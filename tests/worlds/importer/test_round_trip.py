"""What Simyard exports, it imports as it was."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from specs.data.world import MOST_CORNERS, Furniture, Solid, World, is_convex, solids
from tasks.export.format.formats import format_files
from tasks.worlds.importer.assemble import ImportedAs, assemble_world
from tasks.worlds.importer.map_agreement import outline
from tasks.worlds.importer.mjcf_reader import read_mjcf
from tasks.worlds.importer.sdf_reader import read_sdf
from tasks.worlds.importer.source_scene import Scene
from tests.export.variants import with_door
from tests.factories.own_worlds import GREY, walled_hall


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


@st.composite
def prism_outlines(draw: st.DrawFn) -> tuple[tuple[float, float], ...]:
    """Returns corners on an ellipse, about the middle of the box around them."""
    count, size_m = draw(st.integers(3, MOST_CORNERS)), [draw(st.floats(0.005, 3.0)) for _ in "xy"]
    turns = [(place + draw(st.floats(0.0, 0.8))) * math.tau / count for place in range(count)]
    ring = np.array([(math.cos(turn), math.sin(turn)) for turn in turns]) * size_m
    ring -= (ring.min(axis=0) + ring.max(axis=0)) / 2
    return tuple((round(x, 6), round(y, 6)) for x, y in ring.tolist())


@st.composite
def upright_solids(draw: st.DrawFn) -> Solid:
    """Returns a solid that is higher than 3 cm, somewhere between the floor and high above head height."""
    shapes: list[Literal["box", "cylinder", "prism"]] = ["box", "cylinder", "prism", "prism"]
    shape = draw(st.sampled_from(shapes))
    half_x_m, half_y_m = draw(st.floats(0.005, 3.0)), draw(st.floats(0.005, 3.0))
    corners = draw(prism_outlines().filter(is_convex)) if shape == "prism" else None
    if corners:
        half_x_m, half_y_m = (max(axis) for axis in zip(*corners, strict=True))
    low_m, high_m = draw(st.floats(0.0, 4.0)), draw(st.floats(0.04, 3.0))
    return Solid(
        name="solid",
        shape=shape,
        center_m=(draw(st.floats(-40, 90)), draw(st.floats(-40, 90)), low_m + high_m / 2),
        half_extents_m=(half_x_m, half_x_m if shape == "cylinder" else half_y_m, high_m / 2),
        yaw_rad=0.0 if shape == "cylinder" else draw(st.floats(-math.pi, math.pi)),
        color=GREY,
        outline_m=corners,
    )


@st.composite
def pieces(draw: st.DrawFn, number: int) -> Furniture:
    """Returns a piece whose place is not that of its solids."""
    name, made = f"piece-{number}", draw(st.lists(upright_solids(), min_size=1, max_size=3))
    named = tuple(each.model_copy(update={"name": f"{name}/part-{place}"}) for place, each in enumerate(made))
    center_m, yaw_rad = (draw(st.floats(-40, 90)), draw(st.floats(-40, 90))), draw(st.floats(-math.pi, math.pi))
    return Furniture(name=name, model_type="rack", room="", center_m=center_m, yaw_rad=yaw_rad, solids=named)


def apart_m(one: Solid, other: Solid) -> float:
    """Returns how far surfaces of two solids are apart, to the side or up and down."""
    ends = [[each.center_m[2] + sign * each.half_extents_m[2] for sign in (-1, 1)] for each in (one, other)]
    return max(
        shapely.hausdorff_distance(outline(one), outline(other)), *(abs(a - b) for a, b in zip(*ends, strict=True))
    )


@given(made=st.tuples(pieces(0), pieces(1), pieces(2)))
@settings(max_examples=40, deadline=None)
def test_an_exported_world_of_any_shapes_comes_back_piece_by_piece(
    tmp_path_factory: pytest.TempPathFactory, made: tuple[Furniture, ...]
):
    # So wide a hall that no piece is taken for its floor.
    world, folder = walled_hall((80.0, 80.0), made), tmp_path_factory.mktemp("sdf")
    scene = read_export(world, folder, "sdf", ".world", lambda path: read_sdf(path, sorted(folder.rglob("models"))))
    building, *others = scene.pieces
    assert max(apart_m(*pair) for pair in zip(world.walls, building.solids, strict=True)) <= 0.001
    for one, other in zip(world.furniture, others, strict=True):
        assert other.name == one.name
        assert math.dist(one.center_m, other.center_m) <= 0.001
        assert abs(math.remainder(one.yaw_rad - other.yaw_rad, math.tau)) <= 0.001
        assert max(apart_m(*pair) for pair in zip(one.solids, other.solids, strict=True)) <= 0.001
    assert scene.exact == scene.parts


def test_the_walls_of_an_exported_gazebo_world_are_walls_again(tmp_path: Path):
    world = with_door(30.0)
    scene = read_export(world, tmp_path, "sdf", ".world", lambda path: read_sdf(path, sorted(tmp_path.rglob("models"))))
    again = assemble_world(scene, ImportedAs("again", "sdf", "again.world"))
    assert max(apart_m(*pair) for pair in zip(world.walls, again.walls, strict=True)) <= 0.001


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
