"""Proposals are the best of all slicing plans."""

import numpy as np

from tasks.worlds.floorplan.room_layouts import common_walls
from tasks.worlds.floorplan.scoring import WALL_M, demands_of, skew
from tasks.worlds.floorplan.search import propose
from tests.worlds.briefs import brief, flat, wish


def test_four_equal_squares_are_proposed_as_two_rows() -> None:
    home = brief(*(wish(name, area_m2=16.0) for name in "ABCD"))
    cells = propose(demands_of(home), 1).cells()[:, :, 0]
    floors = cells[2:] - cells[:2] - WALL_M
    np.testing.assert_allclose(floors, 4.0)


def test_no_more_are_proposed_than_asked_for_or_than_there_are() -> None:
    home = brief(*(wish(name) for name in "ABCD"))
    assert propose(demands_of(home), 10).lines.shape == (7, 10)
    assert propose(demands_of(home), 1000).lines.shape == (7, 144)


def test_areas_are_nearly_right_and_cells_reach_the_outline() -> None:
    demands = demands_of(flat())
    proposals = propose(demands, 50)
    cells = proposals.cells()
    width, height = cells[2:] - cells[:2] - WALL_M
    np.testing.assert_allclose(width * height, np.tile(demands.areas_m2[:, None], 50), rtol=0.1)
    np.testing.assert_allclose(cells[2:].max(axis=1), proposals.lines[2:4])
    assert (cells[:2].min(axis=1) == 0.0).all()


def test_connected_rooms_lie_side_by_side() -> None:
    demands = demands_of(flat())
    walls = common_walls(propose(demands, 20).cells(), *demands.pairs)
    assert (walls > 0.0).mean() > 0.95


def test_connections_decide_before_shapes() -> None:
    # Five squares of the same size are best as a row of two and one of three, where no room touches all others.
    star = brief(wish("Hub", "Hallway", 15.0), *(wish(name, area_m2=15.0) for name in "ABCD"))
    wished = brief(*star.rooms, connections=((0, 1), (0, 2), (0, 3), (0, 4)))
    without, wanted = (propose(demands_of(each), 1).cells() for each in (star, wished))
    hub, others = np.zeros(4, dtype=int), np.arange(1, 5)
    assert (common_walls(without, hub, others) > 1.0).sum() < 4
    assert (common_walls(wanted, hub, others) > 1.0).sum() == 4


def test_the_outline_follows_a_wish_that_is_spelt_out() -> None:
    rooms = [wish(name) for name in "ABCDEF"]
    for aspect in (0.4, 2.5):
        lines = propose(demands_of(brief(*rooms, footprint=aspect)), 5).lines
        assert (np.abs(skew(lines[2] / lines[3] / aspect)) < 0.6).all()
