"""Which rooms a robot was in, and which it cannot get to, in the apartment of two rooms with a doorway of 0.9 m."""

import numpy as np
import pytest

from specs.data.world import FloorZone, World
from tasks.simulate.application.contract import Placement
from tasks.simulate.geometry.obstacles import obstacles
from tasks.simulate.geometry.rooms import RoomMap, Visit, room_map, rooms_entered, visit, visits
from tasks.simulate.geometry.world_arrays import floor_map
from tests.factories.worlds import PAINT, apartment, box

OPEN = apartment()
SHUT = OPEN.model_copy(update={"walls": (*OPEN.walls, box("leaf", (2.5, 0.05, 0.0), (2.6, 0.95, 2.0), PAINT))})
HERE = np.zeros((1, 2))
BEDSIDE, STOVE = (-1.5, 1.0), (4.0, 1.0)


def rooms_of(world: World, radius_m: float = 0.2) -> RoomMap:
    return room_map(world.rooms, floor_map(world, obstacles(world, 0.02, 0.38)), radius_m)


def went(world: World, *goals: tuple[float, float], radius_m: float = 0.2, arrived_m: float | None = 0.3) -> Visit:
    placement = Placement(np.zeros(3), np.array(goals or [BEDSIDE]), (), arrived_m)
    return visit(rooms_of(world, radius_m), placement, HERE, known_way=False)


def test_rooms_are_entered_in_the_order_in_which_the_way_comes_to_them():
    way = np.array([(4.0, 0.5), (2.55, 0.5), (1.0, 0.5), (4.0, 0.5)])
    assert rooms_entered(rooms_of(OPEN), way) == ("Kitchen", "Living room")


def test_zones_are_the_rooms_of_a_world_that_has_none():
    corner = FloorZone(name="corner", outline_m=((3.0, -1.0), (6.0, -1.0), (6.0, 2.0)), found=False)
    zoned = SHUT.model_copy(update={"rooms": (), "zones": (corner,)})
    rooms = room_map(zoned.areas, floor_map(zoned, obstacles(zoned, 0.02, 0.38)), 0.2)
    assert rooms_entered(rooms, np.array([(3.2, 1.5)])) == ()
    assert rooms_entered(rooms, np.array([(3.2, 1.5), (5.0, 0.5)])) == ("corner",)
    placement = Placement(np.zeros(3), np.array([BEDSIDE]), (), 0.3)
    assert visit(rooms, placement, HERE, known_way=False).unreachable == ("corner",)


def test_a_robot_in_the_doorway_is_in_no_room():
    assert rooms_entered(rooms_of(OPEN), np.array([(2.55, 0.5)])) == ()


def test_no_room_is_out_of_reach_through_an_open_doorway():
    assert went(OPEN).unreachable == ()


def test_a_room_behind_a_shut_door_is_out_of_reach():
    assert went(SHUT) == Visit(("Living room",), ("Kitchen",), 0)


@pytest.mark.parametrize(("radius_m", "unreachable"), [(0.44, ()), (0.56, ("Kitchen",))])
def test_a_doorway_keeps_out_a_robot_that_is_wider_and_no_other(radius_m: float, unreachable: tuple[str, ...]):
    assert went(OPEN, radius_m=radius_m).unreachable == unreachable


def test_a_room_that_a_robot_was_in_is_not_out_of_its_reach():
    placement = Placement(np.zeros(3), np.array([STOVE]), (), 0.3)
    assert visit(rooms_of(SHUT), placement, np.array([STOVE]), known_way=False).unreachable == ()


def test_goals_behind_a_shut_door_are_counted_as_out_of_reach():
    assert went(SHUT, BEDSIDE, STOVE, BEDSIDE).goals_reachable == 2


def test_all_goals_are_within_reach_where_a_way_to_them_is_known():
    placement = Placement(np.zeros(3), np.array([BEDSIDE, STOVE]), (), 0.3)
    assert visit(rooms_of(OPEN), placement, HERE, known_way=True).goals_reachable == 2


def test_goals_that_are_no_destinations_are_not_counted():
    assert went(SHUT, STOVE, arrived_m=None).goals_reachable is None


def test_episodes_that_are_looked_at_together_went_where_each_of_them_went():
    rooms, rng = rooms_of(SHUT), np.random.default_rng(4)
    ways = np.cumsum(rng.uniform(-0.5, 0.5, (20, 60, 2)), axis=1) + rng.uniform(-3.0, 5.0, (20, 1, 2))
    goals = [np.array([BEDSIDE, STOVE][: 1 + number % 2]) for number in range(20)]
    placements = [
        Placement(np.array([*way[0], 0.0]), goal, (), None if way[0, 0] > 3.0 else 0.3)
        for way, goal in zip(ways, goals, strict=True)
    ]
    known = [number % 3 == 0 for number in range(20)]
    alone = [
        visit(rooms, placement, way, known_way=each)
        for placement, way, each in zip(placements, ways, known, strict=True)
    ]
    assert visits(rooms, placements, ways, known) == alone
    assert len(set(alone)) > 5


def test_a_goal_that_counts_as_reached_from_anywhere_is_within_reach():
    assert went(SHUT, STOVE, arrived_m=1e308).goals_reachable == 0  # no way to all goals is known, so one is not
    assert went(OPEN, STOVE, BEDSIDE, arrived_m=1e308).goals_reachable == 1
