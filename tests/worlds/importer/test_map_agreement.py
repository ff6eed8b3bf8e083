"""How an imported world agrees with a map of the same place."""

import numpy as np
import pytest

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
