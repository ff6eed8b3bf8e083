"""The interval at looks with an end in sight: exact errors by enumeration, nested, and the same as the test."""

import bisect
import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tasks.results.statistics.interim_analyses import (
    Boundary,
    boundary,
    chances_between,
    inner_interval,
    looks_of,
    repeated_interval,
    tested_shares,
)
from tasks.results.statistics.intervals import Interval

SCHEDULES = ((40,), (8, 16, 24, 32, 40), (5, 13, 40), (30, 35, 40))
seen = st.sampled_from([(look, at) for at in SCHEDULES for look in at]).flatmap(
    lambda found: st.tuples(st.integers(0, found[0]), st.just(found[0]), st.just(found[1]))
)


def ends(looks: tuple[int, ...], bar: float, confidence: float) -> Boundary:
    """Returns where a batch ends that is judged by its intervals."""

    def passes(look: int) -> int:
        counts = range(look + 1)
        return bisect.bisect_left(counts, bar, key=lambda s: repeated_interval(s, look, looks, confidence).lower)

    def fails(look: int) -> int:
        counts = range(look + 1)
        return bisect.bisect_left(counts, bar, key=lambda s: repeated_interval(s, look, looks, confidence).upper) - 1

    return Boundary(tuple(map(passes, looks)), tuple(map(fails, looks)))


@pytest.mark.parametrize(("looks", "confidence"), [*zip(SCHEDULES, itertools.cycle([0.95, 0.8]))])
def test_the_chance_to_err_is_at_most_half_of_what_confidence_leaves_at_any_bar(
    looks: tuple[int, ...], confidence: float
):
    allowed = (1.0 - confidence) / 2.0
    for bar in (0.1, 0.5, 0.737, 0.85, 0.9, 0.95):
        found = ends(looks, bar, confidence)
        no_pass, no_fail = tuple(look + 1 for look in looks), tuple(-1 for _ in looks)
        assert chances_between(looks, found._replace(fails=no_fail), bar).passes <= allowed
        assert chances_between(looks, found._replace(passes=no_pass), bar).fails <= allowed


def test_most_of_the_error_is_spent_in_a_batch_of_384():
    looks = looks_of(384, 16)
    found = boundary(looks, 0.9, 0.95)
    nothing = tuple(-1 for _ in looks)
    assert 0.022 < chances_between(looks, found._replace(fails=nothing), 0.9).passes <= 0.025


@settings(max_examples=30)
@given(seen)
def test_the_interval_holds_the_estimate_mirrors_what_failed_and_reaches_beyond_the_quick_one(
    found: tuple[int, int, tuple[int, ...]],
):
    successes, n, looks = found
    interval, inner = repeated_interval(successes, n, looks, 0.95), inner_interval(successes, n, looks, 0.95)
    mirrored = repeated_interval(n - successes, n, looks, 0.95)
    assert 0.0 <= interval.lower <= inner.lower <= successes / n <= inner.upper <= interval.upper <= 1.0
    assert (interval.lower, interval.upper) == pytest.approx((1.0 - mirrored.upper, 1.0 - mirrored.lower))


@settings(max_examples=20)
@given(seen)
def test_more_successes_and_less_confidence_never_lower_a_bound(found: tuple[int, int, tuple[int, ...]]):
    successes, n, looks = found
    interval, sure = (repeated_interval(successes, n, looks, confidence) for confidence in (0.9, 0.99))
    assert sure.lower <= interval.lower
    assert interval.upper <= sure.upper
    if successes < n:
        assert repeated_interval(successes + 1, n, looks, 0.9).lower >= interval.lower


@pytest.mark.parametrize("bar", [0.8, 0.9, 0.95])
def test_it_says_of_a_bar_what_the_boundary_says(bar: float):
    looks = looks_of(96, 24)
    assert ends(looks, bar, 0.95) == boundary(looks, bar, 0.95)


def test_shares_that_are_tested_are_the_same_wherever_one_begins():
    everywhere = set((tested_shares(0.0, 1.0) * 1e6).round())
    for lowest, highest in ((0.05, 0.15), (0.0123, 0.0124), (0.898, 0.9013), (0.9002, 0.9004), (0.98999, 0.9902)):
        found = tested_shares(lowest, highest)
        assert set((found * 1e6).round()) <= everywhere
        assert found[0] <= lowest < highest <= found[-1] + 1e-9


def test_with_one_look_it_is_the_exact_interval_of_a_share():
    interval, exact = repeated_interval(36, 40, (40,), 0.95), inner_interval(36, 40, (40,), 0.95)
    assert interval.lower == pytest.approx(exact.lower, abs=5e-4)
    assert interval.upper == pytest.approx(exact.upper, abs=5e-4)


def test_nothing_counted_says_nothing_and_what_is_no_look_is_refused():
    assert repeated_interval(0, 0, (8, 16), 0.95) == Interval(lower=0.0, upper=1.0)
    with pytest.raises(ValueError, match="one of the looks"):
        repeated_interval(3, 9, (8, 16), 0.95)
