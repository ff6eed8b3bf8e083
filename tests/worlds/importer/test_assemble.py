"""A scene as a world: measured, in its frame, the same bytes for the same source, and a start that leads somewhere."""

import dataclasses
from pathlib import Path

import pytest

from specs.data.world import FloorZone, Start, World
from tasks.export.format.occupancy_map import map_files
from tasks.storage.worlds import decode_world, encode_world
from tasks.worlds.importer.assemble import ImportedAs, assemble_world
from tasks.worlds.importer.map_reader import read_map
from tasks.worlds.importer.own_floor import measured
from tasks.worlds.importer.source_scene import Scene, SourceError
from tests.factories.own_worlds import block, piece
from tests.factories.ros_maps import write_map


def room(width: int, depth: int, *, door: int = 0) -> tuple[str, ...]:
    """Returns a map of two equal rooms side by side, with a door of so many cells in the wall between them."""
    shut, opened = f"#{'.' * width}#{'.' * width}#", f"#{'.' * (2 * width + 1)}#"
    inner = [opened if row < door else shut for row in range(depth)]
    return ("#" * (2 * width + 3), *inner, "#" * (2 * width + 3))


def imported(path: Path, **more: object) -> World:
    described = ImportedAs(name="hall", kind="map", file=path.name, **more)  # type: ignore[arg-type]
    return assemble_world(read_map(path), described)


def test_a_map_becomes_a_world_a_map_and_the_same_world(tmp_path: Path) -> None:
    first = imported(write_map(tmp_path, room(24, 30, door=16)))
    (tmp_path / "again").mkdir()
    for name, body in map_files(first).items():
        (tmp_path / "again" / name).write_bytes(body)
    again = imported(tmp_path / "again" / "map.yaml")
    assert (again.map, again.walls, again.certificate) == (first.map, first.walls, first.certificate)
    assert map_files(again) == map_files(first)


def test_the_map_of_a_world_is_the_map_that_it_was_made_of(tmp_path: Path) -> None:
    world = imported(write_map(tmp_path, room(24, 30, door=16)))
    assert (world.map.columns, world.map.rows) == (51, 32)
    assert world.map.origin_m == pytest.approx((1.0, 2.0), abs=1e-5)
    assert sum(world.map.runs[1::2]) == sum(row.count("#") for row in room(24, 30, door=16))


def test_a_map_has_the_rooms_that_its_doors_part(tmp_path: Path) -> None:
    world = imported(write_map(tmp_path, room(48, 60, door=16)))
    zones = world.zones or ()
    assert [zone.name for zone in zones] == ["room-1", "room-2"]
    assert [zone.area_m2 for zone in zones] == pytest.approx([7.2, 7.2], rel=0.03)
    assert imported(write_map(tmp_path, room(48, 60, door=60))).zones is None


def zoned(path: Path, *corners: tuple[float, float]) -> World:
    zones = [FloorZone(name="own", outline_m=((1.2, 2.2), (2.0, 2.2), (2.0, 3.0)), found=False)] * (len(corners) != 4)
    if corners:
        zones.append(FloorZone(name="other", outline_m=corners, found=False))
    scene = dataclasses.replace(read_map(path), zones=tuple(zones))
    return assemble_world(scene, ImportedAs(name="hall", kind="map", file=path.name))


def test_zones_that_somebody_named_take_the_place_of_rooms(tmp_path: Path) -> None:
    path = write_map(tmp_path, room(48, 60, door=16))
    assert [zone.name for zone in zoned(path).zones or ()] == ["own"]
    world = zoned(path, (90.0, 90.0), (91.0, 90.0), (90.0, 91.0))
    assert [zone.name for zone in world.zones or ()] == ["own"]
    assert world.report is not None
    assert [each.subject for each in world.report.findings if each.became == "dropped"] == ["zone other"]
    with pytest.raises(SourceError, match=r"zone other: \[90, 90\] and all others: a part of the floor that a robot"):
        zoned(path, (90.0, 90.0), (91.0, 90.0), (91.0, 91.0), (90.0, 91.0))


def test_the_same_source_is_the_same_world_to_the_byte(tmp_path: Path) -> None:
    path = write_map(tmp_path, room(24, 30))
    body = encode_world(imported(path))
    assert body == encode_world(imported(path))
    assert encode_world(decode_world(body)) == body


