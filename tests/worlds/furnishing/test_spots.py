"""A group fits where nothing is in its way: along lines, flush against something, or in a room's middle."""

import numpy as np
import pytest

from tasks.worlds.furnishing.groups import FurnitureGroup, Member, Zone
from tasks.worlds.furnishing.scene import Piece, PlacedGroup, RoomScene
from tasks.worlds.furnishing.spots import Interval, Spot, find_spots, first_interval, other_intervals
from tasks.worlds.furniture.furniture_type import Anchor
from tasks.worlds.geometry import Box
from tests.worlds.rooms import empty_scene

CABINET = FurnitureGroup((Member("Storage", (1.0, 0.6, 2.0)),), (Zone(Box(-0.5, 0.3, 0.5, 1.1)),))


def placed(body: Box, zone: Box | None = None) -> PlacedGroup:
    piece = Piece("Ottomans", (body.width, body.height, 0.4), body.center, 0, 0.0, body)
    return PlacedGroup((piece,), (zone,) if zone else ())


def test_a_box_may_touch_what_is_in_its_way() -> None:
    scene = empty_scene(5.0, 4.0)
    scene.add(placed(Box(12.0, 10.0, 13.0, 10.5)))
    interval = first_interval(scene, CABINET, scene.lines[0], 10.32)
    assert [interval.is_free(along) for along in (11.499, 11.5, 11.501, 13.499, 13.5, 13.501)] == [
        True,
        True,
        False,
        False,
        True,
        True,
    ]


def test_what_stands_deeper_in_the_room_is_in_nobodys_way() -> None:
    scene = empty_scene(5.0, 4.0)
    scene.add(placed(Box(12.0, 10.62, 13.0, 11.0)))
    assert first_interval(scene, CABINET, scene.lines[0], 10.32).is_free(12.5)
    assert not first_interval(scene, CABINET, scene.lines[0], 10.33).is_free(12.5)


def test_what_is_as_thin_as_the_skirting_board_stays_behind() -> None:
    scene = empty_scene(5.0, 4.0)
    scene.add(placed(Box(12.0, 10.0, 13.0, 10.02)))
    assert first_interval(scene, CABINET, scene.lines[0], 10.32).is_free(12.5)
    assert not first_interval(scene, CABINET, scene.lines[0], 10.31).is_free(12.5)


@pytest.mark.parametrize(("end", "room"), [(0.6, True), (0.599, False)])
def test_a_gap_as_wide_as_the_box_is_room(end: float, *, room: bool) -> None:
    interval = Interval(-0.3, 0.3, [(end, 1e9), (-1e9, 0.0)])
    assert interval.has_room is room
    assert interval.is_free(0.3) is room


def test_the_floor_that_a_member_uses_may_lie_where_others_walk_but_nothing_stands_there() -> None:
    scene = empty_scene(5.0, 4.0)
    scene.add(placed(Box(10.0, 13.0, 10.5, 13.5), zone=Box(12.0, 10.7, 13.0, 11.5)))
    (zone,) = other_intervals(scene, CABINET, scene.lines[0], 10.32).needed
    assert zone.is_free(12.5)
    scene.add(placed(Box(12.0, 10.7, 13.0, 11.5)))
    (zone,) = other_intervals(scene, CABINET, scene.lines[0], 10.32).needed
    assert not zone.is_free(12.5)


@pytest.mark.parametrize("seed", range(20))
def test_a_line_without_a_gap_has_no_free_place(seed: int) -> None:
    draws = np.random.default_rng(seed)
    starts = draws.uniform(0.0, 4.5, 13).round(3).tolist()
    bars = [(-1e9, 0.0), (5.0, 1e9), *[(start, start + 0.5) for start in starts]]
    interval = Interval(-0.3, 0.3, bars)
    edges = [end + 0.3 + 1e-9 for _, end in bars if end <= 5.0]
    assert interval.has_room is any(interval.is_free(along) for along in edges)
    places = [(along, 0, 0.0, along) for along in edges]
    assert interval.free_places(places) == [place for place in places if interval.is_free(place[0])]


def test_the_disc_around_the_start_is_kept_clear() -> None:
    interval = Interval(-0.5, 0.5, [], aside_m2=0.64)  # 0.8 m aside: the disc of 1.02 m reaches 0.633 m along
    assert [interval.is_free(along) for along in (-1.14, -1.13, 0.0, 1.13, 1.14)] == [True, False, False, False, True]


FLUSH_CABINET = FurnitureGroup((Member("Storage", (1.0, 0.6, 2.0)),), (), flush=True)


def rng() -> np.random.Generator:
    return np.random.default_rng(1)


def facing(quarter: int, spots: list[Spot]) -> list[Spot]:
    return [spot for spot in spots if spot.quarter == quarter]


def test_backs_stand_a_skirting_board_off_the_wall() -> None:
    spots = find_spots(rng(), empty_scene(5.0, 4.0), FLUSH_CABINET)
    south = facing(0, spots)
    assert len(south) > 4
    assert {spot.center[1] for spot in south} == {10.32}
    assert {spot.center[0] for spot in facing(1, spots)} == {14.68}


def test_both_ends_and_the_middle_of_each_wall_are_tried() -> None:
    spots = find_spots(rng(), empty_scene(5.0, 4.0), FLUSH_CABINET)
    assert {10.52, 12.5, 14.48} <= {spot.center[0] for spot in facing(0, spots)}


def test_only_the_corner_on_its_left_holds_a_group_wholly() -> None:
    spots = find_spots(rng(), empty_scene(5.0, 4.0), FLUSH_CABINET)
    held = {spot.center[0] for spot in facing(2, spots) if spot.held == 1.0}
    assert held == {14.48}  # facing south, one's left hand is in the east


def test_kitchen_units_are_tried_flush_beside_what_stands() -> None:
    scene = empty_scene(5.0, 4.0)
    body = Box(12.0, 10.02, 13.0, 10.62)
    scene.add(PlacedGroup((Piece("Storage", (1.0, 0.6, 2.0), (12.5, 10.32), 0, 0.0, body),), ()))
    assert {11.5, 13.5} <= {spot.center[0] for spot in facing(0, find_spots(rng(), scene, FLUSH_CABINET))}


def test_a_group_wider_than_a_wall_is_not_tried_there() -> None:
    wide = FurnitureGroup((Member("Storage", (3.0, 0.6, 2.0)),), ())
    assert {spot.quarter for spot in find_spots(rng(), empty_scene(2.5, 4.0), wide)} == {1, 3}


def test_a_group_that_faces_two_ways_is_tried_at_two_walls() -> None:
    group = FurnitureGroup(FLUSH_CABINET.members, (), quarters=(0, 2))
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
    group = FurnitureGroup((*FLUSH_CABINET.members, beside), (Zone(Box(-0.5, 0.3, 0.5, 0.9)),), anchor)
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
