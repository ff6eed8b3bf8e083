"""Layouts know their rooms' cells and which of them lie side by side."""

from dataclasses import replace

import numpy as np
import pytest

from tasks.worlds.floorplan.scoring import (
    CONNECTION,
    HARD,
    OPENING_MIN_M,
    WALL_M,
    Layouts,
    all_connected,
    common_walls,
    demands_of,
    doorway_width,
    join_layouts,
    score,
    skew,
)
from tasks.worlds.resolved_template import ResolvedTemplate
from tests.worlds.resolved_templates import resolved, wish


def row(*borders: float) -> Layouts:
    """Returns rooms side by side between these x, 4 m deep."""
    rooms = len(borders) - 1
    inner = list(range(4, 3 + rooms))
    edges = [0, *inner, 2]
    sides = np.array([[edges[n], 1, edges[n + 1], 3] for n in range(rooms)])[:, :, None]
    lines = np.array([borders[0], 0.0, borders[-1], 4.0, *borders[1:-1]])[:, None]
    return Layouts(sides, np.array([True, False, True, False, *[True] * len(inner)])[:, None], lines)


def test_cells_lie_between_their_lines() -> None:
    assert row(0.0, 3.0, 8.0).cells()[:, :, 0].T.tolist() == [[0.0, 0.0, 3.0, 4.0], [3.0, 0.0, 8.0, 4.0]]


def test_some_of_several_layouts_can_be_taken() -> None:
    both = join_layouts([row(0.0, 3.0, 8.0), row(0.0, 5.0, 8.0)])
    assert both[np.array([1])].cells().tolist() == row(0.0, 5.0, 8.0).cells().tolist()


def test_moving_a_line_moves_the_rooms_at_both_sides() -> None:
    layout = row(0.0, 3.0, 8.0)
    lines = layout.lines.copy()
    lines[4] = 3.5
    assert layout.moved(lines).cells()[[2, 0], [0, 1], 0].tolist() == [3.5, 3.5]


@pytest.mark.parametrize(
    ("other", "length"),
    [
        ((4.0, 1.0, 7.0, 6.0), 3.0),
        ((1.0, 4.0, 9.0, 6.0), 3.0),
        ((4.0, 4.0, 7.0, 7.0), 0.0),
        ((4.5, 0.0, 7.0, 4.0), 0.0),
    ],
)
def test_cells_that_touch_have_a_wall_in_common(other: tuple[float, ...], length: float) -> None:
    cells = np.array([(0.0, 0.0, 4.0, 4.0), other]).T[:, :, None]
    assert common_walls(cells, np.array([0]), np.array([1])).item() == pytest.approx(length)
    assert common_walls(cells, np.array([1]), np.array([0])).item() == pytest.approx(length)


def layout(*cells: tuple[float, float, float, float]) -> Layouts:
    """Returns one layout in which every side of every cell is a line of its own, the outline's lines first."""
    boxes = np.array(cells)
    outline = [boxes[:, 0].min(), boxes[:, 1].min(), boxes[:, 2].max(), boxes[:, 3].max()]
    lines = np.array([*outline, *boxes.ravel()])
    sides = 4 + np.arange(boxes.size).reshape(boxes.shape)
    for side in range(4):
        sides[:, side] = np.where(boxes[:, side] == outline[side], side, sides[:, side])
    vertical = np.tile([True, False, True, False], len(boxes) + 1)
    return Layouts(sides[:, :, None], vertical[:, None], lines[:, None])


def cost(home: ResolvedTemplate, *cells: tuple[float, float, float, float]) -> float:
    return float(score(layout(*cells), demands_of(home))[0])


def square(side: float, x: float = 0.0, y: float = 0.0) -> tuple[float, float, float, float]:
    """Returns the cell whose floor is a square."""
    return (x, y, x + side + WALL_M, y + side + WALL_M)


PAIR = resolved(wish("A", area_m2=16.0), wish("B", area_m2=16.0))
SIDE_BY_SIDE = square(4.0), square(4.0, 4.0 + WALL_M)


