"""Gazebo's worlds as scenes: where things stand, what they are, and what is said of all that is not in them."""

import math
from pathlib import Path

import pytest
import trimesh

from tasks.worlds.importer.sdf_reader import read_sdf
from tasks.worlds.importer.source_scene import SourceError
from tests.worlds.importer.sources import (
    BOX,
    collision,
    dae,
    findings,
    model,
    only,
    scene,
    shared_model,
    solids,
    world,
    write_mesh,
)

TALL = "<box><size>0.5 0.5 2</size></box>"


def at(found: tuple[float, ...], *expected: float) -> bool:
    return found == pytest.approx(expected, abs=1e-6)


def test_each_model_is_one_piece_that_keeps_its_name_and_place(tmp_path: Path):
    found = scene(tmp_path, model("shelf", f"<pose>3 1 0.5 0 0 0.5</pose>{collision(BOX)}"))
    (piece,) = found.pieces
    assert (piece.name, piece.room, piece.center_m, piece.yaw_rad) == ("shelf", "", (3.0, 1.0), 0.5)
    assert at(piece.solids[0].center_m, 3, 1, 0.5)
    assert (found.parts, found.exact, found.findings) == (1, 1, ())


def test_poses_of_models_links_and_collisions_add_up(tmp_path: Path):
    link = collision(BOX, "<pose>0.5 0 1 0 0 0</pose>").replace(
        "<link name='link'>", "<link name='l'><pose>0 2 0 0 0 0</pose>"
    )
    found = scene(tmp_path, model("m", f"<pose>1 0 0 0 0 {math.pi / 2}</pose>{link}"))
    assert at(only(found).center_m, -1, 0.5, 1)


def test_names_that_come_twice_are_numbered(tmp_path: Path):
    found = scene(tmp_path, model("box") + model("box", f"<pose>5 0 0.5 0 0 0</pose>{collision(BOX)}"))
    assert [piece.name for piece in found.pieces] == ["box", "box_2"]
    assert len({solid.name for solid in solids(found)}) == 2


@pytest.mark.parametrize("address", ["model://chair", "file://models/chair", "package://shop/models/chair", "chair"])
def test_an_include_finds_its_model(tmp_path: Path, address: str):
    shared_model(tmp_path / "models", "chair", model("chair_model"))
    source = world(
        tmp_path / ("models" if address == "chair" else "worlds"), f"<include><uri>{address}</uri></include>"
    )
    (piece,) = read_sdf(source).pieces
    assert (piece.name, piece.model_type) == ("chair_model", "chair")


def test_an_include_overrides_name_and_pose(tmp_path: Path):
    shared_model(tmp_path / "m", "chair", model("chair", f"<pose>9 9 9 0 0 0</pose>{collision(BOX)}"))
    include = "<include><uri>model://chair</uri><name>mine</name><pose>1 2 0.5 0 0 0</pose></include>"
    found = scene(tmp_path / "w", include, folders=[tmp_path / "m"])
    assert found.pieces[0].name == "mine"
    assert at(only(found).center_m, 1, 2, 0.5)


def test_an_include_in_a_model_is_part_of_that_piece(tmp_path: Path):
    shared_model(tmp_path / "models", "chair", model("chair"))
    outer = (
        "<model name='Chair_01'><include><uri>model://chair</uri></include><pose frame=''>2 0 0.5 0 0 0</pose></model>"
    )
    (piece,) = scene(tmp_path, outer, version="1.6").pieces
    assert (piece.name, piece.model_type) == ("Chair_01", "chair")
    assert at(piece.solids[0].center_m, 2, 0, 0.5)


def test_the_newest_sdf_of_a_model_is_taken(tmp_path: Path):
    home = shared_model(tmp_path / "models", "chair", model("old"))
    (home / "model.config").write_text(
        "<model><sdf version='1.10'>new.sdf</sdf><sdf version='1.9'>model.sdf</sdf>"
        "<sdf version='2.0'>no.sdf</sdf></model>"
    )
    (home / "new.sdf").write_text(f"<sdf version='1.10'>{model('new')}</sdf>")
    found = scene(tmp_path, "<include><uri>model://chair</uri></include>")
    assert [piece.name for piece in found.pieces] == ["new"]
    assert sorted(found.files) == ["chair/model.config", "chair/new.sdf", "w.world"]


