"""Shortest ways have the lengths that geometry gives them, and those of a fine grid."""

from math import gcd

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from tasks.simulate.application.contract import Placement
from tasks.simulate.geometry.free_floor import clearance_m, solids_of
from tasks.simulate.geometry.obstacles import PRISM_COLUMNS, Obstacles, obstacles, pad_obstacles
from tasks.simulate.geometry.shortest_path import Ways, shortest_paths_m
from tests.factories.simulations import cluttered, pen, with_prisms, with_wedges

RADIUS_M = 0.2
NO_PRISMS = np.zeros((0, PRISM_COLUMNS), np.float32)
Place = tuple[float, float]


def among(boxes: list[tuple[float, float, float, float]], posts: list[tuple[float, float, float]] = []) -> Obstacles:  # noqa: B006 - never changed
    """Returns boxes (x, y, half x, half y) and posts (x, y, radius)."""
    return Obstacles(
        np.array([(x, y, 0.5, hx, hy, 0.5, 1.0, 0.0) for x, y, hx, hy in boxes], np.float32).reshape(-1, 8),
        np.array([(x, y, 0.5, radius, 0.5) for x, y, radius in posts], np.float32).reshape(-1, 5),
        NO_PRISMS,
    )


def length(solids: Obstacles, start: Place, *goals: Place, arrived_m: float = 0.0) -> float:
    placement = Placement(np.array([*start, 0.0]), np.array(goals))
    return float(shortest_paths_m([Ways(solids, RADIUS_M)], [placement], [arrived_m])[0])


FAR = [(50.0, 50.0, 0.1, 0.1)]
# A wall along x = 2 with a gap of 1 m around y = 0.
GATE = [(2.0, 3.0, 0.05, 2.5), (2.0, -3.0, 0.05, 2.5)]


def test_in_the_open_a_way_is_straight():
    assert length(among(FAR), (0.0, 0.0), (3.0, 4.0)) == pytest.approx(5.0)


def test_legs_add_up_in_order():
    assert length(among(FAR), (0.0, 0.0), (2.0, 0.0), (2.0, 3.0), (2.0, 0.0)) == pytest.approx(2.0 + 3.0 + 3.0)


def test_around_a_post_it_is_two_tangents_and_an_arc():
    found = length(among([], [(0.0, 0.0, 0.3)]), (-1.5, 0.0), (1.5, 0.0))
    around = 0.3 + RADIUS_M
    exact = 2 * np.sqrt(1.5**2 - around**2) + around * (np.pi - 2 * np.arccos(around / 1.5))
    assert found == pytest.approx(exact, rel=3e-3)


def test_around_a_boxs_corner_it_keeps_the_radius():
    # From below the left side, along it, a quarter turn around the corner at (0, 0), along the top.
    found = length(among([(2.0, -5.0, 2.0, 5.0)]), (-RADIUS_M, -2.0), (3.0, RADIUS_M))
    assert found == pytest.approx(2.0 + RADIUS_M * np.pi / 2 + 3.0, rel=2e-3)


def test_a_turned_box_is_gone_around_as_it_stands():
    cos, sin = np.cos(0.6), np.sin(0.6)
    turned = Obstacles(
        np.array([(0.0, 0.0, 0.5, 1.0, 0.3, 0.5, cos, sin)], np.float32), np.zeros((0, 5), np.float32), NO_PRISMS
    )
    start, goal = (-2.0, 0.1), (2.0, -0.4)
    there = length(turned, *((cos * x - sin * y, sin * x + cos * y) for x, y in (start, goal)))
    straightened = length(among([(0.0, 0.0, 1.0, 0.3)]), start, goal)
    assert there == pytest.approx(straightened, rel=1e-5)
    assert straightened > 4.1


def test_a_box_written_as_a_prism_is_gone_around_as_it_stands():
    world = cluttered(3)
    placements = [Placement(np.zeros(3), goal[None]) for goal in np.random.default_rng(3).uniform(-2.0, 6.0, (50, 2))]
    boxes, prisms = (
        shortest_paths_m([Ways(obstacles(each, 0.02, 0.38), RADIUS_M)] * 50, placements, [0.3] * 50)
        for each in (world, with_prisms(world))
    )
    found = np.isfinite(boxes)
    assert 10 < found.sum() < 50
    assert (found == np.isfinite(prisms)).all()
    # Of places on a goal's rim that are as good but for rounding, either may be taken.
    off = np.abs(boxes[found] - prisms[found])
    assert np.quantile(off, 0.9) < 1e-5
    assert off.max() < 1e-3


