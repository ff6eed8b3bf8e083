"""The robot starts where one would put it down, and a bare plan is refused that keeps it from a room."""

import math
from dataclasses import replace

import numpy as np
import pytest

from specs.data.world import RoomType
from tasks.worlds.floorplan.passages import START_CLEAR_M, Gap, choose_start, hindrance
from tasks.worlds.geometry import Box
from tasks.worlds.resolved_template import ResolvedTemplate
from tests.worlds.briefs import brief, wish

WEST, EAST = Box(0, 0, 4, 4), Box(4, 0, 10, 4)
DOORWAY = Gap((0, 1), "Doorway", (4.0, 0.61), 0.9, "y", desired=True)
SEEDS = range(20)


def start(
    home: ResolvedTemplate, *cells: Box, gaps: tuple[Gap, ...] = (DOORWAY,), seed: int = 0
) -> tuple[float, float] | None:
    return choose_start(np.random.default_rng(seed), home, cells, gaps)


def room_of(spot: tuple[float, float] | None, *cells: Box) -> int:
    assert spot is not None
    return next(
        n for n, cell in enumerate(cells) if cell.x_min < spot[0] < cell.x_max and cell.y_min < spot[1] < cell.y_max
    )


@pytest.mark.parametrize(
    ("kinds", "room"),
    [
        (("Hallway", "Bedroom"), 0),
        (("Bedroom", "Living"), 1),
        (("Kitchen", "Bathroom"), 0),
        (("Bedroom", "Closet"), 0),
        (("Living", "Living"), 1),
        (("Bathroom", "Closet"), 1),
    ],
)
def test_it_is_the_most_public_room_and_of_two_alike_the_larger(kinds: tuple[RoomType, RoomType], room: int) -> None:
    home = brief(*(wish(kind, kind) for kind in kinds))
    assert {room_of(start(home, WEST, EAST, seed=seed), WEST, EAST) for seed in SEEDS} == {room}


def test_a_hall_that_is_too_narrow_is_passed_over() -> None:
    hall = Box(0, 4, 10, 6.1)
    home = brief(wish("A", "Bathroom"), wish("B", "Bedroom"), wish("C", "Hallway"))
    assert room_of(start(home, WEST, EAST, hall), WEST, EAST, hall) == 1


def test_without_a_room_for_the_disc_there_is_no_start() -> None:
    assert start(brief(wish("A")), Box(0, 0, 9, 2.1), gaps=()) is None


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("doors", [False, True])
def test_the_disc_keeps_off_the_walls_also_in_the_narrowest_room(seed: int, doors: bool) -> None:  # noqa: FBT001
    for cells in ((WEST, EAST), (Box(0, 0, 4, 4), Box(4, 0, 10, 2.22))):
        home = brief(wish("A", "Closet"), wish("B", "Hallway"), doors=doors)
        spot = start(home, *cells, seed=seed)
        assert spot is not None
        floor = cells[1].grown(-0.06)
        assert min(spot[0] - floor.x_min, floor.x_max - spot[0]) >= START_CLEAR_M - 1e-9
        assert min(spot[1] - floor.y_min, floor.y_max - spot[1]) >= START_CLEAR_M - 1e-9


def test_it_is_near_a_way_out() -> None:
    home = brief(wish("A", "Closet"), wish("B", "Hallway"))
    spots = [start(home, WEST, EAST, seed=seed) for seed in SEEDS]
    assert max(math.dist(spot, DOORWAY.center) for spot in spots if spot) < 2.0


def test_a_leaf_can_open_without_touching_the_disc() -> None:
    home = brief(wish("A", "Closet"), wish("B", "Hallway"), doors=True)
    for seed in SEEDS:
        spot = start(home, WEST, EAST, seed=seed)
        assert spot is not None
        swing = DOORWAY.box(DOORWAY.width)
        beyond = max(spot[0] - swing.x_max, 0.0), max(spot[1] - swing.y_max, 0.0)
        assert math.hypot(*beyond) >= START_CLEAR_M


def test_starts_are_whole_centimetres_and_the_same_for_the_same_stream() -> None:
    home = brief(wish("A", "Closet"), wish("B", "Hallway"))
    spot = start(home, WEST, EAST, seed=3)
    assert spot == start(home, WEST, EAST, seed=3)
    assert spot == tuple(round(side, 2) for side in spot or ())


THREE_CELLS = Box(0, 0, 4, 4), Box(4, 0, 8, 4), Box(8, 0, 9, 4)
THREE_ROOMS = brief(wish("Hall"), wish("Bath"), wish("Closet"))
TWO_GAPS = tuple(Gap((n, n + 1), "Doorway", (4.0 + 4 * n, 2.0), 0.9, "y", desired=True) for n in range(2))
MIDDLE = (2.0, 2.0)


def test_nothing_hinders_a_robot_that_fits_everywhere() -> None:
    assert hindrance(THREE_ROOMS, THREE_CELLS, TWO_GAPS, MIDDLE) == ""


def test_a_start_at_a_wall_has_no_clear_disc() -> None:
    assert "around the start" in hindrance(THREE_ROOMS, THREE_CELLS, TWO_GAPS, (1.0, 2.0))
    assert "around the start" in hindrance(THREE_ROOMS, THREE_CELLS, TWO_GAPS, None)


def test_a_room_without_a_way_to_it_is_named() -> None:
    assert hindrance(THREE_ROOMS, THREE_CELLS, TWO_GAPS[:1], MIDDLE) == "no way leads to Closet"
    assert hindrance(THREE_ROOMS, THREE_CELLS, TWO_GAPS[1:], MIDDLE) == "no way leads to Bath, Closet"


def test_a_room_narrower_than_the_robot_is_named_with_its_size() -> None:
    assert "Closet is 0.88 x 3.88 m" in hindrance(
        replace(THREE_ROOMS, robot_radius_m=0.35), THREE_CELLS, TWO_GAPS, MIDDLE
    )


def test_a_gap_narrower_than_the_robot_needs_is_no_way() -> None:
    narrow = (TWO_GAPS[0], replace(TWO_GAPS[1], width=0.8))
    assert hindrance(THREE_ROOMS, THREE_CELLS, narrow, MIDDLE) == "no way leads to Closet"
