"""Intervals of many groups: each wide enough that all hold together."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import beta

from tasks.results.statistics.intervals import IntervalFamily, clopper_pearson, wilson_bounds

families = st.builds(IntervalFamily, size=st.integers(1, 500), confidence=st.floats(0.5, 0.999))
counts = st.integers(1, 400).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n)))


def _missed(n: int, rate: float, confidence: float) -> float:
    """Returns how often the interval of a share does not cover it, by all outcomes."""
    outcomes = ((x, math.comb(n, x) * rate**x * (1.0 - rate) ** (n - x)) for x in range(n + 1))
    alone = IntervalFamily(size=1, confidence=confidence)
    bounds = ((alone.interval(x, n), chance) for x, chance in outcomes)
    return sum(chance for found, chance in bounds if not found.lower <= rate <= found.upper)


@given(families)
def test_what_all_may_miss_is_what_one_alone_might(family: IntervalFamily):
    assert family.size * (1.0 - family.each) == pytest.approx(1.0 - family.confidence)


@given(families, counts)
def test_more_groups_make_no_interval_narrower(family: IntervalFamily, count: tuple[int, int]):
    narrow, wide = family.interval(*count), family.model_copy(update={"size": family.size + 1}).interval(*count)
    assert wide.lower <= narrow.lower <= count[0] / count[1] <= narrow.upper <= wide.upper


@settings(max_examples=40)
@given(families, st.integers(1, 30), st.floats(0.5, 0.999))
def test_no_rate_is_missed_more_often_than_its_share_allows(family: IntervalFamily, n: int, rate: float):
    assert family.size * _missed(n, rate, family.each) <= 1.0 - family.confidence + 1e-9


def test_wilson_s_interval_would_miss_forty_times_as_often_as_it_may():
    """The reason for exact ones: 7 of 8 come of a rate of 0.995 in 4 % of all groups, and Wilson's misses it then."""
    family, seven = IntervalFamily(size=48, confidence=0.95), np.array(7.0)
    assert wilson_bounds(seven, np.array(8.0), family.each)[1] < 0.995 < family.interval(7, 8).upper
    assert math.comb(8, 7) * 0.995**7 * 0.005 > 37 * (1.0 - family.each)


@given(counts, st.floats(1e-9, 0.49))
def test_exact_bounds_have_the_bits_of_scipys(count: tuple[int, int], tail: float):
    (shown, n), found = count, clopper_pearson(*count, tail)
    assert found.lower == (float(beta.ppf(tail, shown, n - shown + 1)) if shown else 0.0)
    assert found.upper == (float(beta.ppf(1.0 - tail, shown + 1, n - shown)) if shown < n else 1.0)


def test_nothing_counted_says_nothing():
    found = IntervalFamily(size=3, confidence=0.95).interval(0, 0)
    assert (found.lower, found.upper) == (0.0, 1.0)


@pytest.mark.parametrize("count", [(-1, 3), (4, 3)])
def test_impossible_counts_are_refused(count: tuple[int, int]):
    with pytest.raises(ValueError, match="of 3"):
        IntervalFamily(size=1, confidence=0.95).interval(*count)


@pytest.mark.parametrize(
    ("size", "sentence"),
    [
        (0, ""),
        (1, "1 interval of a group; it holds in 95\u00a0% of such reports"),
        (48, "48 intervals of groups; all 48 hold together in 95\u00a0% of such reports"),
        (1200, "1,200 intervals of groups; all 1,200 hold together in 95\u00a0% of such reports"),
    ],
)
def test_it_says_how_many_there_are_and_what_that_means(size: int, sentence: str):
    assert IntervalFamily(size=size, confidence=0.95).sentence() == sentence
