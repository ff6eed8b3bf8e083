"""The MJCF holds exactly the world: every solid, where it is, and nothing that a robot could bump into besides."""

import io
import math
import zipfile
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from specs.data.world import Solid, World, solids
from tasks.export.format.mjcf import (
    CEILING,
    FLOOR_LIFT_M,
    GROUND,
    HINGE_SUFFIX,
    MJCF_FILE,
    OVERVIEW_CAMERA,
    mjcf_files,
    world_spec,
)
from tasks.render.sheets import FLOOR_PREFIX, SKIN_LIFT_M, WALLS_PREFIX
from tasks.render.textures import draw_texture
from tests.export.variants import DOOR, HINGE_M, LEAF_LENGTH_M, LEAF_THICKNESS_M, with_door, with_windows
from tests.factories.worlds import apartment


@pytest.fixture(scope="module")
def world() -> World:
    return apartment()


def loaded(world: World) -> mujoco.MjModel:
    """Returns the model as it is read from the exported files."""
    files = mjcf_files(world)
    return mujoco.MjModel.from_xml_string(files.pop(MJCF_FILE).decode(), files)


def ray_m(world: World, start_m: tuple[float, float, float], direction: tuple[float, float, float]) -> float:
    model = loaded(world)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return mujoco.mj_ray(model, data, np.array(start_m), np.array(direction), None, 1, -1, np.zeros(1, np.int32), None)


def test_every_solid_is_a_geom_of_its_name_and_size(world: World):
    model = loaded(world)
    for solid in solids(world):
        geom = model.geom(solid.name)
        x_m, y_m, z_m = solid.half_extents_m
        wanted = [x_m, z_m] if solid.shape == "cylinder" else [x_m, y_m, z_m]
        np.testing.assert_allclose(geom.size[: len(wanted)], wanted, atol=1e-6)
        np.testing.assert_allclose(geom.pos, solid.center_m, atol=1e-6)
        np.testing.assert_allclose(geom.rgba, [*solid.color, 1.0], atol=1e-6)


def test_only_the_ground_and_the_solids_can_be_touched(world: World):
    model = loaded(with_door(70.0, with_windows(world)))
    solid_names = {solid.name for solid in solids(world)} | {DOOR}
    touchable = {model.geom(number).name for number in range(model.ngeom) if model.geom_contype[number]}
    assert touchable == {GROUND, *solid_names}


def test_a_turned_table_is_hit_where_it_turned(world: World):
    # The table's centre is (5.2, -0.8), half as deep as 0.4 m, turned 0.4 rad: straight from +y the face is 0.4 / cos.
    distance_m = ray_m(world, (5.2, 1.0, 0.3), (0.0, -1.0, 0.0))
    assert distance_m == pytest.approx(1.8 - 0.4 / math.cos(0.4), abs=1e-5)


def test_a_ray_through_the_doorway_crosses_both_rooms(world: World):
    through_m = ray_m(world, (-1.0, 0.5, 0.3), (1.0, 0.0, 0.0))
    assert through_m == pytest.approx(7.6 - SKIN_LIFT_M, abs=1e-6)


def test_a_ray_downwards_meets_the_floor_of_the_room(world: World):
    assert ray_m(world, (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)) == pytest.approx(1.0 - FLOOR_LIFT_M, abs=1e-6)


def test_rooms_are_open_at_the_top_unless_a_ceiling_is_asked_for(world: World):
    assert world_spec(world).geom(CEILING) is None
    ceiling = world_spec(world, ceiling=True).geom(CEILING)
    assert ceiling.pos[2] - ceiling.size[2] == pytest.approx(world.ceiling_height_m)


def test_there_is_a_light_for_each_light_and_a_camera_above(world: World):
    model = loaded(world)
    assert model.nlight == len(world.lights)
    assert model.camera(OVERVIEW_CAMERA).pos[2] > world.ceiling_height_m


def test_the_document_loads_from_its_unpacked_folder(world: World, tmp_path: Path):
    files = mjcf_files(world)
    for name, body in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(body)
    # The sky is no file, the document is no texture.
    assert mujoco.MjModel.from_xml_path(str(tmp_path / MJCF_FILE)).ntex == len(files)


def test_a_zip_with_the_files_loads_as_a_spec(world: World):
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as bundle:
        for name, body in mjcf_files(world).items():
            bundle.writestr(f"worlds/g/w/{name}", body)
    sheets = 2 * len(world.rooms)  # a floor and the walls of each
    assert mujoco.MjSpec.from_zip(packed).compile().ngeom == len(solids(world)) + sheets + 1


