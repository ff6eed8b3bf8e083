"""The floor of a world of one's own: what a robot gets to, and how large it may be."""

import numpy as np
import pytest

from specs.data.world import Start
from tasks.worlds.importer.own_floor import cell_at, keep_pieces, largest_radius_m, measured, own_floor, reached_from
from tests.factories.own_worlds import block, piece, walled_hall

START = Start(x_m=11.0, y_m=6.0)
# Two rooms of 3 x 4 m, with a gap of 0.8 m between them.
SPLIT = walled_hall((6.2, 4.0), inner=[block("low", (13.1, 6.0), (0.2, 2.0)), block("high", (13.1, 8.4), (0.2, 1.2))])


def test_a_robot_gets_through_a_gap_that_it_fits():
    grid = own_floor(SPLIT)
    beyond = cell_at(grid, (15.0, 7.0))
    assert beyond is not None
    assert reached_from(grid, START, 0.35)[beyond]
    assert not reached_from(grid, START, 0.41)[beyond]


def test_the_largest_radius_is_that_of_the_gap_short_of_a_cell():
    assert 0.35 <= largest_radius_m(own_floor(SPLIT), START) <= 0.40


def test_what_is_outside_of_the_walls_does_not_count():
    world = SPLIT.model_copy(update={"footprint": SPLIT.footprint.model_copy(update={"x_max_m": 40.0})})
    assert 0.35 <= largest_radius_m(own_floor(world), START) <= 0.40


@pytest.mark.parametrize("start", [Start(x_m=13.1, y_m=6.0), Start(x_m=-3.0, y_m=0.0)])
def test_a_start_in_a_solid_or_beside_the_floor_reaches_nothing(start: Start):
    grid = own_floor(SPLIT)
    assert not reached_from(grid, start, 0.1).any()
    assert largest_radius_m(grid, start) == 0.0


def test_a_measured_world_has_the_map_and_the_figures_of_its_floor():
    world = measured(walled_hall((6.0, 4.0), [piece("rack", block("rack", (14.0, 7.0), (1.0, 1.0)))]), 0.2)
    certificate, cells = world.certificate, own_floor(world)
    assert certificate.guaranteed_robot_radius_m == 0.2
    assert certificate.origin_clear_radius_m == pytest.approx(0.975, abs=0.03)
    assert certificate.free_floor_share == pytest.approx(23 / (6.2 * 4.2), abs=0.02)
    assert (world.map.columns, world.map.rows) == cells.shape
    assert sum(world.map.runs[1::2]) == np.count_nonzero(cells.touched)


def test_with_fewer_pieces_a_world_of_ones_own_is_measured_anew():
    pieces = [piece(name, block(name, (x, 7.0), (1.0, 1.0))) for name, x in (("rack", 14.0), ("box", 12.5))]
    world = measured(walled_hall((6.0, 4.0), pieces), 0.2)
    fewer = keep_pieces(world, {"box"})
    assert [each.name for each in fewer.furniture] == ["box"]
    assert fewer.generator == keep_pieces(fewer, {"box"}).generator == "simyard-import-7-shrunk"
    assert fewer.certificate.free_floor_share > world.certificate.free_floor_share
    assert fewer.certificate.guaranteed_robot_radius_m == 0.2
    assert keep_pieces(world, {"rack", "box"}).certificate == world.certificate
