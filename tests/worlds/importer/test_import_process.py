"""The process that reads sources: each kind by its own reader, in its own unit, and its settings in the world."""

from pathlib import Path

import pytest

from specs.data.world import Route, World
from specs.pipeline.world_sections import WorldImport
from tasks.storage.worlds import decode_world
from tasks.worlds.importer.import_process import import_source
from tests.factories.ros_maps import write_map

SDF = """<sdf version="1.7"><world name="yard"><model name="crate"><static>true</static><pose>4 0 0.5 0 0 0</pose>
<link name="link"><collision name="c"><geometry><box><size>1 1 1</size></box></geometry></collision></link>
</model></world></sdf>"""
CUBE = "".join(f"v {x} {y} {z}\n" for x in (0, 100) for y in (0, 100) for z in (0, 100)) + "".join(
    f"f {face}\n" for face in ("1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4")
)


def imported(path: Path, **more: object) -> World:
    answer = import_source(WorldImport.model_validate({"name": "yard", "source": str(path), "start": [2, 0], **more}))
    assert answer.faults == ()
    return decode_world(answer.world.encode())


def test_a_gazebo_world_is_imported(tmp_path: Path) -> None:
    (tmp_path / "yard.world").write_text(SDF)
    world = imported(tmp_path / "yard.world")
    (crate,) = (solid for piece in world.furniture for solid in piece.solids)
    assert world.source is not None
    assert (world.source.kind, crate.center_m[:2]) == ("sdf", (4.0, 0.0))


def test_a_scene_of_mujoco_is_imported(tmp_path: Path) -> None:
    (tmp_path / "lab.xml").write_text(
        "<mujoco><worldbody><geom name='crate' type='box' size='0.5 0.5 0.5' pos='4 0 0.5'/></worldbody></mujoco>"
    )
    world = imported(tmp_path / "lab.xml")
    (crate,) = (solid for piece in world.furniture for solid in piece.solids)
    assert world.source is not None
    assert (world.source.kind, crate.center_m[:2]) == ("mjcf", (4.0, 0.0))


def test_a_world_is_compared_with_the_maps_beside_its_source(tmp_path: Path) -> None:
    (tmp_path / "yard.world").write_text(SDF)
    alone = imported(tmp_path / "yard.world")
    (tmp_path / "document.yaml").write_text("name: no map\n")
    assert imported(tmp_path / "yard.world") == alone
    rows = ("." * 60, *("." * 20 + "#" * 20 + "." * 20,) * 20, "." * 60)
    write_map(tmp_path, rows, origin=[2.5, -0.55, 0.0])
    compared = imported(tmp_path / "yard.world")
    assert compared.report is not None
    (found,) = compared.report.agreements
    assert (found.map, found.within_5cm) == ("map.yaml", 1.0)
    assert found.free_iou > 0.95
    assert compared.generation != alone.generation, "another map is another report"


def test_the_maps_of_a_package_are_found_beside_its_worlds(tmp_path: Path) -> None:
    source, maps, out = tmp_path / "worlds" / "yard.world", tmp_path / "maps" / "waffle", tmp_path / "elsewhere"
    for folder in (source.parent, maps, out):
        folder.mkdir(parents=True)
    source.write_text(SDF)
    rows = ("." * 60, *("." * 20 + "#" * 20 + "." * 20,) * 20, "." * 60)
    write_map(maps, rows, origin=[2.5, -0.55, 0.0])
    write_map(out, rows, origin=[2.5, -0.55, 0.0])
    (tmp_path / "maps" / "link").symlink_to(out)
    report = imported(source).report
    assert report is not None
    assert [(each.map, each.within_5cm) for each in report.agreements] == [("maps/waffle/map.yaml", 1.0)]


def test_a_source_among_the_maps_is_compared_with_each_once(tmp_path: Path) -> None:
    maps = tmp_path / "maps"
    maps.mkdir()
    (maps / "yard.world").write_text(SDF)
    write_map(maps, ("." * 60, *("." * 20 + "#" * 20 + "." * 20,) * 20, "." * 60), origin=[2.5, -0.55, 0.0])
    report = imported(maps / "yard.world").report
    assert report is not None
    assert [each.map for each in report.agreements] == ["map.yaml"]


def test_routes_come_with_a_world_if_a_robot_can_stand_at_their_places(tmp_path: Path) -> None:
    (tmp_path / "yard.world").write_text(SDF)
    (tmp_path / "tour.yaml").write_text("[[2, 0], [3.2, 0]]")
    alone = imported(tmp_path / "yard.world")
    toured = imported(tmp_path / "yard.world", routes=[str(tmp_path / "tour.yaml")])
    assert toured.routes == (Route(name="tour", points_m=((2.0, 0.0), (3.2, 0.0))),)
    assert toured.generation != alone.generation, "other routes are another world"


def test_a_place_without_room_is_left_out_of_a_route_and_a_route_of_such_places_is_refused(tmp_path: Path) -> None:
    (tmp_path / "yard.world").write_text(SDF)
    (tmp_path / "tour.yaml").write_text("[[2, 0], [4, 0], [90, 0]]")
    world = imported(tmp_path / "yard.world", routes=[str(tmp_path / "tour.yaml")])
    assert (world.routes, world.report is not None) == ((Route(name="tour", points_m=((2.0, 0.0),)),), True)
    dropped = [(each.subject, each.why) for each in world.report.findings] if world.report else []
    assert dropped == [
        ("route tour, place 2", "[4, 0] is 0.00 m from a solid"),
        ("route tour, place 3", "[90, 0] is not on the floor"),
    ]
    (tmp_path / "tour.yaml").write_text("[[90, 0]]")
    asked = {"name": "yard", "source": str(tmp_path / "yard.world"), "start": [2, 0]}
    answer = import_source(WorldImport.model_validate({**asked, "routes": [str(tmp_path / "tour.yaml")]}))
    assert [fault.path for fault in answer.faults] == ["route tour"]


def test_zones_beside_a_source_are_read_once(tmp_path: Path) -> None:
    (tmp_path / "yard.world").write_text(SDF)
    (tmp_path / "zones.yaml").write_text("zones: {dock: [[2, 0], [3, 0], [3, 0.3]]}")
    for more in ({}, {"routes": [str(tmp_path / "zones.yaml")]}):
        zones = imported(tmp_path / "yard.world", **more).zones or ()
        assert [zone.name for zone in zones] == ["dock"]


def test_a_link_to_zones_elsewhere_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "own").mkdir()
    (tmp_path / "own/yard.world").write_text(SDF)
    (tmp_path / "secret").write_text("password")
    (tmp_path / "own/zones.yaml").symlink_to(tmp_path / "secret")
    assert imported(tmp_path / "own/yard.world").zones is None


def test_a_map_may_be_called_zones(tmp_path: Path) -> None:
    rows = ("#" * 60, *("#" + "." * 58 + "#",) * 18, "#" * 60)
    write_map(tmp_path, rows).rename(tmp_path / "zones.yaml")
    assert imported(tmp_path / "zones.yaml", start=[2.0, 2.5]).zones is None


def test_a_mesh_is_imported_in_its_unit(tmp_path: Path) -> None:
    (tmp_path / "cube.obj").write_text(CUBE)
    world = imported(tmp_path / "cube.obj", unit="cm")
    (cube,) = (solid for piece in world.furniture for solid in piece.solids)
    assert world.source is not None
    assert world.source.settings == ("start=[2, 0, 0]", "unit=cm")
    assert cube.half_extents_m[:2] == pytest.approx((0.5, 0.5), abs=1e-3)
