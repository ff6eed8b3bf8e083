"""Estimates of an audit: weighted by what lanes stand for, exact where there is a formula, and chaos is not error."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tasks.simulate.audit.audit_report import (
    ComparedLane,
    Ending,
    FlipShare,
    chance_of,
    flip_share,
    own_rate,
    share_bounds,
    total_share,
)

PASS, FAIL = Ending(passed=True, touched=False), Ending(passed=False, touched=True)


def passed(ending: Ending) -> bool:
    return ending.passed


def failed(ending: Ending) -> bool:
    return not ending.passed


def lane(row: Ending, reference: Ending, *disturbed: Ending, weight: float = 1.0) -> ComparedLane:
    return ComparedLane(0, weight, row, reference, disturbed)


def test_a_flip_that_c_mujoco_makes_by_itself_is_chaotic():
    lanes = [lane(PASS, PASS, PASS, PASS), lane(PASS, FAIL, FAIL, PASS), lane(PASS, FAIL, FAIL, FAIL)]
    found = flip_share(lanes, passed)
    assert (found.lanes, found.flips, found.chaotic, found.unexplained) == (3, 2, 1, 1)
    assert found.rate == pytest.approx(2 / 3)
    assert found.beyond == pytest.approx(1 / 3)


def test_directions_are_counted_apart():
    lanes = [lane(PASS, FAIL), lane(FAIL, PASS), lane(FAIL, PASS), lane(FAIL, FAIL)]
    assert flip_share(lanes, passed).text() == "1 of 1"
    assert flip_share(lanes, failed).text() == "2 of 3"
    assert flip_share(lanes, passed).chance is None


@pytest.mark.parametrize(("flips", "lanes", "lower", "upper"), [(0, 24, 0.0, 0.142473), (1, 10, 0.002529, 0.445016)])
def test_equal_weights_give_the_exact_interval(flips: int, lanes: int, lower: float, upper: float):
    assert share_bounds(flips / lanes, lanes, 0.95) == pytest.approx((lower, upper), abs=1e-6)


def test_unequal_weights_count_for_fewer_lanes():
    lanes = [lane(PASS, PASS, weight=weight) for weight in (1.0, 1.0, 1.0, 9.0)]
    assert flip_share(lanes, passed).effective == pytest.approx(144 / 84)


def test_the_total_weights_strata_by_their_episodes():
    strata = [
        flip_share([lane(PASS, PASS, weight=30.0)] * 12, passed),
        flip_share([lane(FAIL, PASS, weight=2.0), lane(FAIL, FAIL, weight=2.0)], failed),
    ]
    found = total_share(strata)
    assert found.rate == pytest.approx(2 / 364)
    assert found.lower < 2 / 364 < found.upper < strata[0].upper + 4 / 364


def test_of_nothing_nothing_is_said():
    assert (flip_share([], passed).rate, total_share([FlipShare()]).rate, total_share([]).upper) == (None, None, 1.0)


def test_c_mujoco_against_itself_counts_all_pairs():
    lanes = [lane(PASS, PASS, PASS, FAIL, weight=3.0), lane(PASS, PASS, PASS, PASS, weight=1.0)]
    assert own_rate(lanes) == pytest.approx(0.75 * 2 / 3)


def test_an_engine_that_alone_differs_is_not_one_of_them():
    clean = [lane(PASS, FAIL, FAIL, FAIL)]
    steady = [lane(PASS, PASS, PASS, PASS)] * 20
    assert chance_of([*clean, *steady], passed) == pytest.approx(1 / 4)
    assert chance_of([*clean * 3, *steady], passed) == pytest.approx(1 / 64)


def test_chaos_in_other_lanes_explains_a_flip():
    flips = [lane(PASS, FAIL, FAIL, FAIL)] * 2
    chaos = [lane(PASS, FAIL, PASS, PASS), lane(FAIL, PASS, FAIL, PASS), lane(FAIL, PASS, PASS, PASS)]
    assert chance_of([*flips, *chaos * 4], passed) > 0.2 > chance_of(flips, passed)


def test_failures_that_were_drawn_because_they_are_rare_blame_nobody():
    """Of failures that any drive has now and then, nearly all pass when they are driven again."""
    rare = [lane(FAIL, PASS, PASS, PASS, weight=1.0)] * 4
    others = [lane(PASS, PASS, PASS, PASS, weight=40.0)] * 24
    assert chance_of([*rare, *others], failed) > 0.5


@given(st.lists(st.sampled_from(list(itertools.product((PASS, FAIL), repeat=4))), max_size=12))
def test_the_chance_is_a_probability(drives: list[tuple[Ending, ...]]):
    lanes = [lane(*each) for each in drives]
    assert 0.0 <= chance_of(lanes, passed) <= 1.0 + 1e-12