def test_too_wide_and_too_deep_are_skewed_alike() -> None:
    np.testing.assert_allclose(skew(np.array([1.25, 0.8, 1.0])), [0.225, -0.225, 0.0])


@pytest.mark.parametrize(
    ("radius_m", "doors", "width_m"),
    [
        (0.05, False, 0.9),
        (0.25, False, 0.9),
        (0.25, True, 0.9),
        (0.33, False, 0.9),
        (0.35, False, 0.93),
        (0.35, True, 0.98),
        (0.351, False, 0.94),
        (0.45, False, 1.13),
        (0.6, True, 1.48),
    ],
)
def test_doorways_are_wide_enough_for_a_person_and_the_robot(radius_m: float, doors: bool, width_m: float) -> None:  # noqa: FBT001
    assert doorway_width(resolved(wish("A"), radius_m=radius_m, doors=doors)) == width_m


def test_connected_rooms_need_a_wall_for_all_their_doorways_and_jambs() -> None:
    demands = demands_of(resolved(wish("A"), wish("B"), wish("C"), connections=((0, 1), (0, 1)), openings=((1, 2),)))
    assert demands.pairs.T.tolist() == [[0, 1], [1, 2]]
    np.testing.assert_allclose(demands.shared_m - WALL_M, [0.1 + 2 * (0.9 + 0.1), 0.1 + OPENING_MIN_M + 0.1])


def test_openings_are_as_wide_as_the_robot_needs() -> None:
    demands = demands_of(resolved(wish("A"), wish("B"), openings=((0, 1),), radius_m=0.6, doors=True))
    assert demands.shared_m[0] - WALL_M == pytest.approx(0.1 + 1.48 + 0.1)


def test_rooms_as_wished_cost_nothing_but_the_outline() -> None:
    whole = resolved(wish("A", area_m2=16.0))
    assert cost(whole, square(4.0)) == 0.0
    assert 0.0 < cost(PAIR, *SIDE_BY_SIDE) < 2.0


def test_a_missed_shape_costs_more_than_one_just_within_the_tolerance() -> None:
    home = resolved(wish("A", area_m2=16.0, aspect=2.0))
    within, beyond = (cost(home, (0, 0, 4 * r + WALL_M, 4 / r + WALL_M)) for r in (1.27, 1.26))
    assert beyond - within > 2.0


def test_an_outspoken_shape_weighs_more_than_the_default() -> None:
    weights = demands_of(resolved(wish("A"), wish("B", aspect=2.0))).weight
    assert weights[1] > weights[0]
    assert (
        demands_of(resolved(wish("A"), footprint=2.0)).footprint_weight
        > demands_of(resolved(wish("A"))).footprint_weight
    )


def test_areas_beyond_the_limit_cost_more_than_a_missed_shape() -> None:
    home = resolved(wish("A", area_m2=16.0))
    assert cost(home, square(4.0 * 1.03**0.5)) > cost(home, (0.0, 0.0, 5.0 + WALL_M, 3.2 + WALL_M)) + 2.0


def test_a_sliver_costs_more_than_a_room_that_is_just_useful() -> None:
    home = resolved(wish("A", "Closet", 10.0), wish("B", "Closet", 10.0))
    useful, sliver = (
        cost(home, (0, 0, side + WALL_M, 10 / side + WALL_M), (side + WALL_M, 0, 10 + side, 10 / side + WALL_M))
        for side in (1.6, 1.5)
    )
    assert sliver - useful > 10.0


def test_hallways_may_be_narrower_than_rooms_and_slim_wishes_are_no_slivers() -> None:
    rooms = wish("A", "Hallway"), wish("B", "Closet"), wish("C", "Bedroom"), wish("D", "Bedroom", 10.0, 4.0)
    np.testing.assert_allclose(demands_of(resolved(*rooms)).slim_m, [1.2, 1.6, 2.13, 2.5**0.5])


