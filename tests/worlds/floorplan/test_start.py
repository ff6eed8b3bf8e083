"""The robot starts where one would put it down."""

import math

import numpy as np
import pytest

from specs.data.world import RoomType
from tasks.worlds.brief import Brief
from tasks.worlds.floorplan.passages import Gap
from tasks.worlds.floorplan.start import START_CLEAR_M, choose_start
from tasks.worlds.geometry.boxes import Box
from tests.worlds.briefs import brief, wish

WEST, EAST = Box(0, 0, 4, 4), Box(4, 0, 10, 4)
DOORWAY = Gap((0, 1), "Doorway", (4.0, 0.61), 0.9, "y", desired=True)
SEEDS = range(20)


def start(home: Brief, *cells: Box, gaps: tuple[Gap, ...] = (DOORWAY,), seed: int = 0) -> tuple[float, float] | None:
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
