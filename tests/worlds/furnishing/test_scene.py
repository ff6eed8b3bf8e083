"""A room has lines at which backs stand, and remembers what stands in it."""

import pytest

from tasks.worlds.floorplan.floorplan import Pane
from tasks.worlds.furnishing.scene import Piece, PlacedGroup, open_scene, way_width
from tasks.worlds.geometry import Box
from tests.worlds.rooms import ROBOT_M, empty_scene

BODY = Box(11.0, 11.0, 12.0, 12.0)
BODY_ALONG_Y = (11.0, 12.0, 11.0, 12.0)
ZONE = Box(11.0, 12.0, 12.0, 13.0)
PLACED = PlacedGroup((Piece("Sofas", (1.0, 1.0, 0.8), (11.5, 11.5), 0, 0.0, BODY),), (ZONE,))


def test_a_small_room_has_its_four_walls_for_lines() -> None:
    lines = empty_scene(5.0, 4.0).lines
    assert all(line.wall for line in lines)
    assert [line.quarter for line in lines] == [0, 1, 2, 3]
    assert [line.at for line in lines] == [10.0, 15.0, 14.0, 10.0]


def test_a_hall_has_lines_in_its_middle_that_end_before_its_walls() -> None:
    middle = [line for line in empty_scene(17.0, 17.0).lines if not line.wall]
    assert len(middle) >= 8
    assert all(line.start >= 11.0 for line in middle)
    assert all(line.end <= 26.0 for line in middle)
    assert sorted({line.quarter for line in middle}) in ([0, 2], [1, 3])


def test_a_way_is_wide_enough_for_the_robot_and_its_play() -> None:
    assert 2 * ROBOT_M < way_width(ROBOT_M) < 2 * ROBOT_M + 0.3


def test_what_stands_is_taken_before_its_zones_and_the_floor_before_doors() -> None:
    door = Box(13.0, 10.0, 14.0, 10.9)
    scene = empty_scene(5.0, 4.0, door)
    scene.add(PLACED)
    along_x, along_y = scene.taken
    assert along_y.whole == [BODY_ALONG_Y, (ZONE.x_min, ZONE.x_max, ZONE.y_min, ZONE.y_max), (13.0, 14.0, 10.0, 10.9)]
    assert along_x.whole[0] == (BODY.y_min, BODY.y_max, BODY.x_min, BODY.x_max)
    assert len(along_x.pieces) == 1
    assert scene.count("Sofas") == 1


def test_what_only_touches_something_does_not_meet_its_inside() -> None:
    scene = empty_scene()
    scene.add(PLACED)
    near, far, start, end = scene.taken[1].inside[0]
    assert BODY.x_min < near < BODY.x_min + 1e-5
    assert BODY.x_max - 1e-5 < far < BODY.x_max
    assert BODY.y_min < start
    assert end < BODY.y_max


def test_what_is_removed_is_gone_with_its_zones() -> None:
    scene = empty_scene()
    scene.add(PLACED)
    assert len(scene.taken[0].whole) == 2
    assert scene.remove(0) == PLACED
    assert scene.taken[0].whole == []
    assert scene.pieces == []
    assert scene.count("Sofas") == 0


@pytest.mark.parametrize(
    ("pane", "quarter", "zone"),
    [
        (Pane(0, (2.0, -0.06), 1.0, "x", 0.9, 2.1), 0, (1.5, 0.0, 2.5, 0.6)),
        (Pane(0, (2.0, 4.06), 1.0, "x", 0.9, 2.1), 2, (1.5, 3.4, 2.5, 4.0)),
        (Pane(0, (-0.06, 2.0), 1.0, "y", 0.9, 2.1), 3, (0.0, 1.5, 0.6, 2.5)),
        (Pane(0, (5.06, 2.0), 1.0, "y", 0.9, 2.1), 1, (4.4, 1.5, 5.0, 2.5)),
    ],
)  # fmt: skip
def test_a_window_keeps_the_floor_below_it(pane: Pane, quarter: int, zone: tuple[float, ...]) -> None:
    (sill,) = open_scene(Box(0.0, 0.0, 5.0, 4.0), (), ROBOT_M, [pane]).sills
    assert sill.quarter == quarter
    assert sill.zone == pytest.approx(zone)


def test_the_start_matters_where_its_disc_reaches() -> None:
    assert open_scene(Box(0.5, 0.5, 5.0, 4.0), (), ROBOT_M).holds_start
    assert not open_scene(Box(1.1, 0.5, 5.0, 4.0), (), ROBOT_M).holds_start