def test_a_wished_connection_without_wall_costs_more_than_any_shape() -> None:
    wished = replace(PAIR, connections=resolved(*PAIR.rooms, connections=((0, 1),)).connections)
    corner = square(4.0), square(4.0, 4.0 + WALL_M, 3.5)
    assert cost(wished, *SIDE_BY_SIDE) < CONNECTION
    assert CONNECTION < cost(wished, *corner) % HARD < 2 * CONNECTION


def test_a_shorter_wall_for_a_connection_costs_more() -> None:
    wished = resolved(*PAIR.rooms, connections=((0, 1),) * 4)
    closer, apart = (cost(wished, square(4.0), square(4.0, 4.0 + WALL_M, y)) for y in (1.0, 2.0))
    assert apart - cost(PAIR, square(4.0), square(4.0, 4.0 + WALL_M, 2.0)) > closer - cost(
        PAIR, square(4.0), square(4.0, 4.0 + WALL_M, 1.0)
    )


def test_rooms_that_no_doorway_joins_are_unusable() -> None:
    assert cost(PAIR, square(4.0), square(4.0, 4.0 + WALL_M, 3.2)) >= HARD
    assert cost(PAIR, square(4.0), square(4.0, 4.0 + WALL_M, 2.7)) < HARD


def test_doorways_for_a_larger_robot_need_more_wall() -> None:
    cells = square(4.0), square(4.0, 4.0 + WALL_M, 2.7)
    assert cost(replace(PAIR, robot_radius_m=0.25), *cells) < HARD
    assert cost(replace(PAIR, robot_radius_m=0.6), *cells) >= HARD


def test_a_layout_without_a_place_for_the_start_is_unusable() -> None:
    home = resolved(wish("A", area_m2=16.0))
    assert cost(home, (0, 0, 8.0 + WALL_M, 2.0 + WALL_M)) >= HARD
    assert cost(home, (0, 0, 7.6 + WALL_M, 2.1 + WALL_M)) < HARD


def test_a_room_too_narrow_for_the_robot_is_unusable() -> None:
    cells = square(4.0), (4.0 + WALL_M, 0.0, 5.4 + 2 * WALL_M, 4.0 + WALL_M)
    assert cost(replace(PAIR, robot_radius_m=0.5), *cells) < HARD
    assert cost(replace(PAIR, robot_radius_m=0.6), *cells) >= HARD


def test_a_way_through_the_bathroom_costs_more_than_one_through_the_kitchen() -> None:
    rooms = wish("A", "Living", 16.0), wish("B", "Kitchen", 16.0), wish("C", "Bathroom", 16.0)
    row = [square(4.0, n * (4.0 + WALL_M)) for n in range(3)]
    good = cost(resolved(*rooms), *row)
    assert cost(resolved(*rooms), row[0], row[2], row[1]) >= good + 10.0


def test_a_way_through_the_bathroom_that_the_template_wishes_costs_nothing() -> None:
    rooms = (
        wish("A", "Living", 16.0),
        wish("B", "Kitchen", 16.0),
        wish("C", "Bathroom", 16.0),
        wish("D", "Closet", 16.0),
    )
    row = [square(4.0, n * (4.0 + WALL_M)) for n in range(4)]
    unsaid = cost(resolved(*rooms), *row)
    assert cost(resolved(*rooms, connections=((2, 3),)), *row) <= unsaid - 10.0


def test_a_bedroom_without_an_outer_wall_is_dark() -> None:
    around = [(0, 0, 6, 3), (6, 0, 9, 6), (3, 6, 9, 9), (0, 3, 3, 9)]
    rooms = [wish(name, "Closet", 15.0) for name in "ABCD"]
    dark, windowless = (
        cost(resolved(*rooms, wish("E", kind, 9.0)), *around, (3, 3, 6, 6)) for kind in ("Bedroom", "Hallway")
    )
    assert dark > windowless


def test_a_chain_is_connected_and_an_island_is_not() -> None:
    chain = np.zeros((6, 6), dtype=bool)
    for n in range(5):
        chain[n, n + 1] = chain[n + 1, n] = True
    island = chain.copy()
    island[2, 3] = island[3, 2] = False
    assert all_connected(np.stack([chain, island], axis=-1)).tolist() == [True, False]
