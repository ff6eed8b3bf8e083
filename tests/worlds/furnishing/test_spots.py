"""Places to try are at walls, in corners, beside what stands there, or in the middle of the room."""

import numpy as np
import pytest

from tasks.worlds.furnishing.groups import FurnitureGroup, Member, Zone
from tasks.worlds.furnishing.intervals import Spot, find_spots
from tasks.worlds.furnishing.scene import Piece, PlacedGroup, RoomScene
from tasks.worlds.furniture.furniture_type import Anchor
from tasks.worlds.geometry import Box
from tests.worlds.rooms import empty_scene

CABINET = FurnitureGroup((Member("Storage", (1.0, 0.6, 2.0)),), (), flush=True)


def rng() -> np.random.Generator:
    return np.random.default_rng(1)


def facing(quarter: int, spots: list[Spot]) -> list[Spot]:
    return [spot for spot in spots if spot.quarter == quarter]


def test_backs_stand_a_skirting_board_off_the_wall() -> None:
    spots = find_spots(rng(), empty_scene(5.0, 4.0), CABINET)
    south = facing(0, spots)
    assert len(south) > 4
    assert {spot.center[1] for spot in south} == {10.32}
    assert {spot.center[0] for spot in facing(1, spots)} == {14.68}


def test_both_ends_and_the_middle_of_each_wall_are_tried() -> None:
    spots = find_spots(rng(), empty_scene(5.0, 4.0), CABINET)
    assert {10.52, 12.5, 14.48} <= {spot.center[0] for spot in facing(0, spots)}


def test_only_the_corner_on_its_left_holds_a_group_wholly() -> None:
    spots = find_spots(rng(), empty_scene(5.0, 4.0), CABINET)
    held = {spot.center[0] for spot in facing(2, spots) if spot.held == 1.0}
    assert held == {14.48}  # facing south, one's left hand is in the east


def test_kitchen_units_are_tried_flush_beside_what_stands() -> None:
    scene = empty_scene(5.0, 4.0)
    body = Box(12.0, 10.02, 13.0, 10.62)
    scene.add(PlacedGroup((Piece("Storage", (1.0, 0.6, 2.0), (12.5, 10.32), 0, 0.0, body),), ()))
    assert {11.5, 13.5} <= {spot.center[0] for spot in facing(0, find_spots(rng(), scene, CABINET))}


def test_a_group_wider_than_a_wall_is_not_tried_there() -> None:
    wide = FurnitureGroup((Member("Storage", (3.0, 0.6, 2.0)),), ())
    assert {spot.quarter for spot in find_spots(rng(), empty_scene(2.5, 4.0), wide)} == {1, 3}


def test_a_group_that_faces_two_ways_is_tried_at_two_walls() -> None:
    group = FurnitureGroup(CABINET.members, (), quarters=(0, 2))
    assert {spot.quarter for spot in find_spots(rng(), empty_scene(), group)} == {0, 2}


def test_a_free_standing_group_is_tried_in_the_middle() -> None:
    group = FurnitureGroup((Member("DiningTables", (1.6, 0.9, 0.75)),), (), "center")
    spots = find_spots(rng(), empty_scene(5.0, 4.0), group)
    assert (12.5, 12.0) in {spot.center for spot in spots}
    assert all(spot.center[0] >= 10.0 + 0.45 for spot in spots)


@pytest.mark.parametrize("anchor", ["wall", "center"])
@pytest.mark.parametrize("seed", range(6))
def test_at_each_place_every_member_that_is_free_meets_nothing(seed: int, anchor: Anchor) -> None:
    beside = Member("Nightstands", (0.4, 0.4, 0.5), (1.0, -0.1), needed=False)
    group = FurnitureGroup((*CABINET.members, beside), (Zone(Box(-0.5, 0.3, 0.5, 0.9)),), anchor)
    draws = np.random.default_rng(seed)
    scene = empty_scene(5.0, 4.0, Box(14.0, 11.0, 15.0, 12.0))
    for x, y in draws.uniform((10.0, 10.0), (14.5, 13.5), (4, 2)).round(3).tolist():
        body = Box(x, y, x + 0.5, y + 0.5)
        scene.add(PlacedGroup((Piece("Ottomans", (0.5, 0.5, 0.4), body.center, 0, 0.0, body),), ()))
    taken = [piece.body for piece in scene.pieces]
    spots = find_spots(draws, scene, group)
    for spot in spots:
        *bodies, zone = (box.shifted(*spot.center) for box in group.turned(spot.quarter))
        assert not any(zone.meets(other) for other in taken)
        for body, free in zip(bodies, spot.free, strict=True):
            assert free is not any(body.meets(other) for other in (*taken, *scene.keep_clear)) or not _is_on(
                body, scene
            )
            assert not free or _is_on(body, scene)
    assert spots


def _is_on(body: Box, scene: RoomScene) -> bool:
    grown = scene.floor.grown(1e-6)
    return (
        grown.x_min <= body.x_min
        and body.x_max <= grown.x_max
        and grown.y_min <= body.y_min <= body.y_max <= grown.y_max
    )
