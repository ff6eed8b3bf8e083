"""The MJCF holds exactly the world: every solid, where it is, and nothing that a robot could bump into besides."""

import io
import math
import zipfile

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.world import Solid, World, solids
from tasks.export.mjcf import CEILING, FLOOR_LIFT_M, GROUND, OVERVIEW_CAMERA, world_spec, world_xml
from tests.worlds_factory import apartment


@pytest.fixture(scope="module")
def world() -> World:
    return apartment()


def ray_m(world: World, start_m: tuple[float, float, float], direction: tuple[float, float, float]) -> float:
    model = mujoco.MjModel.from_xml_string(world_xml(world))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return mujoco.mj_ray(model, data, np.array(start_m), np.array(direction), None, 1, -1, np.zeros(1, np.int32), None)


def test_every_solid_is_a_geom_of_its_name_and_size(world: World):
    model = mujoco.MjModel.from_xml_string(world_xml(world))
    for solid in solids(world):
        geom = model.geom(solid.name)
        x_m, y_m, z_m = solid.half_extents_m
        wanted = [x_m, z_m] if solid.shape == "cylinder" else [x_m, y_m, z_m]
        np.testing.assert_allclose(geom.size[: len(wanted)], wanted, atol=1e-6)
        np.testing.assert_allclose(geom.pos, solid.center_m, atol=1e-6)
        np.testing.assert_allclose(geom.rgba, [*solid.color, 1.0], atol=1e-6)


def test_only_the_ground_and_the_solids_can_be_touched(world: World):
    model = mujoco.MjModel.from_xml_string(world_xml(world))
    touchable = {model.geom(number).name for number in range(model.ngeom) if model.geom_contype[number]}
    assert touchable == {GROUND, *(solid.name for solid in solids(world))}


def test_a_turned_table_is_hit_where_it_turned(world: World):
    # The table's centre is (5.2, -0.8), half as deep as 0.4 m, turned 0.4 rad: straight from +y the face is 0.4 / cos.
    distance_m = ray_m(world, (5.2, 1.0, 0.3), (0.0, -1.0, 0.0))
    assert distance_m == pytest.approx(1.8 - 0.4 / math.cos(0.4), abs=1e-5)


def test_a_ray_through_the_doorway_crosses_both_rooms(world: World):
    assert ray_m(world, (-1.0, 0.5, 0.3), (1.0, 0.0, 0.0)) == pytest.approx(7.6, abs=1e-6)


def test_a_ray_downwards_meets_the_floor_of_the_room(world: World):
    assert ray_m(world, (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)) == pytest.approx(1.0 - FLOOR_LIFT_M, abs=1e-6)


def test_rooms_are_open_at_the_top_unless_a_ceiling_is_asked_for(world: World):
    assert world_spec(world).geom(CEILING) is None
    ceiling = world_spec(world, ceiling=True).geom(CEILING)
    assert ceiling.pos[2] - ceiling.size[2] == pytest.approx(world.ceiling_height_m)


def test_there_is_a_light_for_each_light_and_a_camera_above(world: World):
    model = mujoco.MjModel.from_xml_string(world_xml(world))
    assert model.nlight == len(world.lights)
    assert model.camera(OVERVIEW_CAMERA).pos[2] > world.ceiling_height_m


def test_a_zip_with_the_document_loads_as_a_spec(world: World):
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as bundle:
        bundle.writestr("worlds/g/w/world.xml", world_xml(world))
    assert mujoco.MjSpec.from_zip(packed).compile().ngeom == len(solids(world)) + len(world.rooms) + 1


def test_the_same_world_gives_the_same_text(world: World):
    assert world_xml(world) == world_xml(apartment())


printed = st.text(st.characters(codec="ascii", exclude_categories=("Cc",)), min_size=1, max_size=30)


@given(st.lists(printed, min_size=3, max_size=3, unique=True))
def test_names_with_quotes_and_brackets_survive(names: list[str]):
    world = apartment()
    walls = tuple(wall.model_copy(update={"name": name}) for wall, name in zip(world.walls, names, strict=False))
    named = world.model_copy(update={"walls": walls})
    model = mujoco.MjModel.from_xml_string(world_xml(named))
    assert {model.geom(number).name for number in range(model.ngeom)} >= set(names)


@given(st.floats(-math.pi, math.pi))
def test_a_geom_is_turned_as_its_solid(yaw_rad: float):
    world = apartment()
    turned: Solid = world.walls[0].model_copy(update={"yaw_rad": yaw_rad})
    spec = world_spec(world.model_copy(update={"walls": (turned,)}))
    w, _, _, z = spec.geom(turned.name).quat
    assert 2 * math.atan2(z, w) == pytest.approx(yaw_rad)
