"""Groups stand on the floor, in nobody's way, and leave the ways open."""

import math

import numpy as np
import pytest

from tasks.worlds.floorplan.floorplan import Pane
from tasks.worlds.furnishing.groups import FurnitureGroup, Member, Zone, front_zone
from tasks.worlds.furnishing.placement import place_group, turn_quarters
from tasks.worlds.furnishing.scene import PlacedGroup, RoomScene, open_scene
from tasks.worlds.furniture.furniture_type import Taste
from tasks.worlds.geometry import Box
from tests.worlds.rooms import ROBOT_M, empty_scene

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