def test_around_a_prisms_corner_it_keeps_the_radius():
    turns = np.pi / 4 * np.arange(8)
    octagon = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    solids = among([])._replace(prisms=np.array([[0.0, 0.0, 0.5, 0.5, *octagon.ravel()]], np.float32))
    # Along two edges from corner to corner, where the ways begin and end beside them, and around the one between.
    begin, end = octagon[0] + RADIUS_M * octagon[0], octagon[4] + RADIUS_M * octagon[4]
    assert length(solids, tuple(begin), tuple(end)) == pytest.approx(
        4 * 2 * np.sin(np.pi / 8) + RADIUS_M * np.pi, rel=2e-3
    )


def test_a_gap_narrower_than_the_disc_is_shut():
    beyond = (4.0, 0.0)
    assert length(among(GATE), (0.0, 0.0), beyond) == pytest.approx(4.0)
    outside = length(among(GATE), (0.0, 0.0), beyond) + 1.0
    narrow = among([*GATE, (2.0, 0.2, 0.05, 0.5)])
    assert length(narrow, (0.0, 0.0), beyond) > outside  # it has to go around the wall's far end


def test_behind_a_closed_wall_there_is_no_way():
    walls = [(0.0, 3.0, 3.0, 0.1), (0.0, -3.0, 3.0, 0.1), (3.0, 0.0, 0.1, 3.0), (-3.0, 0.0, 0.1, 3.0)]
    assert length(among(walls), (0.0, 0.0), (5.0, 0.0)) == np.inf


def test_the_last_goal_is_reached_from_near_it():
    assert length(among(FAR), (0.0, 0.0), (3.0, 4.0), arrived_m=0.3) == pytest.approx(4.7)
    assert length(among(FAR), (0.0, 0.0), (0.1, 0.0), arrived_m=0.3) == 0.0


def test_a_goal_that_lies_near_the_way_costs_nothing():
    assert length(among(FAR), (0.0, 0.0), (2.0, 0.2), (4.0, 0.0), arrived_m=0.3) == pytest.approx(3.7, abs=1e-3)


def test_a_goal_aside_is_touched_where_the_way_is_shortest():
    found = length(among(FAR), (0.0, 0.0), (2.0, 1.0), (4.0, 0.0), arrived_m=0.5)
    aimed = np.hypot(2.0, 0.5) + (np.hypot(2.0, 0.5) - 0.5)  # by symmetry at (2, 0.5), then to the last goal's rim
    assert found == pytest.approx(aimed, rel=2e-3)


def test_a_goal_where_the_disc_has_no_room_counts_from_where_it_has():
    shelf = among([(3.0, 0.0, 0.1, 0.4)])
    assert length(shelf, (0.0, 0.0), (2.85, 0.0), arrived_m=0.3) == pytest.approx(3.0 - 0.1 - RADIUS_M, abs=0.25)
    assert length(shelf, (0.0, 0.0), (2.85, 0.0)) == np.inf


def test_parked_places_change_nothing():
    alone = among(GATE)
    (filled,) = pad_obstacles([alone])
    assert length(filled, (0.0, 1.0), (4.0, -1.0)) == length(alone, (0.0, 1.0), (4.0, -1.0))


def test_lanes_of_many_worlds_are_measured_together_as_alone():
    gate, far = (Ways(among(boxes), RADIUS_M) for boxes in (GATE, FAR))
    tasks = [(gate, (4.0, 1.0)), (far, (4.0, 1.0)), (gate, (4.0, -1.0)), (gate, (4.0, 1.0))]
    placements = [Placement(np.array([0.0, 1.0, 0.0]), np.array([goal])) for _, goal in tasks]
    together = shortest_paths_m([world for world, _ in tasks], placements, [0.0, 0.1, 0.2, 0.3])
    worlds = [among(boxes) for boxes in (GATE, FAR, GATE, GATE)]
    alone = [
        length(world, (0.0, 1.0), goal, arrived_m=0.1 * k)
        for k, (world, (_, goal)) in enumerate(zip(worlds, tasks, strict=True))
    ]
    assert together.tolist() == alone