def test_frames_are_followed(tmp_path: Path):
    inside = (
        "<frame name='shelf_place'><pose>5 0 0 0 0 0</pose></frame>"
        "<frame name='beside' attached_to='shelf_place'><pose>0 1 0 0 0 0</pose></frame>"
        + model("a", f"<pose relative_to='beside'>0 0 0.5 0 0 0</pose>{collision(BOX)}")
        + model("b", f"<pose relative_to='a::link'>1 0 1 0 0 0</pose>{collision(BOX, '')}")
    )
    first, second = solids(scene(tmp_path, inside))
    assert at(first.center_m, 5, 1, 0.5)
    assert at(second.center_m, 6, 1, 1.5)


def test_a_placement_frame_stands_where_the_pose_says(tmp_path: Path):
    inside = f"<pose>4 0 0 0 0 0</pose><frame name='foot'><pose>0 0 -0.5 0 0 0</pose></frame>{collision(BOX)}"
    assert at(only(scene(tmp_path, model("m", inside, "placement_frame='foot'"))).center_m, 4, 0, 0.5)


@pytest.mark.parametrize(
    "pose",
    [
        "<pose degrees='true'>0 0 0.5 0 0 90</pose>",
        "<pose rotation_format='quat_xyzw'>0 0 0.5 0 0 0.70710678 0.70710678</pose>",
    ],
)
def test_turns_are_read_in_every_form(tmp_path: Path, pose: str):
    assert abs(only(scene(tmp_path, model("m", pose + collision(BOX)))).yaw_rad) == pytest.approx(math.pi / 2)


@pytest.mark.parametrize(
    ("geometry", "shape", "half"),
    [
        (BOX, "box", (0.5, 1, 0.5)),
        ("<cylinder><radius>0.3</radius><length>1</length></cylinder>", "cylinder", (0.3, 0.3, 0.5)),
        (
            "<polyline><point>0 0</point><point>2 0</point><point>1 1</point><height>1</height></polyline>",
            "prism",
            (1, 0.5, 0.5),
        ),
    ],
)
def test_upright_shapes_are_exact(tmp_path: Path, geometry: str, shape: str, half: tuple[float, ...]):
    found = scene(tmp_path, model("m", f"<pose>0 0 0.5 0 0 0</pose>{collision(geometry)}"))
    assert (only(found).shape, found.exact) == (shape, 1)
    assert at(only(found).half_extents_m[:2], *half[:2])


@pytest.mark.parametrize(
    "geometry",
    [
        "<capsule><radius>0.3</radius><length>1</length></capsule>",
        "<ellipsoid><radii>0.3 0.3 0.5</radii></ellipsoid>",
        "<cone><radius>0.3</radius><length>0.9</length></cone>",
    ],
)
def test_round_shapes_are_stacks_that_say_how_far_off_they_are(tmp_path: Path, geometry: str):
    found = scene(tmp_path, model("ball", f"<pose>0 0 0.8 0 0 0</pose>{collision(geometry)}"))
    (finding,) = found.findings
    assert (finding.subject, finding.became, found.exact) == ("ball/link/c", "approximated", 0)
    assert 0.001 < (finding.off_m or 0) <= 0.1
    assert max(solid.half_extents_m[0] for solid in solids(found)) == pytest.approx(0.3, abs=0.1)


@pytest.mark.parametrize(
    ("z_m", "half", "off_m"),
    [
        (0.8, (0.5, 0.5, 0.5), 0.2071),
        (-0.3, (0.4, 0.4, 0.1), 0.1403),
        (2.5, (0.4, 0.4, 0.5), 0.1403),
        (9.0, (0.5,) * 3, 0.2071),
    ],
    ids=["on the floor", "in the floor", "at a head", "above all heads"],
)
def test_a_ball_is_one_cylinder_as_wide_as_what_a_robot_meets(
    tmp_path: Path, z_m: float, half: tuple[float, ...], off_m: float
):
    ball = f"<pose>0 0 {z_m} 0.4 0 0</pose>{collision('<sphere><radius>0.5</radius></sphere>')}"
    found = scene(tmp_path, model("ball", ball) + model("post", collision("<box><size>1 1 1</size></box>")))
    (finding,), (solid, _) = found.findings, solids(found)
    assert (finding.why, finding.off_m) == ("a sphere as the cylinder around it", pytest.approx(off_m, abs=1e-4))
    assert solid.shape == "cylinder"
    assert at(solid.half_extents_m, *half)


def test_meshes_are_scaled_and_in_the_unit_of_their_file(tmp_path: Path):
    dae(tmp_path / "models" / "t" / "t.dae", unit_m=0.01, up="Y_UP")
    mesh = "<mesh><uri>model://t/t.dae</uri><scale>100 50 100</scale></mesh>"
    found = scene(tmp_path, model("t", f"<pose>0 0 1.5 0 0 0</pose>{collision(mesh)}"))
    assert at(only(found).half_extents_m, 0.5, 0.5, 1.5)  # 1 x 2 x 3 cm, whatever axis the file calls up


