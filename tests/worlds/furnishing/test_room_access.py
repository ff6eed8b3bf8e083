"""A robot gets from each way in to every other, and to nearly all of the floor."""

import pytest

from tasks.worlds.furnishing.placement import robot_gets_around
from tasks.worlds.geometry import Box

FLOOR = Box(0.0, 0.0, 5.0, 4.0)
WEST, EAST = (0.0, 2.0), (5.0, 2.0)
RADIUS_M = 0.25


def test_an_empty_room_is_open() -> None:
    assert robot_gets_around(FLOOR, [], [WEST, EAST], RADIUS_M)


def test_a_row_across_the_room_shuts_it() -> None:
    row = Box(2.0, 0.0, 2.6, 4.0)
    assert not robot_gets_around(FLOOR, [row], [WEST, EAST], RADIUS_M)


@pytest.mark.parametrize(("radius_m", "passable"), [(0.25, True), (0.32, False)])
def test_a_row_with_a_gap_lets_a_robot_through_that_is_thin_enough(radius_m: float, *, passable: bool) -> None:
    row = Box(2.0, 0.0, 2.6, 3.25)
    assert robot_gets_around(FLOOR, [row], [WEST, EAST], radius_m) is passable


def test_much_floor_behind_furniture_shuts_the_room_too() -> None:
    assert not robot_gets_around(FLOOR, [Box(3.0, 0.0, 3.5, 4.0)], [WEST], RADIUS_M)


def test_a_pocket_does_not() -> None:
    assert robot_gets_around(FLOOR, [Box(4.1, 0.0, 4.3, 4.0)], [WEST], RADIUS_M)


def test_a_way_in_that_is_blocked_shuts_the_room() -> None:
    assert not robot_gets_around(FLOOR, [Box(0.2, 1.5, 0.8, 2.5)], [WEST, EAST], RADIUS_M)


def test_a_room_that_is_too_narrow_holds_nothing() -> None:
    narrow = Box(0.0, 0.0, 0.6, 4.0)
    assert robot_gets_around(narrow, [], [(0.3, 0.0)], RADIUS_M)
    assert not robot_gets_around(narrow, [Box(0.0, 0.0, 0.3, 0.3)], [(0.3, 0.0)], RADIUS_M)
