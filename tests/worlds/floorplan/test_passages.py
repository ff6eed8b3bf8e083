"""Passages: wished ones first, then what joins all rooms."""

from collections import Counter
from itertools import combinations, pairwise

import numpy as np
import pytest

from specs.data.world import RoomType
from tasks.worlds.floorplan.passages import Gap, place_passages, shared_wall
from tasks.worlds.geometry import Box
from tasks.worlds.resolved_template import ResolvedTemplate
from tests.worlds.briefs import brief, wish

WEST, EAST, NORTH, FAR = Box(0, 0, 4, 4), Box(4, 0, 8, 4), Box(0, 4, 8, 7), Box(8, 0, 12, 4)
SEEDS = range(20)


def home(
    *kinds: RoomType, doorways: tuple[tuple[int, int], ...] = (), openings: tuple[tuple[int, int], ...] = ()
) -> ResolvedTemplate:
    return brief(*(wish(f"R{n}", kind) for n, kind in enumerate(kinds)), connections=doorways, openings=openings)


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
    large = brief(wish("A"), wish("B"), wish("C"), openings=((0, 1),), radius_m=0.6, doors=True)
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
        plan = brief(*(wish(kind, kind) for kind in kinds), connections=((0, 1), (0, 2)), doors=True)
        gaps = passages(plan, WEST, EAST, NORTH, seed=seed)
        meeting += sum(a.box(a.width).meets(b.box(b.width)) for a, b in combinations(gaps, 2))
    assert meeting == 0


def test_a_moved_gap_keeps_its_shape() -> None:
    gap = Gap((0, 1), "Doorway", (4.0, 2.005), 0.9, "y", desired=True)
    moved = gap.shifted(-4.0, 1.0)
    assert moved.center == (0.0, 3.005)
    assert moved.box(0.5) == pytest.approx(Box(-0.5, 2.555, 0.5, 3.455))