def test_a_submesh_is_taken_alone_and_centred(tmp_path: Path):
    nodes = [("top", "<translate>5 0 0</translate>"), ("leg", "<scale>0.5 0.5 0.5</scale>")]
    dae(tmp_path / "t.dae", nodes=nodes)
    mesh = "<mesh><uri>t.dae</uri><submesh><name>top</name><center>true</center></submesh></mesh>"
    assert at(only(scene(tmp_path, model("t", f"<pose>0 0 1.5 0 0 0</pose>{collision(mesh)}"))).center_m, 0, 0, 1.5)


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply"])
def test_meshes_of_other_kinds_are_read(tmp_path: Path, suffix: str):
    write_mesh(tmp_path / f"t.{suffix}", trimesh.creation.box((1, 2, 3)))
    mesh = f"<mesh><uri>t.{suffix}</uri></mesh>"
    assert at(
        only(scene(tmp_path, model("t", f"<pose>0 0 1.5 0 0 0</pose>{collision(mesh)}"))).half_extents_m, 0.5, 1, 1.5
    )


def test_a_plane_is_the_floor_and_what_is_on_it_comes_down_with_it(tmp_path: Path):
    ground = model("ground", f"<pose>0 0 0.15 0 0 0</pose>{collision('<plane><normal>0 0 1</normal></plane>')}")
    found = scene(tmp_path, ground + model("post", f"<pose>0 0 1.15 0 0 0</pose>{collision(TALL)}"))
    assert found.floor_m == pytest.approx(0.15)
    assert only(found).center_m[2] == pytest.approx(1.0)
    assert findings(found, "approximated") == ["floor: lies 0.15 m high in the source; everything is lower by that"]


def test_a_floor_mesh_lies_on_the_ground_and_is_no_obstacle(tmp_path: Path):
    slab = model("slab", f"<pose>0 0 0 0 0 0</pose>{collision('<box><size>10 10 0.2</size></box>')}")
    carpet = model("carpet", f"<pose>2 2 0.11 0 0 0</pose>{collision('<box><size>2 2 0.02</size></box>')}")
    found = scene(tmp_path, slab + carpet + model("post", f"<pose>0 0 1.1 0 0 0</pose>{collision(TALL)}"))
    assert (found.floor_m, [piece.name for piece in found.pieces]) == (0.1, ["post"])


def test_a_start_says_which_of_several_floors_is_meant(tmp_path: Path):
    ground = model("ground", collision("<plane><normal>0 0 1</normal></plane>"))
    track = model("track", f"<pose>0 0 0.05 0 0 0</pose>{collision('<box><size>3 1 0.1</size></box>')}")
    far = model("post", f"<pose>9 9 1 0 0 0</pose>{collision(TALL)}")
    source = world(tmp_path, ground + track + far)
    assert [piece.name for piece in read_sdf(source).pieces] == ["track", "post"]
    assert [piece.name for piece in read_sdf(source, start=(0.5, 0.0)).pieces] == ["post"]


def test_what_is_not_there_is_named_all_at_once_with_where_it_was_looked_for(tmp_path: Path):
    fuel = "https://fuel.gazebosim.org/1.0/OpenRobotics/models/Chair"
    missing = f"<include><uri>{fuel}</uri></include><include><uri>model://desk</uri><name>d</name></include>"
    mesh = collision("<mesh><uri>model://desk/desk.dae</uri></mesh>")
    found = scene(tmp_path, missing + model("there") + model("half", mesh))
    said = findings(found, "unresolved")
    assert [line.split(": ")[0] for line in said] == [fuel, "model://desk", "model://desk/desk.dae"]
    assert said[1] == f"model://desk: used by d; looked for it in {tmp_path}"


def test_a_model_of_fuel_is_found_by_its_name_in_a_folder_of_models(tmp_path: Path):
    shared_model(tmp_path / "models", "chair", model("chair"))
    found = scene(tmp_path, "<include><uri>https://fuel.gazebosim.org/1.0/OpenRobotics/models/Chair/3</uri></include>")
    assert [piece.name for piece in found.pieces] == ["chair"]


def test_nothing_found_at_all_is_an_error_that_says_why(tmp_path: Path):
    with pytest.raises(SourceError, match="model://desk: used by d; looked for it in"):
        scene(tmp_path, "<include><uri>model://desk</uri><name>d</name></include>")


