"""Files of routes: every way that robots write places, and a message for each that is none."""

from pathlib import Path

import pytest

from tasks.worlds.importer.route_reader import read_routes
from tasks.worlds.importer.source_scene import SourceError

AWS = """mode: inorder
poses:
    - pose: {position: {x: 5.18, y: 1.5, z: 0.0}, orientation: {x: 0.0, y: 0.0, z: 0.6, w: 0.8}}
    - pose: {position: {x: 8.25, y: -2, z: 0.0}, orientation: {x: 0.0, y: 0.0, z: 0.6, w: 0.8}}
"""
NAV2 = """waypoints:
  waypoint0: {pose: [5.18, 1.5, 0.0], orientation: [1.0, 0, 0, 0]}
  waypoint1: {pose: [8.25, -2.0, 0.0], orientation: [1.0, 0, 0, 0]}
"""
STAMPED = """poses:
- {header: {frame_id: map}, pose: {position: {x: 5.18, y: 1.5, z: 0}}}
- {header: {frame_id: map}, pose: {pose: {position: {x: 8.25, y: -2}}}}
"""
FORMS = [AWS, NAV2, STAMPED, "goals: [[5.18, 1.5, 0.3], {x: 8.25, y: -2, yaw: 1}]", "- [5.18, 1.5]\n- [8.25, -2]\n"]


def written(folder: Path, text: str, name: str = "tour.yaml") -> Path:
    (folder / name).write_text(text)
    return folder / name


@pytest.mark.parametrize("text", FORMS)
def test_a_list_of_poses_is_a_route_named_as_its_file(tmp_path: Path, text: str) -> None:
    (route,) = read_routes([written(tmp_path, text)]).routes
    assert (route.name, route.points_m) == ("tour", ((5.18, 1.5), (8.25, -2.0)))


def test_named_routes_and_places_keep_their_names(tmp_path: Path) -> None:
    text = "routes: {round: [[1, 2], [3, 4]]}\nplaces: {dock: [0.5, 1, 0]}\n"
    found = read_routes([written(tmp_path, text), written(tmp_path, "[[0, 0]]", "home.yaml")]).routes
    assert [(each.name, each.points_m) for each in found] == [
        ("round", ((1.0, 2.0), (3.0, 4.0))),
        ("dock", ((0.5, 1.0),)),
        ("home", ((0.0, 0.0),)),
    ]


def test_what_only_looks_like_an_alias_is_text(tmp_path: Path) -> None:
    text = "# 2 * 3 & more\nplaces: {'Lounge & Bar': [1, 2], \"*dock\": [3, 4]}  # *here\n"
    found = read_routes([written(tmp_path, text)]).routes
    assert [each.name for each in found] == ["Lounge & Bar", "*dock"]


def test_zones_have_names_and_corners(tmp_path: Path) -> None:
    text = "zones: {hall: [[0, 0], {x: 4, y: 0}, [4, 3]]}\nplaces: {hall: [1, 0.5]}\n"
    found = read_routes([written(tmp_path, text)])
    (zone,) = found.zones
    assert (zone.name, zone.outline_m, zone.found) == ("hall", ((0.0, 0.0), (4.0, 0.0), (4.0, 3.0)), False)
    assert [route.name for route in found.routes] == ["hall"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("zones: {hall: [[0, 0], [4, 0]]}\n", "zones.hall"),
        ("zones: {hall: [[0, 0], [4, 4], [4, 0], [0, 4]]}\n", "an outline that does not cross itself"),
        ("zones: {hall: [[0, 0], [1, 1], [2, 2]]}\n", "an outline that does not cross itself"),
        ("mode: random\n", "nothing of a route"),
        ("poses: []\n", "1 to 10,000 poses"),
        ("poses: [[1]]\n", "poses[0]"),
        ("poses: [[1, .nan]]\n", "poses[0]"),
        ("poses: [[1, 1.0e+300]]\n", "poses[0]"),
        ("poses: [{x: true, y: 1}]\n", "poses[0]"),
        ("poses: [[1, 2]]\nwaypoints: [[1, 2]]\n", "poses and waypoints"),
        ("routes: [1]\n", "names, each with its own"),
        ("places: {1: [1, 2]}\n", "a name of 1 to 64 letters"),
        ("a: &a [1, 1]\nposes: [*a, *a]\n", "a YAML alias"),
        ("{", "no YAML"),
        ("!!python/object/apply:os.system ['true']", "no YAML"),
        ("[" * 5_000, "no YAML"),
        ("x" * (1 << 20) + "x", "more than 1 MiB"),
    ],
)
def test_what_is_no_route_is_refused_with_its_place(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(SourceError) as caught:
        read_routes([written(tmp_path, text)])
    (fault,) = caught.value.faults
    assert said in str(fault)
    assert fault.path.startswith("tour.yaml")


def test_all_files_are_read_before_anything_is_refused(tmp_path: Path) -> None:
    paths = [written(tmp_path, "[[1, 2]]"), written(tmp_path, "poses: 1", "b.yaml"), tmp_path / "none.yaml"]
    with pytest.raises(SourceError) as caught:
        read_routes([*paths, paths[0]])
    assert [fault.path for fault in caught.value.faults] == ["b.yaml: poses", "none.yaml", "tour.yaml"]
