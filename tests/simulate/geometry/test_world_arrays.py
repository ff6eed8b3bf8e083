"""The clearance map says how far the nearest solid is."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.data.world import Rectangle, Solid, World, solids
from tasks.simulate.application.robot_model import Hull
from tasks.simulate.geometry import world_arrays
from tasks.simulate.geometry.obstacles import obstacles
from tasks.simulate.geometry.world_arrays import WorldArrays, arrays_of_worlds, floor_map, grid_cells
from tests.factories.simulations import cell_of, cluttered, pen, with_prisms, with_wedges
from tests.factories.worlds import apartment
from tests.worlds.geometry_checks import distances

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


def test_prisms_are_as_far_as_they_are():
    world = with_prisms(with_wedges(pen(4.5, 5), 5))
    floor = floor_map(world, obstacles(world, 0.02, 0.38))
    columns, rows = np.meshgrid(np.arange(144), np.arange(144))
    points = floor.origin_m + floor.cell_m * np.stack([columns, rows], axis=-1).reshape(-1, 2).astype(np.float64)
    inside = (np.abs(points) <= 2.25).all(axis=1)
    away_m = np.min([distances(solid, points) for solid in solids(world)], axis=0)
    np.testing.assert_allclose(floor.clearance_m.ravel(), np.where(inside, away_m, 0.0), atol=1e-5)


def test_worlds_without_prisms_are_filled_up_alone():
    plain, wedged = cluttered(1), with_wedges(cluttered(1), 1)
    alone = staged(plain)
    both = arrays_of_worlds({"plain": plain, "wedged": wedged}, HULL, SEEN_AT_M)
    assert [counts(each) for each in (both["plain"], staged(plain))] == [counts(alone)] * 2
    assert len(both["wedged"].contact_obstacles.prisms) == 32
    assert len(both["wedged"].lidar_outlines.prisms) == 3 * 64


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


HULL, SEEN_AT_M = Hull(0.18, 0.02, 0.38, 2.0), 0.2


@pytest.fixture(autouse=True)
def nothing_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """Begins each test without arrays of worlds before."""
    monkeypatch.setattr(world_arrays, "_kept", type(world_arrays._kept)())  # pyright: ignore[reportPrivateUsage] - it lives as long as a process
    monkeypatch.setattr(world_arrays, "_most", {})


def staged(world: World, hull: Hull = HULL, seen_at_m: float = SEEN_AT_M) -> WorldArrays:
    return arrays_of_worlds({"w": world}, hull, seen_at_m)["w"]


def test_a_world_is_made_into_arrays_once():
    world = cluttered(1)
    one, again = staged(world), staged(world)
    assert one.floor is again.floor
    assert one.ways is again.ways


def test_another_robot_or_world_of_that_name_has_arrays_of_its_own():
    world = cluttered(1)
    one = staged(world)
    wide, high, other = (
        staged(world, Hull(0.3, 0.02, 0.38, 2.0)),
        staged(world, HULL._replace(low_m=1.0, high_m=1.5)),
        staged(cluttered(2)),
    )
    assert not np.array_equal(one.rooms.parts, wide.rooms.parts)
    assert not np.array_equal(one.floor.clearance_m, high.floor.clearance_m)
    assert not np.array_equal(one.floor.clearance_m, other.floor.clearance_m)


def test_an_application_cannot_write_to_a_map_that_others_get():
    with pytest.raises(ValueError, match="read-only"):
        staged(cluttered(1)).floor.clearance_m[0, 0] = 1.0


def test_no_more_is_kept_than_there_is_room_for(monkeypatch: pytest.MonkeyPatch):
    worlds = {f"w-{seed}": cluttered(seed) for seed in range(3)}
    monkeypatch.setattr(world_arrays, "_KEPT_BYTES", 0)
    first = arrays_of_worlds(worlds, HULL, SEEN_AT_M)
    assert arrays_of_worlds(worlds, HULL, SEEN_AT_M)["w-0"].floor is first["w-0"].floor  # those of a chunk are all kept
    staged(cluttered(9))
    assert len(world_arrays._kept) == 1  # pyright: ignore[reportPrivateUsage] - see above


def counts(arrays: WorldArrays) -> list[int]:
    return [len(array) for array in (*arrays.contact_obstacles, *arrays.lidar_outlines)]


def test_no_worlds_are_no_arrays():
    assert arrays_of_worlds({}, HULL, SEEN_AT_M) == {}


def test_worlds_are_filled_up_like_those_before_that_have_up_to_twice_as_many_solids():
    few = cluttered(1)
    many, most = (few.model_copy(update={"walls": few.walls * (count // len(few.walls))}) for count in (200, 400))
    alone = staged(few)
    assert counts(staged(many))[0] == 2 * counts(alone)[0]
    assert counts(staged(few)) == counts(staged(many))
    assert np.array_equal(
        staged(few).contact_obstacles.boxes[: len(alone.contact_obstacles.boxes)], alone.contact_obstacles.boxes
    )
    staged(most)
    assert counts(staged(few)) == counts(alone)
    assert counts(staged(few, Hull(0.3, 0.02, 0.38, 2.0))) == counts(alone)


def test_a_world_is_filled_up_like_a_larger_one_that_it_once_shared_a_chunk_with():
    small = cluttered(1)
    some, more = (small.model_copy(update={"walls": small.walls * (count // len(small.walls))}) for count in (200, 400))
    together = arrays_of_worlds({"some": some, "more": more}, HULL, SEEN_AT_M)
    assert counts(staged(some)) == counts(together["some"])


def with_walls(low: int, high: int) -> World:
    """Returns a world with walls that a hull touches and no lidar at 1 m sees, and others that it sees alone."""
    base = cluttered(1)
    x, y, _ = base.walls[0].center_m
    half_x, half_y, _ = base.walls[0].half_extents_m

    def walls(count: int, z: float) -> list[Solid]:
        update = {"center_m": (x, y, z), "half_extents_m": (half_x, half_y, 0.05)}
        return [base.walls[0].model_copy(update=update)] * count

    return base.model_copy(update={"walls": (*walls(low, 0.2), *walls(high, 1.0))})


def test_what_worlds_are_filled_up_like_grows_kind_by_kind():
    staged(with_walls(400, 0), seen_at_m=1.0)
    staged(with_walls(0, 800), seen_at_m=1.0)  # of the first kind too few to be filled up like the world before
    boxes, _, _, upright, *_ = counts(staged(with_walls(200, 600), seen_at_m=1.0))
    assert (boxes, upright) == (512, 1024)