def test_the_same_world_gives_the_same_files(world: World):
    first = mjcf_files(world)
    draw_texture.cache_clear()
    assert mjcf_files(apartment()) == first


def test_either_face_of_a_wall_shows_its_own_room(world: World):
    model = loaded(world)
    wall_m = (2.55, -1.0)
    for room, from_m, towards in zip(world.rooms, (0.0, 4.0), (1.0, -1.0), strict=True):
        name, material = hit(model, (from_m, wall_m[1], 1.5), (towards, 0.0, 0.0))
        assert name == WALLS_PREFIX + room.name
        assert room.walls.pattern in material


def test_the_sheet_of_a_wall_is_seen_from_its_room_alone(world: World):
    model = loaded(with_windows(world))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for room in world.rooms:
        middle_m = (room.floor.x_min_m + room.floor.x_max_m) / 2, (room.floor.y_min_m + room.floor.y_max_m) / 2, 1.3
        for corners_m in triangles_m(model, data, WALLS_PREFIX + room.name):
            outwards = np.cross(corners_m[1] - corners_m[0], corners_m[2] - corners_m[0])
            assert outwards @ (np.array(middle_m) - corners_m[0]) > 0.0


def triangles_m(model: mujoco.MjModel, data: mujoco.MjData, name: str) -> np.ndarray:
    """Returns the triangles of a mesh where they are, anticlockwise on the side that is drawn."""
    geom = data.geom(name)
    mesh = model.mesh(int(model.geom(name).dataid[0]))
    first_vertex, first_face = int(mesh.vertadr[0]), int(mesh.faceadr[0])
    vertices = model.mesh_vert[first_vertex : first_vertex + int(mesh.vertnum[0])]
    placed = vertices @ geom.xmat.reshape(3, 3).T + geom.xpos
    return placed[model.mesh_face[first_face : first_face + int(mesh.facenum[0])]]


def test_a_floor_shows_its_flooring_with_units_as_large_as_they_are(world: World):
    model = loaded(world)
    name, material = hit(model, (0.0, 0.0, 1.0), (0.0, 0.0, -1.0))
    assert name == FLOOR_PREFIX + "Living room"
    # The picture holds 2 planks along and 8 across, of 0.4 x 0.2 m; MuJoCo counts repetitions in two metres.
    np.testing.assert_allclose(model.mat(material).texrepeat, [2 / 0.8, 2 / 1.6], rtol=1e-6)


def test_rooms_with_one_flooring_share_its_texture(world: World):
    living, kitchen = world.rooms
    same = world.model_copy(update={"rooms": (living, kitchen.model_copy(update={"flooring": living.flooring}))})
    assert len(mjcf_files(same)) == len(mjcf_files(world)) - 1


def test_what_is_pushed_into_a_wall_touches_the_wall_alone(world: World):
    def contacts(spec: mujoco.MjSpec) -> int:
        body = spec.worldbody.add_body(name="robot", pos=[2.4, -1.0, 0.3])
        body.add_freejoint()
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.2, 0.2, 0.2])
        model = spec.compile()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        return data.ncon

    bare = world_spec(world)
    for room in world.rooms:
        bare.delete(bare.geom(WALLS_PREFIX + room.name))
        bare.delete(bare.geom(FLOOR_PREFIX + room.name))
    assert contacts(world_spec(with_windows(world))) == contacts(bare) > 0


def test_a_window_shows_on_either_face_and_leaves_its_wall_whole(world: World):
    model = loaded(with_windows(world))
    assert "pane" in hit(model, (0.0, 0.3, 1.5), (-1.0, 0.0, 0.0))[0]
    assert "pane" in hit(model, (-5.0, 0.3, 1.5), (1.0, 0.0, 0.0))[0]
    np.testing.assert_allclose(model.geom("wall-3").size, world.walls[2].half_extents_m, atol=1e-6)


