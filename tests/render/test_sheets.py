"""What of the walls each room sees: all of its sides but the ways through and the windows."""

import pytest

from specs.data.world import Rectangle, World
from tasks.render.sheets import Panel, sides, wall_panels, windows_of
from tests.export.variants import NORTH_WINDOW, WEST_WINDOW, with_windows
from tests.factories.worlds import CEILING_M, apartment


@pytest.fixture(scope="module")
def world() -> World:
    return apartment()


def area_m2(panels: tuple[Panel, ...]) -> float:
    return sum((panel.end_m - panel.start_m) * (panel.top_m - panel.bottom_m) for panel in panels)


def test_a_room_sees_all_its_sides_but_the_doorway(world: World):
    # 5 x 4 m and 4 x 4 m; the doorway is 0.9 m wide and its lintel begins at 2.05 m.
    for room, around_m in zip(world.rooms, (18.0, 16.0), strict=True):
        assert area_m2(wall_panels(world, room)) == pytest.approx(around_m * CEILING_M - 0.9 * 2.05)


def test_the_lintel_above_a_doorway_is_seen(world: World):
    lintels = [panel for panel in wall_panels(world, world.rooms[0]) if panel.bottom_m == pytest.approx(2.05)]
    assert [(panel.start_m, panel.end_m) for panel in lintels] == [pytest.approx((0.05, 0.95))]


def test_a_window_is_left_out_of_its_own_side_alone(world: World):
    seen = with_windows(world)
    for room, window in zip(seen.rooms, (WEST_WINDOW, NORTH_WINDOW), strict=True):
        whole = area_m2(wall_panels(world, room))
        assert area_m2(wall_panels(seen, room)) == pytest.approx(whole - window.width_m * 1.2)


def test_a_window_is_in_the_side_of_its_room_that_is_next_to_it(world: World):
    seen = with_windows(world)
    ((west, _),) = windows_of(seen, seen.rooms[0])
    ((north, _),) = windows_of(seen, seen.rooms[1])
    assert (west.along, west.at_m, west.inwards) == ("y", -2.5, 1)
    assert (north.along, north.at_m, north.inwards) == ("x", 2.0, -1)


def test_panels_lie_in_the_sides_of_their_room(world: World):
    for room in world.rooms:
        for panel in wall_panels(with_windows(world), room):
            assert panel.side in sides(room.floor)
            assert panel.side.start_m <= panel.start_m < panel.end_m <= panel.side.end_m


def test_a_wall_that_stands_elsewhere_is_not_seen(world: World):
    walls = tuple(wall for wall in world.walls if wall.name != "wall-3")
    bare = world.model_copy(update={"walls": walls})
    lost = area_m2(wall_panels(world, world.rooms[0])) - area_m2(wall_panels(bare, bare.rooms[0]))
    assert lost == pytest.approx(4.0 * CEILING_M)


def test_sides_face_inwards():
    floor = Rectangle(x_min_m=0.0, y_min_m=0.0, x_max_m=2.0, y_max_m=1.0)
    inner = [side.point_m((side.start_m + side.end_m) / 2, 0.1) for side in sides(floor)]
    assert inner == [pytest.approx(point) for point in ((1.0, 0.1), (1.0, 0.9), (0.1, 0.5), (1.9, 0.5))]
