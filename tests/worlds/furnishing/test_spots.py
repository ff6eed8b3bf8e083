"""Places to try are at walls, in corners, beside what stands there, or in the middle of the room."""

import numpy as np

from tasks.worlds.furnishing.groups.group import FurnitureGroup, Member
from tasks.worlds.furnishing.scene import Piece, PlacedGroup
from tasks.worlds.furnishing.spots import find_spots
from tasks.worlds.geometry.boxes import Box
from tests.worlds.rooms import empty_scene

CABINET = FurnitureGroup((Member("Storage", (1.0, 0.6, 2.0)),), (), flush=True)


def rng() -> np.random.Generator:
    return np.random.default_rng(1)


def test_backs_stand_a_skirting_board_off_the_wall() -> None:
    spots = find_spots(rng(), empty_scene(5.0, 4.0), CABINET)
    south = spots.centers[spots.quarters == 0]
    assert len(south) > 4
    np.testing.assert_allclose(south[:, 1], 10.32)
    np.testing.assert_allclose(spots.centers[spots.quarters == 1][:, 0], 14.68)


def test_both_ends_and_the_middle_of_each_wall_are_tried() -> None:
    spots = find_spots(rng(), empty_scene(5.0, 4.0), CABINET)
    south = spots.centers[spots.quarters == 0][:, 0].tolist()
    assert {10.52, 12.5, 14.48} <= set(south)


def test_only_the_corner_on_its_left_holds_a_group_wholly() -> None:
    spots = find_spots(rng(), empty_scene(5.0, 4.0), CABINET)
    held = spots.centers[(spots.quarters == 2) & (spots.held == 1.0)]
    np.testing.assert_allclose(held[:, 0], 14.48)  # facing south, one's left hand is in the east


def test_kitchen_units_are_tried_flush_beside_what_stands() -> None:
    scene = empty_scene(5.0, 4.0)
    body = Box(12.0, 10.02, 13.0, 10.62)
    scene.add(PlacedGroup((Piece("Storage", (1.0, 0.6, 2.0), (12.5, 10.32), 0, 0.0, body),), ()))
    south = find_spots(rng(), scene, CABINET)
    assert {11.5, 13.5} <= set(south.centers[south.quarters == 0][:, 0].tolist())


def test_a_group_wider_than_a_wall_is_not_tried_there() -> None:
    wide = FurnitureGroup((Member("Storage", (3.0, 0.6, 2.0)),), ())
    assert set(find_spots(rng(), empty_scene(2.5, 4.0), wide).quarters.tolist()) == {1, 3}


def test_a_group_that_faces_two_ways_is_tried_at_two_walls() -> None:
    group = FurnitureGroup(CABINET.members, (), quarters=(0, 2))
    assert set(find_spots(rng(), empty_scene(), group).quarters.tolist()) == {0, 2}


def test_a_free_standing_group_is_tried_in_the_middle() -> None:
    group = FurnitureGroup((Member("DiningTables", (1.6, 0.9, 0.75)),), (), "center")
    spots = find_spots(rng(), empty_scene(5.0, 4.0), group)
    assert [12.5, 12.0] in spots.centers.tolist()
    assert (spots.centers[:, 0] >= 10.0 + 0.45).all()
