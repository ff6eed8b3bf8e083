"""A group stands where it suits best, and a robot still gets around."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tasks.worlds.floorplan.floorplan import Pane
from tasks.worlds.furnishing.groups import FurnitureGroup, Member, Zone, front_zone
from tasks.worlds.furnishing.placement import place_group, robot_gets_around, turn_quarters
from tasks.worlds.furnishing.scene import Piece, PlacedGroup, RoomScene, open_scene
from tasks.worlds.furniture.furniture_type import Taste
from tasks.worlds.geometry import Box
from tests.worlds.rooms import ROBOT_M, empty_scene

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


TASTE_SEEDS = range(6)


def stand_by_taste(scene: RoomScene, taste: Taste, seed: int, kind: str = "Dressers") -> Piece:
    group = FurnitureGroup((Member(kind, (1.0, 0.5, 0.8)),), (), taste=replace(taste, chance=0.1))
    found = place_group(np.random.default_rng(seed), scene, group)
    assert found is not None
    return found.pieces[0]


@pytest.mark.parametrize("seed", TASTE_SEEDS)
def test_who_likes_corners_stands_in_one(seed: int) -> None:
    piece = stand_by_taste(empty_scene(5.0, 4.0), Taste(corner=1.0), seed)
    x, y = min(piece.body.x_min - 10.0, 15.0 - piece.body.x_max), min(piece.body.y_min - 10.0, 14.0 - piece.body.y_max)
    assert max(x, y) == pytest.approx(0.02)


@pytest.mark.parametrize("seed", TASTE_SEEDS)
def test_who_likes_the_middle_stands_there(seed: int) -> None:
    piece = stand_by_taste(empty_scene(5.0, 4.0), Taste(middle=1.0), seed)
    middle = (12.5, 12.0)[piece.quarter % 2]
    assert piece.center[piece.quarter % 2] == pytest.approx(middle, abs=0.3)


@pytest.mark.parametrize("seed", TASTE_SEEDS)
def test_who_likes_light_stands_below_the_window(seed: int) -> None:
    lit = open_scene(empty_scene(5.0, 4.0).floor, (), 0.25, [Pane(0, (11.5, 14.06), 1.2, "x", 0.9, 2.1)])
    piece = stand_by_taste(lit, Taste(window=1.0, middle=0.2), seed)
    assert piece.quarter == 2
    assert piece.center[0] < 12.6


@pytest.mark.parametrize("seed", TASTE_SEEDS)
def test_who_likes_company_stands_near_it(seed: int) -> None:
    scene = empty_scene(8.0, 4.0)
    scene.add(PlacedGroup((Piece("Beds", (1.0, 2.0, 1.0), (10.6, 11.1), 0, 0.0, Box(10.1, 10.1, 11.1, 12.1)),), ()))
    piece = stand_by_taste(scene, Taste(near=("Beds",)), seed)
    assert piece.center[0] < 13.0


@pytest.mark.parametrize("seed", TASTE_SEEDS)
def test_lamps_keep_away_from_lamps(seed: int) -> None:
    scene = empty_scene(8.0, 4.0)
    scene.add(
        PlacedGroup((Piece("FloorLamps", (0.4, 0.4, 1.6), (10.3, 10.3), 0, 0.0, Box(10.1, 10.1, 10.5, 10.5)),), ())
    )
    piece = stand_by_taste(scene, Taste(apart=True), seed, "FloorLamps")
    assert np.hypot(piece.center[0] - 10.3, piece.center[1] - 10.3) > 2.5


@pytest.mark.parametrize("seed", TASTE_SEEDS)
def test_a_screen_stands_across_from_the_sofa(seed: int) -> None:
    scene = empty_scene(5.0, 4.0)
    scene.add(PlacedGroup((Piece("Sofas", (2.0, 0.9, 0.8), (12.5, 10.5), 0, 0.0, Box(11.5, 10.02, 13.5, 10.92)),), ()))
    piece = stand_by_taste(scene, Taste(facing="Sofas"), seed)
    assert piece.quarter == 2
    assert piece.center[0] == pytest.approx(12.5, abs=0.5)


@pytest.mark.parametrize("seed", TASTE_SEEDS)
def test_nobody_stands_in_the_middle_of_a_room_while_walls_are_free(seed: int) -> None:
    piece = stand_by_taste(empty_scene(8.0, 8.0), Taste(), seed)
    assert min(piece.body.x_min - 10, 18 - piece.body.x_max, piece.body.y_min - 10, 18 - piece.body.y_max) < 0.03


SEEDS = range(8)
CABINET = FurnitureGroup((Member("Storage", (1.0, 0.6, 2.0)),), (front_zone((1.0, 0.6, 2.0), 0.8),))
STANDS = tuple(Member("Nightstands", (0.4, 0.4, 0.5), (x, -0.85), needed=False) for x in (-1.05, 1.05))
BED = FurnitureGroup(
    (Member("Beds", (1.6, 2.1, 1.0)), *STANDS), (front_zone((1.6, 2.1, 1.0), 0.6),), taste=Taste(chance=0.1)
)


def stand(
    scene: RoomScene, group: FurnitureGroup, seed: int, radius_m: float = 0.0, spare_m2: float = 1e9
) -> PlacedGroup | None:
    return place_group(np.random.default_rng(seed), scene, group, radius_m=radius_m, spare_m2=spare_m2)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_cabinet_has_its_back_at_a_wall_and_faces_the_room(seed: int) -> None:
    scene = empty_scene(5.0, 4.0)
    found = stand(scene, CABINET, seed)
    assert found is not None
    body, floor = found.pieces[0].body, scene.floor
    backs = (body.y_min - floor.y_min, floor.x_max - body.x_max, floor.y_max - body.y_max, body.x_min - floor.x_min)
    assert backs[found.pieces[0].quarter] == pytest.approx(0.02, abs=1e-3)


def test_groups_fill_a_room_without_meeting() -> None:
    scene = empty_scene(5.0, 4.0)
    while stand(scene, CABINET, len(scene.pieces)) is not None:
        pass
    assert len(scene.pieces) >= 6
    for number, piece in enumerate(scene.pieces):
        assert not any(piece.body.meets(other.body) for other in scene.pieces[:number])
    for number, group in enumerate(scene.groups):
        others = [piece for n, other in enumerate(scene.groups) if n != number for piece in other.pieces]
        assert not any(zone.meets(piece.body) for zone in group.zones for piece in others)


@pytest.mark.parametrize("seed", SEEDS)
def test_nothing_stands_where_floor_is_kept_clear(seed: int) -> None:
    keep = Box(10.0, 10.0, 12.0, 14.0)
    found = stand(empty_scene(5.0, 4.0, keep), CABINET, seed)
    assert found is not None
    assert not found.pieces[0].body.meets(keep)


def test_a_full_room_takes_no_more() -> None:
    assert stand(empty_scene(5.0, 4.0, Box(10.0, 10.0, 15.0, 14.0)), CABINET, 1) is None


@pytest.mark.parametrize("seed", range(20))
def test_nothing_stands_within_the_disc_around_the_start(seed: int) -> None:
    scene = open_scene(Box(-2.0, -2.0, 2.0, 2.0), (), ROBOT_M)
    found = stand(scene, FurnitureGroup((Member("Nightstands", (0.5, 0.4, 0.5)),), ()), seed)
    assert found is not None
    body = found.pieces[0].body
    assert math.hypot(max(body.x_min, -body.x_max, 0.0), max(body.y_min, -body.y_max, 0.0)) >= 1.0


def test_a_bed_prefers_a_place_with_room_for_both_nightstands() -> None:
    for seed in SEEDS:
        found = stand(empty_scene(4.0, 4.0, Box(10.0, 10.0, 11.0, 14.0)), BED, seed)
        assert found is not None
        assert len(found.pieces) == 3


def test_a_bed_does_without_the_nightstand_for_which_there_is_no_room() -> None:
    found = stand(empty_scene(2.2, 4.0), BED, 1)
    assert found is not None
    assert [piece.type for piece in found.pieces] == ["Beds", "Nightstands"]


def test_members_beyond_the_spare_floor_are_left_out() -> None:
    found = stand(empty_scene(5.0, 4.0), BED, 1, spare_m2=0.2)
    assert found is not None
    assert [piece.type for piece in found.pieces] == ["Beds", "Nightstands"]


def test_the_zone_of_a_member_that_is_left_out_is_free() -> None:
    group = FurnitureGroup((BED.members[0], BED.members[1]), (Zone(Box(-1.3, -1.05, -0.8, 0.0), 1),))
    found = stand(empty_scene(5.0, 4.0), group, 1, spare_m2=0.0)
    assert found is not None
    assert found.zones == ()


@pytest.mark.parametrize("seed", SEEDS)
def test_tall_things_do_not_stand_before_windows_but_desks_do(seed: int) -> None:
    floor = Box(10.0, 10.0, 12.0, 14.0)
    panes = [Pane(0, (11.0, y), 1.8, "x", 0.9, 2.1) for y in (9.94, 14.06)]
    panes += [Pane(0, (x, 12.0), 3.6, "y", 0.9, 2.1) for x in (9.94, 12.06)]
    tall = FurnitureGroup((Member("Storage", (1.0, 0.6, 2.0)),), ())
    desk = FurnitureGroup((Member("Desks", (1.2, 0.7, 1.2)),), ())
    assert stand(open_scene(floor, (), ROBOT_M, panes), tall, seed) is None
    assert stand(open_scene(floor, (), ROBOT_M, panes), desk, seed) is not None


def test_a_careful_placement_leaves_the_ways_open() -> None:
    # A corridor of 1.8 m: a bench across it shuts it, along it does not.
    scene = open_scene(Box(10.0, 10.0, 16.0, 11.8), (), ROBOT_M, (), ((10.0, 10.9), (16.0, 10.9)))
    across = FurnitureGroup((Member("StorageBenches", (0.6, 1.7, 0.5)),), (), quarters=(0, 2))
    assert stand(scene, across, 1) is not None
    scene.remove(0)
    assert stand(scene, across, 1, radius_m=ROBOT_M) is None
    assert (
        stand(scene, FurnitureGroup((Member("StorageBenches", (1.2, 0.4, 0.5)),), ()), 1, radius_m=ROBOT_M) is not None
    )


def test_members_stand_as_they_lie_in_the_frame() -> None:
    for seed in SEEDS:
        found = stand(empty_scene(5.0, 4.0), BED, seed)
        assert found is not None
        bed, *stands = found.pieces
        for piece in stands:
            offset = turn_quarters((piece.center[0] - bed.center[0], piece.center[1] - bed.center[1]), -bed.quarter)
            assert abs(offset[0]) == pytest.approx(1.05, abs=2e-3)
            assert offset[1] == pytest.approx(-0.85, abs=2e-3)


def test_quarter_turns_are_exact() -> None:
    assert [turn_quarters((1.0, 2.0), quarter) for quarter in range(5)] == [
        (1.0, 2.0),
        (-2.0, 1.0),
        (-1.0, -2.0),
        (2.0, -1.0),
        (1.0, 2.0),
    ]
