"""Meshes as upright solids: exact where they are upright, and within a tolerance on the safe side where not."""

import math

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry.base import BaseGeometry

from tasks.worlds.importer.triangle_mesh import extruded
from tasks.worlds.importer.upright_solids import Fit, Upright, convex_parts, upright_solids


def fit_of(mesh: trimesh.Trimesh, **options: float) -> Fit:
    return upright_solids(np.asarray(mesh.vertices), np.asarray(mesh.faces, dtype=np.int64), **options)


def turned(mesh: trimesh.Trimesh, angle_rad: float, axis: tuple[float, float, float] = (0, 0, 1)) -> trimesh.Trimesh:
    return mesh.apply_transform(trimesh.transformations.rotation_matrix(angle_rad, axis))


def outline(solid: Upright) -> shapely.Polygon:
    """Returns what a solid covers of the floor."""
    x, y, _ = solid.center_m
    half_x, half_y, _ = solid.half_m
    if solid.shape == "cylinder":
        return shapely.Point(x, y).buffer(half_x, quad_segs=64)
    ring = solid.outline_m or ((-half_x, -half_y), (half_x, -half_y), (half_x, half_y), (-half_x, half_y))
    cos, sin = math.cos(solid.yaw_rad), math.sin(solid.yaw_rad)
    return shapely.Polygon([(x + cos * px - sin * py, y + sin * px + cos * py) for px, py in ring])


def covered(fit: Fit, height_m: float) -> BaseGeometry:
    """Returns what solids cover at a height."""
    here = [each for each in fit.solids if abs(height_m - each.center_m[2]) <= each.half_m[2]]
    return shapely.union_all([outline(each) for each in here])


def walls(*boxes: tuple[tuple[float, float, float], tuple[float, float, float]]) -> trimesh.Trimesh:
    mesh = trimesh.util.concatenate([trimesh.creation.box(bounds=bounds) for bounds in boxes])
    assert isinstance(mesh, trimesh.Trimesh)
    return mesh


@given(yaw=st.floats(-3.2, 3.2), x=st.floats(-20, 20))
@settings(max_examples=25, deadline=None)
def test_a_turned_box_stays_one_box(yaw: float, x: float):
    mesh = turned(trimesh.creation.box((1.0, 0.4, 0.8)), yaw).apply_translation((x, 1.0, 0.5))
    (solid,) = fit_of(mesh).solids
    assert solid.shape == "box"
    assert solid.center_m == pytest.approx((x, 1.0, 0.5), abs=2e-6)
    around = shapely.MultiPoint(np.asarray(mesh.vertices)[:, :2]).convex_hull
    assert outline(solid).symmetric_difference(around).area < 1e-4


def test_a_box_on_another_side_is_the_same_box():
    (solid,) = fit_of(turned(trimesh.creation.box((1.0, 0.4, 0.8)), math.pi / 2, (1, 0, 0))).solids
    assert (solid.shape, solid.half_m) == ("box", pytest.approx((0.5, 0.4, 0.2)))


def test_a_round_column_is_a_cylinder_and_says_how_far_off_it_is():
    fit = fit_of(trimesh.creation.cylinder(0.3, 1.0, sections=32))
    assert [each.shape for each in fit.solids] == ["cylinder"]
    assert fit.solids[0].half_m == pytest.approx((0.3, 0.3, 0.5))
    assert fit.off_m == pytest.approx(0.3 * (1 - math.cos(math.pi / 32)), rel=0.05)


@pytest.mark.parametrize("sides", [3, 5, 6, 8])
def test_an_upright_outline_of_up_to_eight_corners_is_one_exact_prism(sides: int):
    fit = fit_of(trimesh.creation.cylinder(0.5, 1.0, sections=sides))
    assert [(each.shape, len(each.outline_m or ())) for each in fit.solids] == [("prism", sides)]
    assert fit.off_m < 1e-5


def test_walls_above_head_height_are_not_cut_there():
    fit = fit_of(walls(((0, 0, 0), (6, 0.2, 2.5)), ((0, 4, 0), (6, 4.2, 2.5))))
    assert [each.half_m[2] for each in fit.solids] == [1.25, 1.25]


def test_a_wall_with_a_door_keeps_the_door_and_its_lintel():
    wall = shapely.box(0, 0, 4, 2.5).difference(shapely.box(1, -1, 2, 2))
    mesh = _extruded(wall, 0.2)
    fit = fit_of(turned(mesh, math.pi / 2, (1, 0, 0)))
    at_floor, at_lintel = covered(fit, 1.0), covered(fit, 2.2)
    assert at_floor.area == pytest.approx(3 * 0.2, rel=1e-3)
    assert at_lintel.area == pytest.approx(4 * 0.2, rel=1e-3)
    assert len(fit.solids) == 3


