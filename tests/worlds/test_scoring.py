"""Layouts are scored by what they miss."""

import numpy as np
import pytest

from tasks.worlds.brief import brief_of
from tasks.worlds.scoring import (
    CONNECTION,
    HARD,
    all_connected,
    demands_of,
    deviation,
    score_connections,
    score_reach,
    score_shapes,
    shared_walls,
)
from tasks.worlds.slicing import Layouts
from tests.worlds.templates import connection, room, template


def layouts(*cells: tuple[float, float, float, float]) -> Layouts:
    return Layouts(np.array([cells]), np.zeros((1, len(cells) - 1, 3)), np.zeros((1, len(cells) - 1), dtype=bool))


def test_too_wide_and_too_deep_deviate_alike() -> None:
    np.testing.assert_allclose(deviation(np.array([2.0, 0.5, 1.0]), 1.0), [1.0, 1.0, 0.0])


def test_a_shared_wall_is_measured_between_faces() -> None:
    walls = shared_walls(layouts((0, 0, 4, 4), (4, 1, 7, 6)))
    assert walls[0, 0, 1] == walls[0, 1, 0] == pytest.approx(3.0 - 0.12)


def test_rooms_that_touch_in_a_corner_share_no_wall() -> None:
    assert shared_walls(layouts((0, 0, 4, 4), (4, 4, 7, 7)))[0, 0, 1] == 0.0


def test_a_wished_connection_without_wall_costs_more_than_any_shape() -> None:
    brief = brief_of(template(room("A"), room("B"), connections=(connection("A", "B"),)))
    demands = demands_of(brief)
    assert score_connections(layouts((0, 0, 4, 4), (4, 4, 8, 8)), demands)[0] >= CONNECTION
    assert score_connections(layouts((0, 0, 4, 4), (4, 0, 8, 4)), demands)[0] == 0.0


def test_rooms_that_no_doorway_joins_are_unusable() -> None:
    assert score_reach(layouts((0, 0, 4, 4), (4, 3.5, 8, 8)))[0] >= HARD
    assert score_reach(layouts((0, 0, 4, 4), (4, 2, 8, 8)))[0] == 0.0


def test_a_layout_without_a_place_for_the_start_is_unusable() -> None:
    demands = demands_of(brief_of(template(room("A", area_m2=16.0))))
    assert score_shapes(layouts((0, 0, 8.12, 2.1)), demands)[0] >= HARD
    assert score_shapes(layouts((0, 0, 4.12, 4.12)), demands)[0] < 0.01


def test_an_outspoken_aspect_weighs_more_than_the_default() -> None:
    demands = demands_of(brief_of(template(room("A"), room("B", aspect=(2.0, 1.0)))))
    assert demands.weight[1] > demands.weight[0]


def test_a_chain_is_connected_and_an_island_is_not() -> None:
    chain = np.zeros((6, 6), dtype=bool)
    for n in range(5):
        chain[n, n + 1] = chain[n + 1, n] = True
    island = chain.copy()
    island[2, 3] = island[3, 2] = False
    assert all_connected(np.stack([chain, island])).tolist() == [True, False]
