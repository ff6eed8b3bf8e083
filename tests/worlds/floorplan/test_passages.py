"""Every room can be reached by the wished ways and by doorways, and the robot starts where it gets about."""

import math
from collections import Counter
from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np
import pytest

from specs.data.world import RoomType
from tasks.worlds.floorplan.passages import START_CLEAR_M, Gap, choose_start, hindrance, place_passages, shared_wall
from tasks.worlds.geometry import Box
from tasks.worlds.resolved_template import ResolvedTemplate
from tests.worlds.resolved_templates import resolved, wish

WEST, EAST, NORTH, FAR = Box(0, 0, 4, 4), Box(4, 0, 8, 4), Box(0, 4, 8, 7), Box(8, 0, 12, 4)
SEEDS = range(20)


def home(
    *kinds: RoomType, doorways: tuple[tuple[int, int], ...] = (), openings: tuple[tuple[int, int], ...] = ()
) -> ResolvedTemplate:
    return resolved(*(wish(f"R{n}", kind) for n, kind in enumerate(kinds)), connections=doorways, openings=openings)


def passages(plan: ResolvedTemplate, *cells: Box, seed: int = 0) -> tuple[Gap, ...]:
    return place_passages(np.random.default_rng(seed), plan, cells)


def span(gap: Gap) -> tuple[float, float]:
    middle = gap.center[0] if gap.along == "x" else gap.center[1]
    return middle - gap.width / 2, middle + gap.width / 2


def test_cells_share_the_wall_that_both_rooms_face() -> None:
    wall = shared_wall(WEST, NORTH)
    assert wall is not None
    assert (wall.along, wall.at, wall.start, wall.end) == ("x", 4, 0.06, 3.94)
    assert shared_wall(WEST, FAR) is None


def test_a_wish_without_a_common_wall_is_left_out_and_all_rooms_are_joined() -> None:
    gaps = passages(home("Living", "Living", "Living", doorways=((0, 2),)), WEST, EAST, FAR)
    assert {gap.rooms for gap in gaps} == {(0, 1), (1, 2)}
    assert not any(gap.desired for gap in gaps)


def test_an_opening_takes_most_of_the_wall() -> None:
    (gap,) = passages(home("Living", "Living", openings=((0, 1),)), WEST, EAST)
    assert (gap.kind, gap.along, gap.center[0], gap.desired) == ("Opening", "y", 4, True)
    assert gap.width > 3.0


def test_an_opening_too_wide_for_the_wall_becomes_a_doorway() -> None:
    gaps = passages(home("Living", "Living", openings=((0, 1),)), WEST, Box(4, 2.6, 8, 6))
    assert [gap.kind for gap in gaps] == ["Doorway"]


@pytest.mark.parametrize("seed", SEEDS)
def test_no_more_doorways_are_built_beside_each_other_than_fit(seed: int) -> None:
    gaps = passages(home("Living", "Living", doorways=((0, 1),) * 4), WEST, EAST, seed=seed)
    spans = sorted(map(span, gaps))
    assert len(spans) == 3
    assert all(second[0] - first[1] >= 0.1 - 1e-9 for first, second in pairwise(spans))


def test_a_wished_passage_needs_no_second_one() -> None:
    assert len(passages(home("Living", "Living", doorways=((0, 1),)), WEST, EAST)) == 1


def test_doorways_and_openings_fit_the_robot() -> None:
    large = resolved(wish("A"), wish("B"), wish("C"), openings=((0, 1),), radius_m=0.6, doors=True)
    gaps = passages(large, WEST, Box(4, 2.2, 8, 6), Box(4, -4, 8, 2.2))
    assert {gap.kind for gap in gaps} == {"Opening", "Doorway"}
    assert min(gap.width for gap in gaps) == 1.48


@pytest.mark.parametrize("seed", SEEDS)
def test_a_bathroom_is_no_thoroughfare_when_there_is_another_way(seed: int) -> None:
    gaps = passages(home("Bathroom", "Bedroom", "Hallway"), WEST, EAST, NORTH, seed=seed)
    assert {gap.rooms for gap in gaps} == {(0, 2), (1, 2)}


@pytest.mark.parametrize("seed", SEEDS)
def test_a_bedroom_with_a_bathroom_of_its_own_opens_to_the_rest_itself(seed: int) -> None:
    # The hall would rather have the bathroom's door than the kitchen the bedroom's.
    cells = Box(0, 0, 4, 4), Box(0, 4, 4, 8), Box(4, 0, 8, 4), Box(4, 4, 8, 8)
    plan = home("Bedroom", "Bathroom", "Kitchen", "Hallway", doorways=((0, 1),))
    assert {gap.rooms for gap in passages(plan, *cells, seed=seed)} == {(0, 1), (0, 2), (2, 3)}


