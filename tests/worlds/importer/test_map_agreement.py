"""How an imported world agrees with a map of the same place."""

import numpy as np
import pytest
from jaxtyping import Float64

from specs.data.world import Solid
from tasks.worlds.importer.map_agreement import FloorMap, agreement


def wall(x: float, y: float, half_x: float, half_y: float, z: float = 0.5) -> Solid:
    return Solid(
        name=f"w{x}{y}",
        shape="box",
        center_m=(x, y, z),
        half_extents_m=(half_x, half_y, 0.5),
        yaw_rad=0.0,
        color=(0.5, 0.5, 0.5),
    )


def floor_map(turn: float = 0.0) -> FloorMap:
    """Returns a map of 2 m x 2 m of floor in a wall of a cell."""
    free = np.zeros((42, 42), dtype=bool)
    free[1:-1, 1:-1] = True
    origin = (0.0, 0.0) if not turn else (2.1, 0.0)
    return FloorMap("map.yaml", ~free, free, 0.05, (*origin, turn))


WALLS = (wall(1.05, 0.025, 1.05, 0.025), wall(1.05, 2.075, 1.05, 0.025), wall(0.025, 1.05, 0.025, 1.05))
LAST = wall(2.075, 1.05, 0.025, 1.05)


@pytest.mark.parametrize("turn", [0.0, np.pi / 2])
def test_a_world_of_a_map_s_own_walls_agrees_with_it(turn: float):
    found = agreement((*WALLS, LAST), floor_map(turn))
    assert (found.map, found.within_5cm, found.free_iou) == ("map.yaml", 1.0, 1.0)
    assert found.mean_m <= 0.025


def test_a_wall_that_is_missing_or_elsewhere_costs_its_share():
    found = agreement((*WALLS, wall(1.5, 1.05, 0.025, 1.05)), floor_map())
    assert 0.7 < found.within_5cm < 0.8
    assert 0.9 < found.free_iou < 0.98


def test_what_is_above_the_cut_is_not_compared():
    above = wall(1.0, 1.0, 0.5, 0.5, z=1.0)
    assert agreement((*WALLS, LAST, above), floor_map()) == agreement((*WALLS, LAST), floor_map())


def test_a_world_is_cut_where_the_lidar_of_the_map_was():
    low = wall(1.5, 1.05, 0.025, 1.05).model_copy(
        update={"center_m": (1.5, 1.05, 0.1), "half_extents_m": (0.1, 1.0, 0.1)}
    )
    found = agreement((*WALLS, LAST, low), floor_map())
    assert found.height_m == 0.13, "a low thing takes some floor, and no border: the usual height is as good"
    kerb = [
        each.model_copy(
            update={"center_m": (*each.center_m[:2], 0.6), "half_extents_m": (*each.half_extents_m[:2], 0.33)}
        )
        for each in (*WALLS, LAST)
    ]
    assert (agreement(kerb, floor_map()).height_m, agreement(kerb, floor_map()).within_5cm) == (0.3, 1.0)


def test_floor_that_nobody_gets_to_is_not_compared():
    known = floor_map()
    free = known.free.copy()
    free[:, 40] = False
    within_walls = free.copy()
    within_walls[1:-1, 41] = True
    both = [known._replace(free=each, occupied=~each) for each in (free, within_walls)]
    walls = (*WALLS, wall(2.05, 1.05, 0.05, 1.05))
    assert [agreement(walls, each).free_iou for each in both] == [1.0, 1.0]


def test_an_empty_cut_agrees_with_nothing():
    found = agreement((), floor_map())
    assert (found.within_5cm, found.mean_m) == (0.0, 0.0)


ROOM = (*WALLS, LAST, wall(0.6, 0.5, 0.2, 0.05), wall(1.4, 1.6, 0.05, 0.3))


def turned(angle: float) -> Float64[np.ndarray, "2 2"]:
    """Returns what turns places by an angle."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def drawn(solids: tuple[Solid, ...]) -> FloorMap:
    """Returns the map that a robot would make of these solids within the walls, in their frame."""
    middle = 0.05 * (np.arange(42) + 0.5)
    x, y = np.meshgrid(middle, middle)
    taken = [
        (np.abs(x - each.center_m[0]) <= each.half_extents_m[0])
        & (np.abs(y - each.center_m[1]) <= each.half_extents_m[1])
        for each in solids
    ]
    occupied = np.logical_or.reduce(taken)
    return FloorMap("map.yaml", occupied, ~occupied, 0.05, (0.0, 0.0, 0.0))


@pytest.mark.parametrize(("x", "y", "turn"), [(0.37, -0.21, 0.0), (-6.0, 4.5, np.pi / 2 + 0.03), (3.0, 3.0, np.pi)])
def test_a_map_in_the_frame_of_where_its_robot_began_is_found(x: float, y: float, turn: float):
    """What is told moves the map back, turned first: to a cell, which is as thick as the walls."""
    origin_x, origin_y = turned(-turn) @ [-x, -y]
    lies = drawn(ROOM)._replace(origin=(float(origin_x), float(origin_y), -turn))
    found = agreement(ROOM, lies)
    assert found.within_5cm > 0.95
    assert found.free_iou > 0.97
    assert found.moved is not None
    corners = np.array([[0.0, 0.0], [2.1, 0.0], [2.1, 2.1], [0.0, 2.1]])
    in_map = (corners - [x, y]) @ turned(-turn).T
    there = in_map @ turned(found.moved.yaw_rad).T + [found.moved.x_m, found.moved.y_m]
    np.testing.assert_allclose(there, corners, atol=0.06)


def test_a_map_of_another_place_is_moved_nowhere():
    rng = np.random.default_rng(3)
    occupied = rng.random((80, 80)) < 0.1
    found = agreement(ROOM, FloorMap("map.yaml", occupied, ~occupied, 0.05, (0.0, 0.0, 0.0)))
    assert found.moved is None
    assert not found.same_place


def test_a_map_that_is_too_large_to_be_looked_for_is_compared_as_it_lies():
    far = drawn(ROOM)._replace(resolution_m=500.0)
    assert agreement(ROOM, far).moved is None