def test_models_that_would_move_stand_still_and_are_named(tmp_path: Path):
    falls = f"<model name='ball'>{collision(BOX)}</model>"
    found = scene(tmp_path, model("shelf") + falls)
    assert findings(found, "approximated") == [
        "1 models: not static in the source: what would fall or be pushed there stands still here (ball)"
    ]


def test_what_nothing_meets_is_dropped_and_said(tmp_path: Path):
    visual = f"<link name='glow'><visual name='v'><geometry>{BOX}</geometry></visual></link>"
    plugins = "<plugin filename='libx.so' name='x'/><plugin filename='libx.so' name='y'/>"
    more = f"<actor name='walker'/>{plugins}<road name='r'/>"
    said = findings(scene(tmp_path, model("box") + model("sign", visual) + more), "dropped")
    assert said == [
        "actor walker: has no trajectory of 1 to 10,000 waypoints that it starts by itself",
        "road r: a road is paint on the floor",
        "sign/glow: has no collision: it is seen, and nothing meets it",
        "plugin libx.so: code of a simulator, which is not run here; 2 times",
    ]


def waypoint(time_s: float, x_m: float, y_m: float) -> str:
    return f"<waypoint><time>{time_s}</time><pose>{x_m} {y_m} 1 0 0 0</pose></waypoint>"


def test_an_actor_becomes_a_walk_through_its_trajectories(tmp_path: Path):
    first = f"<trajectory id='0' type='walk'>{waypoint(4, 2, 1)}{waypoint(0, 1, 1)}</trajectory>"
    second = f"<trajectory id='1' type='walk'>{waypoint(1.5, 2, 3)}</trajectory>"
    script = f"<script><loop>{{}}</loop><delay_start>2</delay_start>{first}{second}</script>"
    actors = "".join(
        f"<actor name='walker'><pose>9 9 9 0 0 0</pose>{script.format(loop)}</actor>" for loop in ("true", "0")
    )
    found = scene(tmp_path, model("box") + actors)
    assert [(walk.name, walk.period_s) for walk in found.walks] == [("walker", 7.5), ("walker_2", None)]
    assert {walk.times_s for walk in found.walks} == {(2.0, 6.0, 7.5)}
    assert {walk.points_m for walk in found.walks} == {((1.0, 1.0), (2.0, 1.0), (2.0, 3.0))}
    assert [each.partition(":")[0] for each in findings(found, "approximated")] == ["actor walker", "actor walker_2"]


def test_colours_are_those_of_the_visuals_or_of_the_mesh(tmp_path: Path):
    paint = "<visual name='v'><geometry/><material><diffuse>1 0.5 0 1</diffuse></material></visual></link>"
    found = scene(tmp_path, model("m", collision(BOX).replace("</link>", paint)))
    assert only(found).color == (1.0, 0.5, 0.0)


def test_lights_are_where_they_hang_and_a_sun_is_nowhere(tmp_path: Path):
    lights = "<light name='sun' type='directional'/><light name='lamp' type='point'><pose>1 2 3 0 0 0</pose></light>"
    assert [light.position_m for light in scene(tmp_path, model("m") + lights).lights] == [(1.0, 2.0, 3.0)]


GAZEBOS_OWN = "<include><uri>model://sun</uri></include><include><uri>model://ground_plane</uri></include>"


def test_a_world_of_gazebos_own_plane_alone_is_a_yard_with_a_wall(tmp_path: Path):
    found = scene(tmp_path, GAZEBOS_OWN)
    spread = {round(abs(x), 6) for piece in found.pieces for each in piece.solids for x in each.center_m[:2]}
    assert (len(solids(found)), spread, findings(found, "approximated")) == (
        4,
        {0.0, 10.0},
        ["floor: a plane without end, and nothing on it: a yard of 20 x 20 m with a wall around"],
    )


def test_gazebos_own_models_are_known_beside_others_and_those_of_a_folder_go_first(tmp_path: Path):
    assert scene(tmp_path, model("m") + GAZEBOS_OWN).findings == ()
    shared_model(tmp_path / "models", "sun", model("lamp"))
    assert [piece.name for piece in scene(tmp_path, GAZEBOS_OWN).pieces] == ["lamp"]


def test_a_model_alone_is_a_world_too(tmp_path: Path):
    home = shared_model(tmp_path, "chair", model("chair"))
    assert [piece.name for piece in read_sdf(home / "model.sdf").pieces] == ["chair"]


def test_the_same_world_gives_the_same_scene(tmp_path: Path):
    shared_model(tmp_path / "models", "chair", model("chair"))
    inside = "<include><uri>model://chair</uri></include>" + model("box")
    assert scene(tmp_path, inside) == scene(tmp_path, inside)
