"""Passages: wished ones first, then what joins all rooms."""

import numpy as np

from tasks.worlds.brief import brief_of
from tasks.worlds.geometry import Box
from tasks.worlds.passages import Gap, place_passages
from tests.worlds.templates import connection, room, template

WEST, EAST, NORTH = Box(0, 0, 4, 4), Box(4, 0, 8, 4), Box(0, 4, 8, 7)


def passages(
    cells: list[Box], *wishes: tuple[str, str, str], kinds: tuple[str, ...] = (), seed: int = 0
) -> tuple[Gap, ...]:
    rooms = [room(name, kind) for name, kind in zip("ABC", kinds or ("Living",) * 3, strict=True)]  # pyright: ignore[reportArgumentType]
    brief = brief_of(template(*rooms[: len(cells)], connections=tuple(connection(*wish) for wish in wishes)))
    return place_passages(np.random.default_rng(seed), brief, cells)


def test_a_wish_without_a_common_wall_is_left_out() -> None:
    far = Box(8, 0, 12, 4)
    gaps = passages([WEST, EAST, far], ("A", "C", "Doorway"))
    assert {gap.rooms for gap in gaps} == {(0, 1), (1, 2)}
    assert not any(gap.desired for gap in gaps)


def test_an_opening_takes_most_of_the_wall() -> None:
    gaps = passages([WEST, EAST], ("A", "B", "Opening"))
    assert (gaps[0].kind, gaps[0].along, gaps[0].center[0]) == ("Opening", "y", 4)
    assert gaps[0].width > 3.0


def test_an_opening_too_wide_for_the_wall_becomes_a_doorway() -> None:
    gaps = passages([WEST, Box(4, 2.6, 8, 6)], ("A", "B", "Opening"))
    assert [gap.kind for gap in gaps] == ["Doorway"]


def test_doorways_that_do_not_fit_beside_each_other_are_left_out() -> None:
    gaps = passages([WEST, EAST], *[("A", "B", "Doorway")] * 4)
    assert len(gaps) == 3


def test_a_wished_passage_needs_no_second_one() -> None:
    gaps = passages([WEST, EAST], ("A", "B", "Doorway"))
    assert len(gaps) == 1


def test_a_bathroom_is_no_thoroughfare_when_there_is_another_way() -> None:
    for seed in range(10):
        gaps = passages([WEST, EAST, NORTH], kinds=("Bathroom", "Bedroom", "Hallway"), seed=seed)
        assert {gap.rooms for gap in gaps} == {(0, 2), (1, 2)}


def test_gaps_stay_clear_of_corners() -> None:
    for seed in range(20):
        gaps = passages([WEST, EAST], seed=seed)
        low, high = gaps[0].center[1] - 0.45, gaps[0].center[1] + 0.45
        assert low >= 0.06 + 0.1 - 1e-9
        assert high <= 4 - 0.06 - 0.1 + 1e-9
