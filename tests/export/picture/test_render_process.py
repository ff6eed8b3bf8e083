"""The picture holds the whole apartment, however it is shaped."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.data.world import Rectangle, World, solids
from tasks.export.picture.render_process import cut_open, whole_view
from tests.export.variants import with_door, with_windows
from tests.factories.own_worlds import piece, wedge
from tests.factories.worlds import apartment

HALF_HEIGHT = math.tan(math.radians(14.0))
sides_m = st.floats(3.0, 40.0)


@given(sides_m, sides_m, st.sampled_from([4 / 3, 1.0, 16 / 9]))
def test_the_apartment_fills_the_picture_and_stays_in_it(width_m: float, depth_m: float, aspect: float):
    footprint = Rectangle(x_min_m=-1.5, y_min_m=-1.5, x_max_m=width_m - 1.5, y_max_m=depth_m - 1.5)
    view = whole_view(apartment().model_copy(update={"footprint": footprint}), aspect)
    corners = np.array([(x, y, 0.0) for x in (-1.5, width_m - 1.5) for y in (-1.5, depth_m - 1.5)])
    seen = (corners - view.target_m) @ view.axes.T
    places = np.abs(seen[:, :2] / (seen[:, 2:] + view.distance_m) / (HALF_HEIGHT * aspect, HALF_HEIGHT))
    assert places.max() < 1.0
    assert places.max() > 0.75


@pytest.mark.parametrize(("depth_m", "turned"), [(5.0, False), (30.0, True)])
def test_a_long_apartment_lies_across_the_picture(depth_m: float, *, turned: bool):
    footprint = Rectangle(x_min_m=-3.0, y_min_m=-3.0, x_max_m=3.0, y_max_m=depth_m - 3.0)
    across = whole_view(apartment().model_copy(update={"footprint": footprint}), 4 / 3).axes[0]
    assert (abs(across[1]) > abs(across[0])) == turned


CUT_M = 1.5


@pytest.fixture(scope="module")
def world() -> World:
    return apartment()


def face_m2(world: World, name: str) -> float:
    """Returns the area of a wall's larger upright face, over all the parts that it was cut into."""
    parts = [wall.half_extents_m for wall in world.walls if wall.name.split("/")[0] == name]
    return sum(4 * max(half_m[:2]) * half_m[2] for half_m in parts)


def test_no_wall_is_higher_than_the_cut_and_lintels_above_it_are_gone(world: World):
    cut = cut_open(world, CUT_M)
    assert {wall.name for wall in cut.walls} == {wall.name for wall in world.walls} - {"wall-7"}
    assert all(wall.center_m[2] + wall.half_extents_m[2] == pytest.approx(CUT_M) for wall in cut.walls)


def test_furniture_stays_whole(world: World):
    assert cut_open(world, 0.2).furniture == world.furniture


def test_a_roof_is_taken_off(world: World):
    roofed = world.model_copy(
        update={"furniture": (*world.furniture, piece("roof", wedge("roof", (0.0, 0.0), low_m=9.0)))}
    )
    assert cut_open(roofed, 0.2).furniture == world.furniture


def test_a_wall_has_a_hole_where_its_window_is(world: World):
    seen = with_windows(world)
    # The west wall is 4 m long; its window is 1.2 m wide from 0.9 m upwards.
    assert face_m2(cut_open(seen, CUT_M), "wall-3") == pytest.approx(4.0 * CUT_M - 1.2 * (CUT_M - 0.9))
    assert face_m2(cut_open(seen, 2.5), "wall-3") == pytest.approx(4.0 * 2.5 - 1.2 * 1.2)
    assert face_m2(cut_open(seen, 2.5), "wall-1") == pytest.approx(9.3 * 2.5)


def test_two_windows_in_one_wall_are_two_holes(world: World):
    window = with_windows(world).windows[0].model_copy(update={"width_m": 0.8})
    pair = tuple(window.model_copy(update={"center_m": (-2.55, y_m)}) for y_m in (-1.0, 1.0))
    cut = cut_open(world.model_copy(update={"windows": pair}), 2.5)
    assert face_m2(cut, "wall-3") == pytest.approx(4.0 * 2.5 - 2 * 0.8 * 1.2)


def test_a_window_above_the_cut_is_not_there(world: World):
    assert cut_open(with_windows(world), 0.8).windows == ()


def test_doors_are_cut_and_keep_their_place():
    world = with_door(40.0)
    (door,) = cut_open(world, CUT_M).doors
    assert door.leaf.center_m[:2] == world.doors[0].leaf.center_m[:2]
    assert door.leaf.center_m[2] + door.leaf.half_extents_m[2] == pytest.approx(CUT_M)


def test_names_stay_unique(world: World):
    names = [solid.name for solid in solids(cut_open(with_windows(world), CUT_M))]
    assert len(names) == len(set(names))