@pytest.mark.parametrize("seed", SEEDS)
def test_private_rooms_hang_off_the_most_public_neighbour(seed: int) -> None:
    cells = Box(0, 0, 4, 4), Box(4, 0, 8, 4), Box(8, 0, 12, 4), Box(0, 4, 12, 7)
    plan = home("Closet", "Bedroom", "Bathroom", "Hallway")
    assert {gap.rooms for gap in passages(plan, *cells, seed=seed)} == {(0, 3), (1, 3), (2, 3)}


def test_rooms_that_the_template_joins_get_no_further_doorway() -> None:
    plan = home("Hallway", "Bathroom", "Bedroom", doorways=((0, 1), (1, 2)))
    assert len(passages(plan, NORTH, WEST, EAST)) == 2


@pytest.mark.parametrize("seed", SEEDS)
def test_gaps_leave_a_jamb_at_either_end(seed: int) -> None:
    for gap in passages(home("Living", "Living", "Living"), WEST, EAST, NORTH, seed=seed):
        wall = shared_wall(*((WEST, EAST, NORTH)[room] for room in gap.rooms))
        assert wall is not None
        assert span(gap)[0] >= wall.start + 0.1 - 1e-9
        assert span(gap)[1] <= wall.end - 0.1 + 1e-9


def test_most_doorways_stand_in_a_corner_but_not_all() -> None:
    corners = Counter(
        min(span(gap)[0] - 0.06, 3.94 - span(gap)[1]) < 0.11
        for seed in range(100)
        for gap in passages(home("Living", "Living"), WEST, EAST, seed=seed)
    )
    assert 60 <= corners[True] <= 98


def test_doors_of_a_room_do_not_swing_into_each_other() -> None:
    kinds: tuple[RoomType, ...] = ("Bedroom", "Bathroom", "Hallway")
    meeting = 0
    for seed in SEEDS:
        plan = resolved(*(wish(kind, kind) for kind in kinds), connections=((0, 1), (0, 2)), doors=True)
        gaps = passages(plan, WEST, EAST, NORTH, seed=seed)
        meeting += sum(a.box(a.width).meets(b.box(b.width)) for a, b in combinations(gaps, 2))
    assert meeting == 0


def test_a_moved_gap_keeps_its_shape() -> None:
    gap = Gap((0, 1), "Doorway", (4.0, 2.005), 0.9, "y", desired=True)
    moved = gap.shifted(-4.0, 1.0)
    assert moved.center == (0.0, 3.005)
    assert moved.box(0.5) == pytest.approx(Box(-0.5, 2.555, 0.5, 3.455))


WEST_ROOM, EAST_ROOM = Box(0, 0, 4, 4), Box(4, 0, 10, 4)
DOORWAY = Gap((0, 1), "Doorway", (4.0, 0.61), 0.9, "y", desired=True)


def start(
    home: ResolvedTemplate, *cells: Box, gaps: tuple[Gap, ...] = (DOORWAY,), seed: int = 0
) -> tuple[float, float] | None:
    return choose_start(np.random.default_rng(seed), home, cells, gaps)


def room_of(spot: tuple[float, float] | None, *cells: Box) -> int:
    assert spot is not None
    return next(
        n for n, cell in enumerate(cells) if cell.x_min < spot[0] < cell.x_max and cell.y_min < spot[1] < cell.y_max
    )


@pytest.mark.parametrize(
    ("kinds", "room"),
    [
        (("Hallway", "Bedroom"), 0),
        (("Bedroom", "Living"), 1),
        (("Kitchen", "Bathroom"), 0),
        (("Bedroom", "Closet"), 0),
        (("Living", "Living"), 1),
        (("Bathroom", "Closet"), 1),
    ],
)
def test_it_is_the_most_public_room_and_of_two_alike_the_larger(kinds: tuple[RoomType, RoomType], room: int) -> None:
    home = resolved(*(wish(kind, kind) for kind in kinds))
    assert {room_of(start(home, WEST_ROOM, EAST_ROOM, seed=seed), WEST_ROOM, EAST_ROOM) for seed in SEEDS} == {room}


