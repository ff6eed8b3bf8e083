"""The way that is left on a map: nought at the goal, longer behind walls, finite wherever a robot may be pushed to."""

import jax.numpy as jnp
import numpy as np
import pytest

from tasks.simulate.application.contract import HostMap
from tasks.simulate.training.episode_pool import WayFields, way_left_m, ways_left_mm

CELL_M, CELLS = 0.1, 41


def room(*, wall: bool) -> HostMap:
    """Returns a square room of 4 m around the origin; a wall along y leaves a gap at its upper end."""
    clearance = np.full((CELLS, CELLS), 1.0, np.float32)
    clearance[[0, -1]] = clearance[:, [0, -1]] = 0.0
    if wall:
        clearance[:32, 20] = 0.0
    edge = -CELL_M * (CELLS - 1) / 2
    return HostMap(
        clearance,
        np.full(2, edge, np.float32),
        np.asarray(CELL_M, np.float32),
        np.array([edge, edge, -edge, -edge], np.float32),
    )


def left_m(floor: HostMap, goal: tuple[float, float], place: tuple[float, float]) -> float:
    found = ways_left_mm(floor, [np.array(goal)], 0.18)
    cells = jnp.array([CELLS], jnp.int32)
    ways = WayFields(
        jnp.asarray(found[None]), jnp.asarray(floor.origin_m[None]), jnp.asarray(floor.cell_m[None]), cells
    )
    return float(way_left_m(ways, jnp.int32(0), jnp.int32(0), jnp.asarray(place, jnp.float32)))


@pytest.mark.parametrize("place", [(0.55, 0.0), (-0.4, 1.23), (-1.5, -1.5)])
def test_in_the_open_it_is_at_most_a_twelfth_longer_than_the_straight_way(place: tuple[float, float]):
    straight = float(np.hypot(place[0] - 1.0, place[1] - 0.5))
    assert straight - 0.01 <= left_m(room(wall=False), (1.0, 0.5), place) <= 1.083 * straight + 0.01


def test_at_the_goal_nothing_is_left():
    assert left_m(room(wall=False), (1.0, 0.5), (1.0, 0.5)) == pytest.approx(0.0, abs=1e-3)


def test_behind_a_wall_the_way_leads_through_the_gap():
    around = 2 * float(np.hypot(0.5, 1.2))
    assert left_m(room(wall=True), (0.5, 0.0), (-0.5, 0.0)) > around


def test_where_no_robot_stands_it_is_finite_and_leads_out():
    inside, beside = (left_m(room(wall=False), (0.5, 0.0), (x, 0.0)) for x in (-2.0, -1.9))
    assert inside == pytest.approx(beside + 0.1, abs=1e-3)
    outside = left_m(room(wall=False), (0.0, 0.0), (9.0, 9.0))
    assert 2.0 < outside < 65.6


def test_a_goal_that_no_way_leads_to_counts_from_the_nearest_free_cell():
    floor = room(wall=False)
    assert left_m(floor, (1.98, 0.0), (0.0, 0.0)) == pytest.approx(1.9, abs=0.05)


def test_a_map_without_a_free_cell_is_as_far_as_can_be_counted():
    floor = room(wall=False)._replace(clearance_m=np.zeros((CELLS, CELLS), np.float32))
    assert left_m(floor, (0.0, 0.0), (0.0, 0.0)) == pytest.approx(65.535)
