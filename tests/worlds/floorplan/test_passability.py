"""A bare plan is refused that keeps the robot from a room."""

from dataclasses import replace

from tasks.worlds.floorplan.passages import Gap
from tasks.worlds.floorplan.start import hindrance
from tasks.worlds.geometry.boxes import Box
from tests.worlds.briefs import brief, wish

CELLS = Box(0, 0, 4, 4), Box(4, 0, 8, 4), Box(8, 0, 9, 4)
HOME = brief(wish("Hall"), wish("Bath"), wish("Closet"))
GAPS = tuple(Gap((n, n + 1), "Doorway", (4.0 + 4 * n, 2.0), 0.9, "y", desired=True) for n in range(2))
START = (2.0, 2.0)


def test_nothing_hinders_a_robot_that_fits_everywhere() -> None:
    assert hindrance(HOME, CELLS, GAPS, START) == ""


def test_a_start_at_a_wall_has_no_clear_disc() -> None:
    assert "around the start" in hindrance(HOME, CELLS, GAPS, (1.0, 2.0))
    assert "around the start" in hindrance(HOME, CELLS, GAPS, None)


def test_a_room_without_a_way_to_it_is_named() -> None:
    assert hindrance(HOME, CELLS, GAPS[:1], START) == "no way leads to Closet"
    assert hindrance(HOME, CELLS, GAPS[1:], START) == "no way leads to Bath, Closet"


def test_a_room_narrower_than_the_robot_is_named_with_its_size() -> None:
    assert "Closet is 0.88 x 3.88 m" in hindrance(replace(HOME, robot_radius_m=0.35), CELLS, GAPS, START)


def test_a_gap_narrower_than_the_robot_needs_is_no_way() -> None:
    narrow = (GAPS[0], replace(GAPS[1], width=0.8))
    assert hindrance(HOME, CELLS, narrow, START) == "no way leads to Closet"
