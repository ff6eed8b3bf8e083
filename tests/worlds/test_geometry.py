"""Boxes meet as they should, overlaps are found, and distances on the grid are never longer than they are."""

import numpy as np
import pytest
from jaxtyping import Bool
from scipy import ndimage

from specs.data.world import Furniture, Solid
from tasks.worlds.geometry import (
    CELL_M,
    RADIUS_MAX_M,
    Box,
    bounding_box,
    bounds,
    bounds_grid,
    connected,
    connected_share,
    count_overlaps,
    reaches_room,
    rounded,
    solid_rows,
)

UNIT = Box(0.0, 0.0, 1.0, 1.0)


def test_boxes_that_share_a_border_do_not_meet() -> None:
    assert not UNIT.meets(UNIT.shifted(1.0, 0.0))
    assert UNIT.meets(UNIT.shifted(0.99, 0.99))


def test_the_box_around_boxes_holds_them_all() -> None:
    assert bounding_box([UNIT, UNIT.shifted(3.0, -2.0), UNIT.shifted(1.0, 1.0)]) == Box(0.0, -2.0, 4.0, 2.0)


def test_a_grown_box_keeps_its_middle() -> None:
    assert UNIT.grown(-0.2).center == UNIT.center
    assert UNIT.grown(0.5).area == 4.0


def test_a_document_holds_no_negative_zero() -> None:
    assert str(rounded(-1e-9)) == "0.0"


def box(x: float, y: float = 0.0, yaw: float = 0.0, z: float = 0.5) -> Solid:
    return Solid(
        name=f"box {x} {y} {yaw} {z}",
        shape="box",
        center_m=(x, y, z),
        half_extents_m=(0.5, 0.5, 0.5),
        yaw_rad=yaw,
        color=(0.5, 0.5, 0.5),
    )


def piece(*parts: Solid) -> Furniture:
    return Furniture(name="p", model_type="Ottomans", room="r", center_m=(0.0, 0.0), yaw_rad=0.0, solids=parts)


@pytest.mark.parametrize(
    ("first", "second", "overlaps"),
    [
        (box(0.0), box(0.9), 1),
        (box(0.0), box(1.0), 0),
        (box(0.0), box(0.0, z=1.5), 0),
        (box(0.0), box(1.15, yaw=0.7853981), 1),
        (box(0.0), box(1.22, yaw=0.7853981), 0),
        (box(0.0, yaw=0.7853981), box(1.05, 1.05, yaw=0.7853981), 0),
        (box(0.0, yaw=0.7853981), box(0.65, 0.65, yaw=0.7853981), 1),
    ],
)
def test_two_pieces_overlap_when_they_share_space(first: Solid, second: Solid, overlaps: int) -> None:
    assert count_overlaps([piece(first), piece(second)], []) == overlaps
    assert count_overlaps([piece(first)], [second]) == overlaps


def test_primitives_of_one_piece_and_walls_among_themselves_do_not_count() -> None:
    assert count_overlaps([piece(box(0.0), box(0.2))], [box(5.0), box(5.1)]) == 0


def test_a_pair_counts_once_however_many_primitives_meet() -> None:
    assert count_overlaps([piece(box(0.0), box(0.1)), piece(box(0.2), box(0.3))], []) == 1


def test_a_turned_box_has_wider_bounds() -> None:
    x_min, _, z_min, x_max, _, z_max = bounds(solid_rows([box(0.0, yaw=0.7853981)]))[0]
    assert (x_max - x_min, z_max - z_min) == (pytest.approx(2**0.5), pytest.approx(1.0))


def flood(free: Bool[np.ndarray, "x y"], start: tuple[int, int]) -> Bool[np.ndarray, "x y"]:
    """Returns what a walk from a free cell reaches, cell by cell."""
    found, border = np.zeros_like(free), [start]
    while border:
        x, y = border.pop()
        if 0 <= x < free.shape[0] and 0 <= y < free.shape[1] and free[x, y] and not found[x, y]:
            found[x, y] = True
            border += [(x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)]
    return found


def prism(x: float, y: float, corners: tuple[tuple[float, float], ...]) -> Solid:
    fields = box(x, y).model_dump() | {"name": f"prism {x} {y}", "shape": "prism", "outline_m": corners}
    return Solid.model_validate(fields)


def test_a_prism_overlaps_where_it_is_and_not_with_the_box_around_it() -> None:
    below, above = ((-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5)), ((0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))
    for others, overlaps in (
        (prism(0.0, 0.0, above), 0),
        (prism(-0.01, 0.0, above), 1),
        (box(0.76, 0.76), 0),
        (box(0.4, 0.4), 1),
        (box(0.72, 0.72, yaw=0.8), 0),
    ):
        assert count_overlaps([piece(prism(0.0, 0.0, below)), piece(others)], []) == overlaps