def test_a_hall_that_is_too_narrow_is_passed_over() -> None:
    hall = Box(0, 4, 10, 6.1)
    home = resolved(wish("A", "Bathroom"), wish("B", "Bedroom"), wish("C", "Hallway"))
    assert room_of(start(home, WEST_ROOM, EAST_ROOM, hall), WEST_ROOM, EAST_ROOM, hall) == 1


def test_without_a_room_for_the_disc_there_is_no_start() -> None:
    assert start(resolved(wish("A")), Box(0, 0, 9, 2.1), gaps=()) is None


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("doors", [False, True])
def test_the_disc_keeps_off_the_walls_also_in_the_narrowest_room(seed: int, doors: bool) -> None:  # noqa: FBT001
    for cells in ((WEST_ROOM, EAST_ROOM), (Box(0, 0, 4, 4), Box(4, 0, 10, 2.22))):
        home = resolved(wish("A", "Closet"), wish("B", "Hallway"), doors=doors)
        spot = start(home, *cells, seed=seed)
        assert spot is not None
        floor = cells[1].grown(-0.06)
        assert min(spot[0] - floor.x_min, floor.x_max - spot[0]) >= START_CLEAR_M - 1e-9
        assert min(spot[1] - floor.y_min, floor.y_max - spot[1]) >= START_CLEAR_M - 1e-9


def test_it_is_near_a_way_out() -> None:
    home = resolved(wish("A", "Closet"), wish("B", "Hallway"))
    spots = [start(home, WEST_ROOM, EAST_ROOM, seed=seed) for seed in SEEDS]
    assert max(math.dist(spot, DOORWAY.center) for spot in spots if spot) < 2.0


def test_a_leaf_can_open_without_touching_the_disc() -> None:
    home = resolved(wish("A", "Closet"), wish("B", "Hallway"), doors=True)
    for seed in SEEDS:
        spot = start(home, WEST_ROOM, EAST_ROOM, seed=seed)
        assert spot is not None
        swing = DOORWAY.box(DOORWAY.width)
        beyond = max(spot[0] - swing.x_max, 0.0), max(spot[1] - swing.y_max, 0.0)
        assert math.hypot(*beyond) >= START_CLEAR_M


def test_starts_are_whole_centimetres_and_the_same_for_the_same_stream() -> None:
    home = resolved(wish("A", "Closet"), wish("B", "Hallway"))
    spot = start(home, WEST_ROOM, EAST_ROOM, seed=3)
    assert spot == start(home, WEST_ROOM, EAST_ROOM, seed=3)
    assert spot == tuple(round(side, 2) for side in spot or ())


THREE_CELLS = Box(0, 0, 4, 4), Box(4, 0, 8, 4), Box(8, 0, 9, 4)
THREE_ROOMS = resolved(wish("Hall"), wish("Bath"), wish("Closet"))
TWO_GAPS = tuple(Gap((n, n + 1), "Doorway", (4.0 + 4 * n, 2.0), 0.9, "y", desired=True) for n in range(2))
MIDDLE = (2.0, 2.0)


def test_nothing_hinders_a_robot_that_fits_everywhere() -> None:
    assert hindrance(THREE_ROOMS, THREE_CELLS, TWO_GAPS, MIDDLE) == ""


def test_a_start_at_a_wall_has_no_clear_disc() -> None:
    assert "around the start" in hindrance(THREE_ROOMS, THREE_CELLS, TWO_GAPS, (1.0, 2.0))
    assert "around the start" in hindrance(THREE_ROOMS, THREE_CELLS, TWO_GAPS, None)


def test_a_room_without_a_way_to_it_is_named() -> None:
    assert hindrance(THREE_ROOMS, THREE_CELLS, TWO_GAPS[:1], MIDDLE) == "no way leads to Closet"
    assert hindrance(THREE_ROOMS, THREE_CELLS, TWO_GAPS[1:], MIDDLE) == "no way leads to Bath, Closet"


def test_a_room_narrower_than_the_robot_is_named_with_its_size() -> None:
    assert "Closet is 0.88 x 3.88 m" in hindrance(
        replace(THREE_ROOMS, robot_radius_m=0.35), THREE_CELLS, TWO_GAPS, MIDDLE
    )


def test_a_gap_narrower_than_the_robot_needs_is_no_way() -> None:
    narrow = (TWO_GAPS[0], replace(TWO_GAPS[1], width=0.8))
    assert hindrance(THREE_ROOMS, THREE_CELLS, narrow, MIDDLE) == "no way leads to Closet"
