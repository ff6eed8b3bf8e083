"""A building of one's own in every format: its prisms are where they are, and there is a floor where no rooms are."""

import io
from pathlib import Path
from xml.etree import ElementTree as ET

import mujoco
import numpy as np
import pytest
import trimesh
from jaxtyping import Float64
from pxr import Usd, UsdGeom, UsdPhysics, UsdUtils

from specs.data.world import Solid, Start, corners_m
from tasks.export.format.glb import glb
from tasks.export.format.mjcf import mjcf_files
from tasks.export.format.occupancy_map import FREE, OCCUPIED, map_levels
from tasks.export.format.sdf import sdf_files
from tasks.export.format.usd import USD_FILE, usd_files
from tasks.worlds.importer.own_floor import measured
from tests.export.format.test_sdf import models, unpacked
from tests.export.validators import sdf_says
from tests.factories.own_worlds import block, piece, walled_hall, wedge

TURNED = wedge("wedge", (13.0, 7.5), yaw_rad=2.5, low_m=0.2)
WALL = wedge("pillar", (14.5, 6.0), yaw_rad=-1.0)
RACK = block("rack", (12.0, 8.0), (0.8, 0.4))
WORLD = measured(walled_hall((6.0, 4.0), [piece("wedge", TURNED), piece("rack", RACK)], [WALL]))
BOTH = pytest.mark.parametrize("solid", [TURNED, WALL], ids=lambda solid: solid.name)


def expected(solid: Solid) -> Float64[np.ndarray, "corners 3"]:
    heights = (solid.center_m[2] - 0.5, solid.center_m[2] + 0.5)
    return in_order(np.array([(*corner, z) for z in heights for corner in corners_m(solid)]))


def in_order(points: np.ndarray) -> Float64[np.ndarray, "corners 3"]:
    """Returns places in the order of their coordinates, each once."""
    rounded = np.unique(np.round(points, 4), axis=0)
    return rounded[np.lexsort(np.round(rounded, 2).T)]


@BOTH
def test_mujoco_has_the_corners(solid: Solid, tmp_path: Path):
    for name, body in mjcf_files(WORLD).items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(body)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "world.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    geom = model.geom(solid.name).id
    mesh = model.geom_dataid[geom]
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    turned = model.mesh_vert[first : first + count] @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
    np.testing.assert_allclose(in_order(turned), expected(solid), atol=2e-4)
    assert model.geom_contype[geom] == 1


@BOTH
def test_glb_has_the_corners(solid: Solid):
    scene = trimesh.load(io.BytesIO(glb(WORLD)), file_type="glb")
    assert isinstance(scene, trimesh.Scene)
    placed, geometry = scene.graph[solid.name]
    mesh = scene.geometry[geometry]
    x, up, minus_y = trimesh.transform_points(mesh.vertices, placed).T
    np.testing.assert_allclose(in_order(np.stack([x, -minus_y, up], axis=1)), expected(solid), atol=2e-4)
    mesh.merge_vertices(merge_norm=True, merge_tex=True)
    assert mesh.is_watertight
    assert mesh.volume > 0.0  # its faces look outwards


@BOTH
def test_usd_has_the_corners_and_collides_with_their_hull(solid: Solid, tmp_path: Path):
    for path, body in usd_files(WORLD).items():
        (tmp_path / path).write_bytes(body)
    checker = UsdUtils.ComplianceChecker()
    checker.CheckCompliance(str(tmp_path / USD_FILE))
    assert (checker.GetErrors(), checker.GetFailedChecks()) == ([], [])
    stage = Usd.Stage.Open(str(tmp_path / USD_FILE))
    prim = next(each for each in stage.Traverse() if each.GetName() == solid.name and each.GetTypeName() == "Mesh")
    local = np.array(UsdGeom.Mesh(prim).GetPointsAttr().Get())
    to_world = np.array(UsdGeom.XformCache().GetLocalToWorldTransform(prim))
    points = np.concatenate([local, np.ones((len(local), 1))], axis=1) @ to_world
    np.testing.assert_allclose(in_order(points[:, :3]), expected(solid), atol=2e-4)
    assert UsdPhysics.MeshCollisionAPI(prim).GetApproximationAttr().Get() == UsdPhysics.Tokens.convexHull


def test_libsdformat_takes_a_world_with_prisms(tmp_path: Path):
    file = unpacked(WORLD, tmp_path)
    files = [file, *(path for folder in models(tmp_path) for path in folder.glob("*/model.sdf"))]
    assert {sdf_says(each, models(tmp_path)) for each in files} == {"Valid."}


def test_sdf_draws_prisms_upwards_from_where_they_stand(tmp_path: Path):
    unpacked(WORLD, tmp_path)
    read = [ET.parse(file) for file in tmp_path.rglob("model.sdf")]  # noqa: S314 - our own documents
    polylines = [each for root in read for each in root.iter("collision") if each.find("geometry/polyline") is not None]
    found = {each.get("name", ""): each for each in polylines}
    assert len(found) == 2
    pillar = found["pillar_collision"]
    assert [float(each) for each in pillar.findtext("pose", "").split()] == [14.5, 6.0, 0.0, 0.0, 0.0, -1.0]
    points = [tuple(map(float, (each.text or "").split())) for each in pillar.findall("geometry/polyline/point")]
    assert tuple(points) == WALL.outline_m
    assert pillar.findtext("geometry/polyline/height") == "1"


def test_the_map_shows_what_is_reached_from_the_start():
    assert WORLD.start is not None
    levels = map_levels(WORLD.map, WORLD.start)
    places = {
        name: (int((x - 9.9) / 0.05), int((y - 4.9) / 0.05)) for name, x, y in (("far", 15.8, 8.8), ("in", 12.0, 8.0))
    }
    assert {name: levels[row, column] for name, (column, row) in places.items()} == {"far": FREE, "in": OCCUPIED}
    assert not (map_levels(WORLD.map, Start(x_m=9.92, y_m=4.92)) == FREE).any()


def test_a_world_without_rooms_has_a_floor():
    assert any(name.endswith("sheet-1.obj") for name in sdf_files(WORLD))
    assert b'"floor"' in glb(WORLD)