def hit(
    model: mujoco.MjModel, start_m: tuple[float, float, float], direction: tuple[float, float, float]
) -> tuple[str, str]:
    """Returns the names of the geom that a ray meets first and of its material."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    found = np.zeros(1, np.int32)
    mujoco.mj_ray(model, data, np.array(start_m), np.array(direction), None, 1, -1, found, None)
    material = int(model.geom_matid[found[0]])
    return model.geom(int(found[0])).name, model.mat(material).name if material >= 0 else ""


printed = st.text(st.characters(codec="ascii", exclude_categories=("Cc",)), min_size=1, max_size=30)


@example([GROUND, f"{GROUND}_", "other"])
@given(st.lists(printed, min_size=3, max_size=3, unique=True))
def test_names_with_quotes_and_brackets_survive(names: list[str]):
    world = apartment()
    walls = tuple(wall.model_copy(update={"name": name}) for wall, name in zip(world.walls, names, strict=False))
    named = world.model_copy(update={"walls": walls})
    model = loaded(named)
    assert {model.geom(number).name for number in range(model.ngeom)} >= set(names)


@given(st.floats(-math.pi, math.pi))
def test_a_geom_is_turned_as_its_solid(yaw_rad: float):
    world = apartment()
    turned: Solid = world.walls[0].model_copy(update={"yaw_rad": yaw_rad})
    spec = world_spec(world.model_copy(update={"walls": (turned,)}))
    w, _, _, z = spec.geom(turned.name).quat
    assert 2 * math.atan2(z, w) == pytest.approx(yaw_rad)


HINGE = DOOR + HINGE_SUFFIX


def stepped(percent: float, opening_rad: float | None = None) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Returns the model of a door that stands at a percentage, and its state: as it stands, or opened as given."""
    model = world_spec(with_door(percent)).compile()
    data = mujoco.MjData(model)
    if opening_rad is not None:
        data.joint(HINGE).qpos[0] = opening_rad
    mujoco.mj_forward(model, data)
    return model, data


@pytest.mark.parametrize("percent", [0.0, 37.5, 100.0])
def test_the_hinge_begins_at_the_opening_and_the_leaf_stands_as_the_world_says(percent: float):
    model, data = stepped(percent)
    leaf = with_door(percent).doors[0].leaf
    assert data.joint(HINGE).qpos[0] == pytest.approx(math.pi / 2 * percent / 100.0)
    np.testing.assert_allclose(data.geom(DOOR).xpos, leaf.center_m, atol=1e-9)
    assert model.geom(DOOR).size == pytest.approx(leaf.half_extents_m)


@pytest.mark.parametrize("percent", [0.0, 37.5, 100.0])
@pytest.mark.parametrize(
    ("opening_rad", "center_m"),
    [
        (0.0, (HINGE_M[0] + LEAF_THICKNESS_M / 2, HINGE_M[1] + LEAF_LENGTH_M / 2)),
        (math.pi / 2, (HINGE_M[0] + LEAF_LENGTH_M / 2, HINGE_M[1] - LEAF_THICKNESS_M / 2)),
    ],
)
def test_the_hinge_at_its_ends_is_shut_and_fully_open(
    percent: float, opening_rad: float, center_m: tuple[float, float]
):
    _, data = stepped(percent, opening_rad)
    np.testing.assert_allclose(data.geom(DOOR).xpos[:2], center_m, atol=1e-9)


def test_the_hinge_goes_from_shut_to_a_quarter_turn():
    model, _ = stepped(50.0)
    assert model.jnt_limited[model.joint(HINGE).id]
    np.testing.assert_allclose(model.joint(HINGE).range, [0.0, math.pi / 2])


@pytest.mark.parametrize("opening_rad", np.linspace(0.0, math.pi / 2, 7))
def test_the_leaf_touches_nothing_at_any_opening(opening_rad: float):
    _, data = stepped(0.0, opening_rad)
    assert data.ncon == 0


def test_a_door_that_nobody_touches_stays_and_one_that_is_pushed_moves():
    model, data = stepped(50.0)
    mujoco.mj_step(model, data, 500)
    assert data.joint(HINGE).qpos[0] == pytest.approx(math.pi / 4, abs=1e-3)
    data.joint(HINGE).qfrc_applied[0] = 1.0  # a draught
    mujoco.mj_step(model, data, 500)
    assert data.joint(HINGE).qpos[0] == pytest.approx(math.pi / 4, abs=0.02)
    data.joint(HINGE).qfrc_applied[0] = 8.0  # 10 N at the handle
    mujoco.mj_step(model, data, 500)
    assert data.joint(HINGE).qpos[0] > math.pi / 4 + 0.2


def test_a_leaf_weighs_what_a_door_weighs():
    model, _ = stepped(0.0)
    assert 15.0 < model.body(DOOR).mass[0] < 30.0


def test_the_exported_document_keeps_the_hinge():
    files = mjcf_files(with_door(25.0))
    model = mujoco.MjModel.from_xml_string(files.pop("world.xml").decode(), files)
    assert model.qpos0[0] == pytest.approx(math.pi / 8, abs=1e-5)