@pytest.mark.parametrize("seed", [3, 9, 25])
def test_a_length_is_the_same_bits_whatever_other_tasks_are_measured(seed: int):
    # On a map's cells goals lie in one line; each seed has a way that led over another task's goal once.
    rng = np.random.default_rng(seed)
    cells = np.stack([rng.integers(-22, 23, (40, 2)), rng.integers(-10, 15, (40, 2))], axis=-1)
    placements = [Placement(np.zeros(3), 0.1 * goals) for goals in cells]
    world = Ways(obstacles(cluttered(seed % 4), 0.02, 0.38), RADIUS_M)
    together = shortest_paths_m([world] * len(placements), placements, [0.3] * len(placements))
    alone = [shortest_paths_m([world], [each], [0.3])[0] for each in placements]
    assert together.tolist() == alone


# A grid's ways go in 40 directions, which makes them up to 0.6 % too long, and they end at cells.
CELL_M, LONGER = 0.03, 1.006
MOVES = [(x, y) for x in range(6) for y in range(-5, 6) if gcd(x, abs(y)) == 1 and (x or y > 0)]


def by_grid(solids: Obstacles, half_m: float, start: Place, goals: list[Place]) -> list[float]:
    marks = np.arange(-half_m, half_m, CELL_M)
    cells = np.arange(len(marks) ** 2).reshape(len(marks), -1)
    x, y = np.meshgrid(marks, marks)
    free = clearance_m(solids_of(solids), np.stack([x.ravel(), y.ravel()], axis=1)) >= RADIUS_M
    rows: list[np.ndarray] = []
    for along, across in MOVES:
        low, high = (
            slice(max(-across, 0), len(marks) - max(across, 0)),
            slice(max(across, 0), len(marks) + min(across, 0)),
        )
        one, other = cells[low, : len(marks) - along].ravel(), cells[high, along:].ravel()
        both = free[one] & free[other]
        rows.append(np.stack([one[both], other[both], np.full(both.sum(), CELL_M * np.hypot(along, across))]))
    one, other, lengths = np.concatenate(rows, axis=1)
    graph = coo_array((lengths, (one.astype(int), other.astype(int))), shape=(cells.size,) * 2).tocsr()

    def cell(place: Place) -> int:
        column, row = np.rint((np.array(place) + half_m) / CELL_M).astype(int)
        return int(cells[row, column])

    found = dijkstra(graph, directed=False, indices=cell(start))
    return [float(found[cell(goal)]) for goal in goals]


@settings(max_examples=5, deadline=None)
@given(st.integers(0, 2**31))
def test_lengths_are_those_of_a_fine_grid(seed: int):
    world = pen(4.5, seed)
    solids = obstacles(with_wedges(world, seed) if seed % 2 else world, 0.02, 0.38)
    places = np.random.default_rng(seed).uniform(-2.0, 2.0, (40, 2))
    goals = [tuple(place) for place in places[clearance_m(solids_of(solids), places) > RADIUS_M + CELL_M]]
    for goal, on_grid in zip(goals, by_grid(solids, 2.25, (0.0, 0.0), goals), strict=True):
        found = length(solids, (0.0, 0.0), goal)
        if np.isinf(on_grid) or np.isinf(found):
            continue  # the grid may miss a gap that just lets the disc through
        assert on_grid / LONGER - 2 * CELL_M < found < on_grid + 2 * CELL_M


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**31), st.floats(0.0, 0.3))
def test_a_goal_on_the_way_never_makes_it_shorter(seed: int, arrived_m: float):
    solids = obstacles(cluttered(1), 0.02, 0.38)
    rng = np.random.default_rng(seed)
    first, second = (tuple(rng.uniform((-1.2, -0.7), (1.2, 1.2))) for _ in range(2))
    straight = length(solids, (0.0, 0.0), second, arrived_m=arrived_m)
    touring = length(solids, (0.0, 0.0), first, second, arrived_m=arrived_m)
    assert touring >= straight - 0.01 or np.isinf(straight)
