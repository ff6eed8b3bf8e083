"""The clearance map says how far the nearest solid is."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.data.world import Rectangle, Solid, solids
from tasks.simulate.geometry.obstacles import obstacles
from tasks.simulate.geometry.world_arrays import floor_map, grid_cells
from tests.factories.simulations import cell_of, pen
from tests.factories.worlds import apartment

WORLD = apartment()
FLOOR = floor_map(WORLD, obstacles(WORLD, 0.02, 0.38))
TURNED = pen(4.5, 3)
PEN = floor_map(TURNED, obstacles(TURNED, 0.02, 0.38))


@given(st.floats(-2.4, 2.4), st.floats(-1.0, 1.3))
def test_clearance_is_the_distance_to_the_nearest_solid(x: float, y: float):
    # In the living room: walls at x = -2.5 and 2.5 and y = 2, the sofa's front at y = -1.1, the lamp's foot.
    sofa = np.hypot(max(abs(x) - 1.0, 0.0), y + 1.1)
    doorway_posts = min(np.hypot(2.5 - x, y - 0.05), np.hypot(2.5 - x, 0.95 - y)) if 0.05 < y < 0.95 else 2.5 - x
    lamp = np.hypot(x + 2.1, y - 1.6) - 0.2
    expected = max(min(sofa, doorway_posts, x + 2.5, 2.0 - y, lamp), 0.0)
    row, column = cell_of(FLOOR, np.array([x, y]))
    assert FLOOR.clearance_m[row, column] == pytest.approx(expected, abs=float(FLOOR.cell_m) * 0.71)


@given(st.integers(0, 127), st.integers(0, 127))
def test_turned_blocks_and_posts_are_as_far_as_they_are(row: int, column: int):
    x, y = PEN.origin_m + PEN.cell_m * np.array([column, row])
    away_m = [_beyond_m(solid, float(x), float(y)) for solid in solids(TURNED)]
    inside = max(abs(float(x)), abs(float(y))) <= 2.25
    assert PEN.clearance_m[row, column] == pytest.approx(max(min(away_m), 0.0) if inside else 0.0, abs=1e-5)


def test_nothing_is_free_outside_the_apartment():
    row, column = cell_of(FLOOR, np.array([0.0, 3.0]))
    assert FLOOR.clearance_m[row, column] == 0.0


def test_the_cell_of_a_point_holds_it():
    row, column = cell_of(FLOOR, np.array([1.23, -0.77]))
    center = FLOOR.origin_m + FLOOR.cell_m * np.array([column, row])
    assert np.abs(center - (1.23, -0.77)).max() <= float(FLOOR.cell_m) / 2 + 1e-6


def test_apartments_up_to_14_4_m_share_a_grid_size():
    large, wide = (
        WORLD.model_copy(update={"footprint": Rectangle(x_min_m=-half, y_min_m=-2, x_max_m=half, y_max_m=2)})
        for half in (7, 8)
    )
    assert grid_cells(WORLD) == grid_cells(large) == 144
    assert grid_cells(wide) == 192


def test_a_huge_apartment_gets_coarser_cells_and_not_more_of_them():
    huge = WORLD.model_copy(update={"footprint": Rectangle(x_min_m=-60, y_min_m=-2, x_max_m=60, y_max_m=2)})
    assert grid_cells(huge) == 512
    assert floor_map(huge, obstacles(huge, 0.02, 0.38)).cell_m == pytest.approx(120 / 512)


def _beyond_m(solid: Solid, x: float, y: float) -> float:
    ahead = (x - solid.center_m[0] + 1j * (y - solid.center_m[1])) * np.exp(-1j * solid.yaw_rad)
    if solid.shape == "cylinder":
        return abs(ahead) - solid.half_extents_m[0]
    half_x, half_y, _ = solid.half_extents_m
    return float(np.hypot(max(abs(ahead.real) - half_x, 0.0), max(abs(ahead.imag) - half_y, 0.0)))
