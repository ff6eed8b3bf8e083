"""Scenes of MuJoCo as scenes of upright solids."""

from pathlib import Path

import pytest
import trimesh

from tasks.worlds.importer.mjcf_reader import read_mjcf
from tasks.worlds.importer.source_scene import Scene, SourceError
from tests.worlds.importer.sources import findings, only, solids, write_mesh

FLOOR = "<geom type='plane' size='5 5 1'/>"


def scene(folder: Path, world: str, assets: str = "") -> Scene:
    path = folder / "lab.xml"
    path.write_text(f"<mujoco>{assets}<worldbody>{world}</worldbody></mujoco>")
    return read_mjcf(path)


def test_geoms_stand_where_mujoco_has_them(tmp_path: Path):
    post = "<geom name='post' type='cylinder' size='0.1 0.5' pos='2 0 0.5' rgba='1 0.5 0 1'/>"
    desk = "<body name='desk' pos='0 1 0'><geom type='box' size='0.5 0.3 0.2' pos='0 0 0.2' euler='0 0 30'/></body>"
    found = scene(tmp_path, FLOOR + post + desk)
    cylinder, box = solids(found)
    assert [(piece.name, piece.center_m) for piece in found.pieces] == [("post", (2.0, 0.0)), ("desk", (0.0, 1.0))]
    assert (cylinder.shape, cylinder.half_extents_m, cylinder.color) == ("cylinder", (0.1, 0.1, 0.5), (1.0, 0.5, 0.0))
    assert (box.center_m, box.half_extents_m) == ((0.0, 1.0, 0.2), (0.5, 0.3, 0.2))
    assert box.yaw_rad == pytest.approx(0.523599)
    assert (found.exact, found.findings) == (2, ())


def test_a_mesh_is_in_the_world_as_it_is_drawn(tmp_path: Path):
    write_mesh(tmp_path / "m" / "block.stl", trimesh.creation.box(bounds=((1, 0, 0), (2, 2, 1))))
    assets = "<compiler meshdir='m'/><asset><mesh name='block' file='block.stl'/></asset>"
    found = scene(tmp_path, FLOOR + "<geom type='mesh' mesh='block'/>", assets)
    assert only(found).center_m == pytest.approx((1.5, 1.0, 0.5), abs=1e-5)
    assert sorted(found.files) == ["lab.xml", "m/block.stl"]


def test_bodies_with_joints_stand_still_and_are_named(tmp_path: Path):
    ball = "<body name='ball' pos='0 0 1'><freejoint/><geom type='sphere' size='0.2'/></body>"
    said = findings(scene(tmp_path, FLOOR + ball), "approximated")
    assert said[0] == "1 bodies: have joints in the source; what would move there stands still here (ball)"


def test_what_nothing_meets_is_dropped_and_said(tmp_path: Path):
    ghost = "<geom name='ghost' type='box' size='1 1 1' contype='0' conaffinity='0'/>"
    post = "<geom name='post' type='box' size='0.1 0.1 1' pos='3 0 1'/>"
    assert findings(scene(tmp_path, FLOOR + ghost + post), "dropped") == [
        "ghost: contype and conaffinity are 0: it is seen, and nothing meets it"
    ]


@pytest.mark.parametrize(
    ("world", "assets", "said"),
    [
        ("", "<asset><hfield name='hill' nrow='2' ncol='2' size='1 1 1 1'/></asset>", "no height field"),
        ("<replicate count='1000000'><geom size='1'/></replicate>", "", "written out"),
        ("<geom size='nan'/>", "", "finite numbers"),
        ("<geom size='-1'/>", "", "a model that MuJoCo compiles"),
        ("<geom mesh='m' type='mesh'/>", "<asset><mesh name='m' file='../m.stl'/></asset>", "a path without .."),
        ("<include file='none.xml'/>", "", "a file in the folder"),
        ("<plugin/>", "", "no code"),
        ("", "", "at least one part"),
    ],
)
def test_what_no_static_world_has_is_refused(tmp_path: Path, world: str, assets: str, said: str):
    with pytest.raises(SourceError, match=said):
        scene(tmp_path, world, assets)


def test_an_entity_is_refused_before_mujoco_reads_it(tmp_path: Path):
    path = tmp_path / "lab.xml"
    path.write_text("<!DOCTYPE mujoco [<!ENTITY a 'b'>]><mujoco/>")
    with pytest.raises(SourceError, match="a document type"):
        read_mjcf(path)
