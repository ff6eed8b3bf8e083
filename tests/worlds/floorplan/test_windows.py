"""Windows light the rooms that want light, from outer walls."""

from itertools import pairwise

import pytest

from specs.data.world import RoomType
from tasks.worlds.floorplan.floorplan import GLAZING_SHARE, Pane, place_windows, plan_floor
from tasks.worlds.geometry import EPSILON_M, Box
from tests.worlds.briefs import brief, flat, wish

HABITABLE: tuple[RoomType, ...] = ("Bedroom", "Living", "Dining", "Kitchen")


def windows(kind: RoomType, *cells: Box) -> list[Pane]:
    """Returns the windows of the first of several rooms."""
    home = brief(wish("It", kind), *(wish(f"Closet {n}", "Closet") for n in range(len(cells) - 1)))
    return [pane for pane in place_windows(home, cells) if pane.room == 0]


def glazing(panes: list[Pane]) -> float:
    return sum(pane.width * (pane.top - pane.bottom) for pane in panes)


@pytest.mark.parametrize("kind", HABITABLE)
@pytest.mark.parametrize("side", [3.0, 5.0, 9.0, 17.0])
def test_habitable_rooms_are_glazed_by_8_percent_of_their_floor(kind: RoomType, side: float) -> None:
    cell = Box(0, 0, side, side)
    panes = windows(kind, cell)
    assert GLAZING_SHARE * cell.grown(-0.06).area <= glazing(panes) < 0.12 * cell.area + 0.3
    assert max(pane.width for pane in panes) <= 2.0


@pytest.mark.parametrize(
    ("kind", "sill"), [("Bedroom", 0.9), ("Living", 0.9), ("Kitchen", 1.1), ("Bathroom", 1.5), ("Hallway", 0.9)]
)
def test_sills_are_above_a_lidar_above_worktops_and_in_bathrooms_above_eyes(kind: RoomType, sill: float) -> None:
    assert {(pane.bottom, pane.top) for pane in windows(kind, Box(0, 0, 4, 4))} == {(sill, 2.1)}


def test_a_bathroom_and_a_hallway_have_one_small_window() -> None:
    for kind in ("Bathroom", "Hallway"):
        (pane,) = windows(kind, Box(0, 0, 6, 6))
        assert pane.width == 0.6
        assert glazing([pane]) >= 0.3


def test_a_closet_has_no_window() -> None:
    assert windows("Closet", Box(0, 0, 4, 4)) == []


def test_a_room_without_an_outer_wall_has_no_window() -> None:
    around = [Box(0, 0, 6, 3), Box(6, 0, 9, 6), Box(3, 6, 9, 9), Box(0, 3, 3, 9)]
    assert windows("Bedroom", Box(3, 3, 6, 6), *around) == []


def test_walls_that_are_too_short_get_as_much_glass_as_they_hold() -> None:
    # Eight percent would be 2.7 m2; the one outer wall is 1.5 m long.
    (pane,) = windows("Living", Box(0, 0, 1.5, 24), Box(-4, 0, 0, 24), Box(1.5, 0, 6, 24), Box(-4, -3, 6, 0))
    # Two walls and what is left standing beside the window take 0.72 m.
    assert (pane.center[1], pane.width) == (24, 0.7)


def test_windows_keep_clear_of_corners_and_of_each_other() -> None:
    panes = windows("Living", Box(0, 0, 10, 8))
    spans = sorted((pane.center[0] - pane.width / 2, pane.center[0] + pane.width / 2) for pane in panes)
    assert len(spans) > 1
    assert spans[0][0] >= 0.06 + 0.3 - 1e-9
    assert spans[-1][1] <= 10 - 0.06 - 0.3 + 1e-9
    assert all(right[0] - left[1] >= 0.3 - 1e-9 for left, right in pairwise(spans))


def test_windows_of_a_plan_lie_in_the_outer_wall_of_their_room() -> None:
    for seed in range(10):
        plan = plan_floor(flat(), seed, 1)
        outline = plan.footprint.grown(-0.06)
        assert {pane.room for pane in plan.windows} >= {1, 2, 3, 4}
        for pane in plan.windows:
            axis = 0 if pane.along == "x" else 1
            across, floor = 1 - axis, plan.floors[pane.room]
            assert min(abs(pane.center[across] - outline[side]) for side in (across, across + 2)) < EPSILON_M
            assert abs(pane.center[across] - plan.cells[pane.room][across]) < EPSILON_M or (
                abs(pane.center[across] - plan.cells[pane.room][across + 2]) < EPSILON_M
            )
            assert pane.center[axis] - pane.width / 2 >= floor[axis] + 0.3 - 1e-6
            assert pane.center[axis] + pane.width / 2 <= floor[axis + 2] - 0.3 + 1e-6


def test_a_moved_window_keeps_its_size() -> None:
    pane = Pane(0, (2.0, 0.0), 1.2, "x", 0.9, 2.1)
    assert pane.shifted(-0.5, 1.25) == Pane(0, (1.5, 1.25), 1.2, "x", 0.9, 2.1)