def test_another_setting_or_another_pixel_is_another_generation(tmp_path: Path) -> None:
    path = write_map(tmp_path, room(24, 30))
    generations = {imported(path).generation, imported(path, settings={"wallHeight": "3"}).generation}
    generations.add(imported(write_map(tmp_path, room(24, 31))).generation)
    assert len(generations) == 3


def test_a_world_says_what_it_is_and_is_measured(tmp_path: Path) -> None:
    world = imported(write_map(tmp_path, room(24, 30, door=16)))
    assert world.source is not None
    assert (world.source.kind, world.source.file, world.rooms) == ("map", "map.yaml", ())
    assert (world.certificate.guaranteed_robot_radius_m, world.certificate.wishes) == (0.0, ())
    assert 0.3 < world.certificate.reachable_robot_radius_m < 0.45, "a door of 0.8 m"
    assert measured(world) == world


def test_the_start_that_is_found_reaches_the_most_floor(tmp_path: Path) -> None:
    rows = tuple(f"{row[:26]}{row[26:40]}#" for row in room(24, 30))  # the right room is narrower
    world = imported(write_map(tmp_path, rows))
    assert world.start is not None
    assert 1.0 < world.start.x_m < 1.0 + 25 * 0.05, "in the left room"


def test_the_origin_is_the_start_where_it_is_as_good(tmp_path: Path) -> None:
    world = imported(write_map(tmp_path, room(24, 30), origin=[-1.0, -0.5, 0]))
    assert world.start == Start(x_m=0.0, y_m=0.0)


def test_a_start_that_is_shut_in_is_said(tmp_path: Path) -> None:
    rows = tuple(f"{row[:26]}{row[26:40]}#" for row in room(24, 30))
    world = imported(write_map(tmp_path, rows), start=Start(x_m=2.6, y_m=2.8))
    assert world.report is not None
    assert [finding.subject for finding in world.report.findings] == []
    narrow = tuple(f"{row[:26]}{row[26:35]}#" for row in room(24, 30))
    shut = imported(write_map(tmp_path, narrow), start=Start(x_m=2.5, y_m=2.8))
    assert shut.report is not None
    (finding,) = shut.report.findings
    assert finding.subject == "floor"
    assert "hang together elsewhere" in finding.why


@pytest.mark.parametrize(
    ("start", "said"),
    [
        (Start(x_m=1.01, y_m=2.5), "0.00 m from the nearest solid: a place with 0.05 m around it, such as ["),
        (Start(x_m=50.0, y_m=2.5), "start: [50, 2.5]: a place within x 1.0 to 3.5 and y 2.0 to 3.6"),
    ],
)
def test_a_start_where_no_robot_can_stand_is_refused(tmp_path: Path, start: Start, said: str) -> None:
    with pytest.raises(SourceError) as caught:
        imported(write_map(tmp_path, room(24, 30)), start=start)
    assert said in str(caught.value)


def scene(*names: str, apart_m: float = 3.0) -> Scene:
    """Returns a scene of crates in a row, named so."""
    crates = [block(name, (apart_m * place, 0.0), (1.0, 1.0)) for place, name in enumerate(names)]
    return Scene(tuple(piece(crate.name, crate) for crate in crates), parts=len(names), exact=len(names))


def test_pieces_called_walls_are_walls_and_the_others_furniture() -> None:
    world = assemble_world(scene("crate", "Wall_3"), ImportedAs("yard", "sdf", "yard.world"))
    assert [solid.name for solid in world.walls] == ["Wall_3"]
    assert [each.name for each in world.furniture] == ["crate"]


def test_a_start_beside_all_that_stands_widens_the_floor() -> None:
    described = ImportedAs("yard", "sdf", "yard.world", start=Start(x_m=-4.0, y_m=0.0))
    world = assemble_world(scene("crate", "other"), described)
    assert world.footprint.x_min_m == pytest.approx(-5.0)
    assert world.start == Start(x_m=-4.0, y_m=0.0)


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (scene(), "solids: 0: a world in which something stands"),
        (scene("crate", "other", apart_m=50_000.0), "size: 50001 x 1 m: a floor of at most 41,943 m2"),
        (scene("crate"), "floor: none that is free: floor for a robot of 0.05 m radius"),
    ],
)
def test_a_scene_that_is_no_world_is_refused(made: Scene, said: str) -> None:
    with pytest.raises(SourceError) as caught:
        assemble_world(made, ImportedAs("yard", "sdf", "yard.world"))
    assert said in str(caught.value)
