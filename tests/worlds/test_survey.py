"""The floor of a finished world is measured on exact outlines; checked with code that shares nothing with it."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.data.world import Solid, World
from tasks.simulate.geometry.obstacles import obstacles
from tasks.simulate.geometry.world_arrays import floor_map
from tasks.worlds.generate import generate_world
from tasks.worlds.geometry import CELL_M, RADIUS_MAX_M, Box, reaches_room
from tasks.worlds.survey import ExactGrid, exact_grid
from tests.factories.simulations import convex
from tests.worlds.geometry_checks import bottom_m, distances, in_the_way
from tests.worlds.templates import doorway, room, template

HALL = Box(-2.0, -1.5, 6.0, 1.5)
FULL_TURN = st.floats(-math.pi, math.pi)
# A cell is looked at in so many places a side.
_LOOKS = 11


def block(x: float, y: float, half: tuple[float, float], yaw: float = 0.0, bottom_m: float = 0.0) -> Solid:
    return Solid(
        name="block", shape="box", center_m=(x, y, bottom_m + 0.5), half_extents_m=(*half, 0.5), yaw_rad=yaw,
        color=(0.0, 0.0, 0.0),
    )  # fmt: skip


def post(x: float, y: float, radius: float) -> Solid:
    return block(x, y, (radius, radius)).model_copy(update={"shape": "cylinder"})


def wedge(x: float, y: float, corners: np.ndarray, yaw: float = 0.0) -> Solid:
    half = np.abs(corners).max(axis=0)
    outline = tuple((float(u), float(v)) for u, v in corners)
    return Solid.model_validate(
        block(x, y, (float(half[0]), float(half[1])), yaw).model_dump() | {"shape": "prism", "outline_m": outline}
    )


def gap(width_m: float, yaw: float) -> list[Solid]:
    """Two long boxes that leave a gap of that width around (2, 0), the wall between them turned."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    away = 3.0 + width_m / 2
    return [block(2.0 - side * sin * away, side * cos * away, (0.05, 3.0), yaw) for side in (1, -1)]


def centers(grid: ExactGrid) -> np.ndarray:
    x, y = (low + CELL_M * (np.arange(cells) + 0.5) for low, cells in zip(grid.origin, grid.shape, strict=True))
    return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)


@st.composite
def things(draw: st.DrawFn) -> Solid:
    x, y = draw(st.floats(-2.0, 6.0)), draw(st.floats(-1.5, 1.5))
    shape = draw(st.sampled_from(("post", "block", "wedge")))
    if shape == "post":
        return post(x, y, draw(st.floats(0.02, 1.0)))
    if shape == "wedge":
        return wedge(x, y, convex(np.random.default_rng(draw(st.integers(0, 999))), 1.0), draw(FULL_TURN))
    return block(x, y, (draw(st.floats(0.02, 1.5)), draw(st.floats(0.02, 0.6))), draw(FULL_TURN))


@given(st.lists(things(), max_size=6))
def test_a_cells_distance_is_that_of_its_centre_to_the_nearest_outline(solids: list[Solid]) -> None:
    grid = exact_grid(HALL, solids)
    points = centers(grid)
    furthest = math.hypot(RADIUS_MAX_M, CELL_M / 2)
    expected = np.min([np.full(len(points), furthest), *(distances(each, points) for each in solids)], axis=0)
    # What is turned by less than a hundred-thousandth counts as straight.
    np.testing.assert_allclose(grid.distance_m.ravel(), expected, atol=4e-5)


@given(st.lists(things(), min_size=1, max_size=3))
def test_a_cell_is_touched_where_an_outline_crosses_it(solids: list[Solid]) -> None:
    grid = exact_grid(HALL, solids)
    inside = np.linspace(-1.0, 1.0, _LOOKS) * (CELL_M / 2 - 1e-6)
    looks = np.stack(np.meshgrid(inside, inside, indexing="ij"), axis=-1).reshape(-1, 2)
    points = (centers(grid)[:, None] + looks).reshape(-1, 2)
    nearest = np.min([distances(each, points) for each in solids], axis=0).reshape(-1, len(looks)).min(axis=1)
    touched = grid.touched.ravel()
    # Looks reach a micrometre short of the cell's border, and 5 mm lie between two of them.
    assert nearest[touched].max(initial=0.0) <= CELL_M / (_LOOKS - 1)
    assert nearest[~touched].min(initial=1.0) > 0.0


@pytest.mark.parametrize("yaw", [0.0, 0.3, 0.6])
@pytest.mark.parametrize("width_m", [0.3, 0.6, 0.83, 1.2])
def test_the_radius_that_gets_through_a_gap_is_short_of_half_its_width_by_a_cell_at_most(
    width_m: float, yaw: float
) -> None:
    grid = exact_grid(HALL, gap(width_m, yaw))
    beyond = Box(4.0, -1.5, 6.0, 1.5)
    radii = [step / 1000 for step in range(1, 700)]
    through = max(r for r in radii if reaches_room(grid.reached(r), grid, beyond, r))
    assert width_m / 2 - CELL_M <= through <= width_m / 2


def test_what_is_under_a_solid_is_covered() -> None:
    covered = exact_grid(HALL, [block(0.5, 0.25, (0.5, 0.25), 0.4)]).covered
    assert covered.sum() * CELL_M**2 == pytest.approx(0.5, rel=0.05)


def test_a_lintel_is_in_nobodys_way() -> None:
    grid = exact_grid(HALL, [block(2.0, 0.0, (0.05, 1.5), bottom_m=2.0)])
    assert not grid.touched.any()


def test_a_box_beside_the_grid_holds_nobody_back() -> None:
    assert exact_grid(HALL, gap(1.0, 0.0)).widest_radius(Box(7.0, -1.0, 8.0, 1.0)) == RADIUS_MAX_M


def test_the_widest_radius_is_that_of_the_roomiest_cell() -> None:
    grid, threshold = exact_grid(HALL, gap(1.0, 0.0)), Box(1.95, -1.5, 2.05, 1.5)
    radius_m = grid.widest_radius(threshold)
    assert grid.free(radius_m - 1e-9)[grid.cells(threshold)].any()
    assert not grid.free(radius_m + 1e-6)[grid.cells(threshold)].any()


@pytest.fixture(scope="module")
def world() -> World:
    """A world with a door at 50 %, turned chairs, round tables and lamps."""
    body = template(
        room("A", "Living", 30.0), room("B", "Dining", 20.0), version="2", doorways=(doorway("Target.All", 50.0),)
    )
    return generate_world(body, seed=3, generation="wgj-1", floorplan_index=1, interior_index=1)


def test_map_certificate_and_the_map_of_controllers_agree(world: World) -> None:
    floor = floor_map(world, obstacles(world, 0.0, 2.0))
    runs = np.repeat(np.arange(len(world.map.runs)) % 2 == 1, world.map.runs)
    occupied = runs.reshape(world.map.rows, world.map.columns)
    low = np.array(world.map.origin_m)
    rows, columns = np.indices(floor.clearance_m.shape)
    points = floor.origin_m + floor.cell_m * np.stack([columns, rows], axis=-1)
    cells = np.floor((points - low) / CELL_M).astype(int)
    known = ((cells >= 0) & (cells < [world.map.columns, world.map.rows])).all(axis=-1)
    at, away = occupied[cells[known][:, 1], cells[known][:, 0]], floor.clearance_m[known]
    assert at[away <= 0.0].all()
    assert away[at].max() <= CELL_M * math.sqrt(2)
    assert {bottom_m(each) < 2.0 for each in in_the_way(world)} == {True}