def _extruded(area: BaseGeometry, height: float) -> trimesh.Trimesh:
    assert isinstance(area, shapely.Polygon)
    rings = [shapely.get_coordinates(each)[:-1].tolist() for each in (area.exterior, *area.interiors)]
    mesh = extruded(rings, 0.0, height)
    return trimesh.Trimesh(mesh.points, mesh.faces)


def test_what_is_hollow_stays_hollow():
    pipe = _extruded(shapely.Point(0, 0).buffer(1.0, quad_segs=2).difference(shapely.Point(0, 0).buffer(0.8, 2)), 1.0)
    assert not covered(fit_of(pipe), 0.5).contains(shapely.Point(0, 0))


def test_a_mesh_whose_faces_have_a_front_and_a_back_is_as_solid_as_with_one_side():
    box = trimesh.creation.box((1, 0.7, 1.9))
    once = fit_of(box)
    twice = fit_of(trimesh.Trimesh(box.vertices, np.concatenate([box.faces, box.faces[:, ::-1]]), process=False))
    assert [covered(fit, 0.5).area for fit in (once, twice)] == pytest.approx([0.7, 0.7], abs=1e-4)


def test_solids_that_overlap_in_one_mesh_stay_solid():
    shape = fit_of(walls(((0, 0, 0), (2, 1, 1)), ((1, 0, 0), (3, 1, 1))))
    assert covered(shape, 0.5).contains(shapely.Point(1.5, 0.5))


def test_walls_without_thickness_become_thin_ones_and_their_room_stays_free():
    box = trimesh.creation.box((4, 3, 2))
    upright = np.abs(np.asarray(box.face_normals)[:, 2]) < 0.5
    sheets = trimesh.Trimesh(box.vertices, box.faces[upright], process=False)
    area = covered(fit_of(sheets), 0.0)
    assert not area.contains(shapely.Point(0, 0))
    assert area.buffer(1e-6).covers(shapely.box(-2, -1.5, 2, 1.5).exterior)


def test_a_room_that_was_made_to_be_seen_from_inside_is_no_block():
    room = trimesh.creation.box((4, 3, 2.5))
    room.invert()
    assert not covered(fit_of(room), 0.0).contains(shapely.Point(0, 0))


def test_a_table_top_without_thickness_is_not_lost():
    top = trimesh.Trimesh([(0, 0, 0.7), (1, 0, 0.7), (1, 1, 0.7), (0, 1, 0.7)], [(0, 1, 2), (0, 2, 3)], process=False)
    (solid,) = fit_of(top).solids
    assert solid.center_m[2] == pytest.approx(0.7)
    assert outline(solid).area == pytest.approx(1.0)


@pytest.mark.parametrize(
    "mesh",
    [
        trimesh.creation.icosphere(2, 0.4),
        turned(trimesh.creation.box((1.0, 0.5, 0.5)), 0.4, (0, 1, 0)),
        trimesh.creation.cone(0.4, 0.8),
        trimesh.creation.torus(0.5, 0.1),
    ],
    ids=["sphere", "tilted box", "cone", "ring"],
)
def test_what_is_askew_is_covered_and_no_further_off_than_it_says(mesh: trimesh.Trimesh):
    fit = fit_of(mesh)
    low, high = mesh.bounds[:, 2]
    for height in np.linspace(low, high, 23)[1:-1]:
        section = mesh.section((0, 0, 1), (0, 0, height))
        assert section is not None
        points = shapely.points(np.asarray(section.vertices)[:, :2])
        area = covered(fit, float(height))
        assert shapely.distance(points, area).max() <= 0.01
    assert 0.0 < fit.off_m <= 0.08
    assert len(fit.solids) <= 64


def test_what_lies_below_the_floor_is_cut_off():
    (solid,) = fit_of(trimesh.creation.box(bounds=((0, 0, -1), (1, 1, 1))), floor_m=0.0).solids
    assert (solid.center_m[2], solid.half_m[2]) == (0.5, 0.5)


@given(
    st.lists(st.tuples(st.floats(0, 8), st.floats(0, 8), st.floats(0.2, 3), st.floats(0.2, 3)), min_size=1, max_size=6)
)
@settings(max_examples=30, deadline=None)
def test_convex_parts_fill_an_outline_exactly(rectangles: list[tuple[float, float, float, float]]):
    area = shapely.union_all([shapely.box(x, y, x + w, y + h) for x, y, w, h in rectangles])
    for part in shapely.get_parts(shapely.buffer(shapely.set_precision(area, 1e-3), 0)):
        rings = [shapely.Polygon(ring) for ring in convex_parts(part)]
        assert shapely.union_all(rings).symmetric_difference(part).area < 1e-3
        assert sum(ring.area for ring in rings) == pytest.approx(part.area, rel=1e-3)
        assert all(len(ring.exterior.coords) <= 9 for ring in rings)


def test_the_same_mesh_gives_the_same_solids():
    mesh = trimesh.creation.icosphere(1, 0.4)
    assert fit_of(mesh) == fit_of(mesh)
