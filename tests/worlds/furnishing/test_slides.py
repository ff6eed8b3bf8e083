"""A box that slides along a line is free between what is in its way, and only where there is a gap as wide as it is."""

import numpy as np
import pytest

from tasks.worlds.furnishing.groups import FurnitureGroup, Member, Zone
from tasks.worlds.furnishing.intervals import Interval, first_interval, other_intervals
from tasks.worlds.furnishing.scene import Piece, PlacedGroup
from tasks.worlds.geometry import Box
from tests.worlds.rooms import empty_scene

CABINET = FurnitureGroup((Member("Storage", (1.0, 0.6, 2.0)),), (Zone(Box(-0.5, 0.3, 0.5, 1.1)),))


def placed(body: Box, zone: Box | None = None) -> PlacedGroup:
    piece = Piece("Ottomans", (body.width, body.height, 0.4), body.center, 0, 0.0, body)
    return PlacedGroup((piece,), (zone,) if zone else ())


def test_a_box_may_touch_what_is_in_its_way() -> None:
    scene = empty_scene(5.0, 4.0)
    scene.add(placed(Box(12.0, 10.0, 13.0, 10.5)))
    slide = first_interval(scene, CABINET, scene.lines[0], 10.32)
    assert [slide.is_free(along) for along in (11.499, 11.5, 11.501, 13.499, 13.5, 13.501)] == [
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
    slide = Interval(-0.3, 0.3, [(end, 1e9), (-1e9, 0.0)])
    assert slide.has_room is room
    assert slide.is_free(0.3) is room


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
    slide = Interval(-0.3, 0.3, bars)
    edges = [end + 0.3 + 1e-9 for _, end in bars if end <= 5.0]
    assert slide.has_room is any(slide.is_free(along) for along in edges)
    places = [(along, 0, 0.0, along) for along in edges]
    assert slide.free_places(places) == [place for place in places if slide.is_free(place[0])]


def test_the_disc_around_the_start_is_kept_clear() -> None:
    slide = Interval(-0.5, 0.5, [], aside_m2=0.64)  # 0.8 m aside: the disc of 1.02 m reaches 0.633 m along
    assert [slide.is_free(along) for along in (-1.14, -1.13, 0.0, 1.13, 1.14)] == [True, False, False, False, True]