@pytest.mark.parametrize("shape", [(1, 4), (12, 9), (40, 51)])
@pytest.mark.parametrize("free_share", [0.45, 0.6, 0.75, 1.0])
def test_connected_cells_are_those_that_a_flood_reaches(shape: tuple[int, int], free_share: float) -> None:
    draws = np.random.default_rng(shape[0])
    free = draws.random(shape) <= free_share
    for x, y in draws.permutation(np.argwhere(free))[:5].tolist():
        np.testing.assert_array_equal(connected(free, (x, y)), flood(free, (x, y)))


def test_a_cell_that_is_not_free_is_connected_with_nothing() -> None:
    assert not connected(np.array([[False, True], [False, True]]), (0, 0)).any()


HALL = Box(-2.0, -1.0, 6.0, 1.0)


def block(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float] = (0.0, 1.0)) -> Solid:
    return Solid(
        name=f"{x}{y}",
        shape="box",
        center_m=((x[0] + x[1]) / 2, (y[0] + y[1]) / 2, (z[0] + z[1]) / 2),
        half_extents_m=((x[1] - x[0]) / 2, (y[1] - y[0]) / 2, (z[1] - z[0]) / 2),
        yaw_rad=0.0,
        color=(0.0, 0.0, 0.0),
    )


def gap(width_m: float) -> list[Solid]:
    """Two walls across the hall at x = 2 with a gap between them."""
    half = width_m / 2
    return [block((2.0, 2.1), (-1.0, -half)), block((2.0, 2.1), (half, 1.0))]


@pytest.mark.parametrize("width_m", [0.6, 0.7, 0.83, 0.9, 1.2])
def test_a_robot_wider_than_the_gap_never_passes_and_one_well_narrower_does(width_m: float) -> None:
    grid = bounds_grid(HALL, gap(width_m))
    beyond = Box(2.1, -1.0, 6.0, 1.0)
    for radius_m, passes in ((width_m / 2, False), (width_m / 2 - 0.12, True)):
        assert reaches_room(grid.reached(radius_m), grid, beyond, radius_m) is passes


def test_a_lintel_is_in_nobodys_way() -> None:
    lintel = block((2.0, 2.1), (-1.0, 1.0), (2.1, 2.7))
    grid = bounds_grid(HALL, [*gap(1.0), lintel])
    assert reaches_room(grid.reached(0.3), grid, Box(2.1, -1.0, 6.0, 1.0), 0.3)


def test_floor_that_is_shut_off_lowers_the_connected_share() -> None:
    grid = bounds_grid(HALL, [block((2.0, 2.1), (-1.0, 1.0))])
    share = connected_share(grid.reached(0.25), grid, HALL, 0.25)
    assert 0.4 < share < 0.6


def test_a_start_inside_a_solid_reaches_nothing() -> None:
    grid = bounds_grid(HALL, [block((-0.2, 0.2), (-0.2, 0.2))])
    assert not grid.reached(0.25).any()


@pytest.mark.parametrize("seed", range(4))
def test_a_robot_can_stand_where_the_exact_distance_transform_leaves_it_room(seed: int) -> None:
    places = np.random.default_rng(seed).uniform((-2.0, -1.0), (5.9, 0.9), (3, 2)).tolist()
    grid = bounds_grid(HALL, [block((x, x + 0.1), (y, y + 0.1)) for x, y in places])
    cells = np.round(np.asarray(ndimage.distance_transform_edt(~grid.touched)) ** 2)
    for radius_m in (0.05, 0.12, 0.25, 0.4, 0.6, RADIUS_MAX_M):
        # What a grid can hide: half a diagonal of a cell, and half a cell.
        nearest = ((radius_m + CELL_M * (2**-0.5 + 0.5)) / CELL_M) ** 2
        np.testing.assert_array_equal(grid.free(radius_m), cells >= nearest - 1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_a_robot_reaches_what_hangs_together_with_its_start(seed: int) -> None:
    places = np.random.default_rng(seed).uniform((-2.0, -1.0), (5.9, 0.9), (12, 2)).tolist()
    grid = bounds_grid(HALL, [block((x, x + 0.1), (y, y + 0.1)) for x, y in places])
    start = int(2.0 / CELL_M), int(1.0 / CELL_M)
    np.testing.assert_array_equal(grid.reached(0.05), flood(grid.free(0.05), start))


def test_nothing_is_reached_from_a_start_beside_the_grid() -> None:
    assert not bounds_grid(Box(1.0, 1.0, 3.0, 3.0), [block((1.0, 1.1), (1.0, 1.1))]).reached(0.1).any()
