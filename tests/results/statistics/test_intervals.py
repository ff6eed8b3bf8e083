"""Intervals: textbook examples, what must always hold, how often they cover, and how they are written."""

import itertools
import math
import subprocess
import sys
from functools import cache
from math import comb

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import beta, binom, binomtest, quantile_test

from specs.data.parity_audit import FlipShare
from tasks.results.statistics.intervals import (
    Interval,
    IntervalFamily,
    Stratum,
    clopper_pearson,
    discounted_bound,
    in_worlds,
    lanes_needed,
    mcnemar,
    paired_difference,
    percent,
    quantile_interval,
    quantile_ranks,
    stratum_interval,
    total_interval,
    total_rate,
    wilson,
    wilson_bounds,
)
from tasks.simulate.audit.audit_report import share_bounds, total_share

counts = st.integers(0, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n)))


def test_the_textbook_example():
    # Newcombe 1998 (Statistics in Medicine 17:857), table I, method 3: 81 of 263 gives 0.2553 to 0.3662.
    interval = wilson(81, 263, 0.95)
    assert interval.lower == pytest.approx(0.2553, abs=5e-5)
    assert interval.upper == pytest.approx(0.3662, abs=5e-5)


@given(counts, st.floats(0.5, 0.9999))
def test_the_interval_holds_the_estimate_and_lies_in_0_to_1(count: tuple[int, int], confidence: float):
    successes, n = count
    interval = wilson(successes, n, confidence)
    assert 0.0 <= interval.lower <= interval.upper <= 1.0
    if n:
        assert interval.lower <= successes / n <= interval.upper


@given(counts.filter(lambda count: count[1] > 0))
def test_more_confidence_never_narrows_the_interval(count: tuple[int, int]):
    narrow, wide = wilson(*count, 0.8), wilson(*count, 0.99)
    assert wide.lower <= narrow.lower
    assert narrow.upper <= wide.upper


@given(counts.filter(lambda count: count[1] > 0), st.floats(0.01, 0.9999))
def test_the_interval_of_a_share_has_the_bits_of_scipys(count: tuple[int, int], confidence: float):
    bounds = binomtest(*count).proportion_ci(confidence, method="wilson")
    assert wilson(*count, confidence) == Interval(lower=float(bounds.low), upper=float(bounds.high))


def test_the_interval_of_a_share_does_not_wait_for_scipys_statistics():
    code = (
        f"import sys; from {wilson.__module__} import wilson; wilson(1, 2, 0.95); print('scipy.stats' in sys.modules)"
    )

    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert told.stdout == "False\n"


def test_nothing_counted_says_nothing():
    assert (wilson(0, 0, 0.95).lower, wilson(0, 0, 0.95).upper) == (0.0, 1.0)


@pytest.mark.parametrize(("successes", "n", "confidence"), [(2, 1, 0.9), (-1, 1, 0.9), (1, 1, 1.0), (1, 1, 0.0)])
def test_numbers_that_are_no_count_are_refused(successes: int, n: int, confidence: float):
    with pytest.raises(ValueError, match="successes"):
        wilson(successes, n, confidence)


def test_the_textbook_example_of_pairs():
    # Bentur et al. 2009, 21 children before and after: 1 and 7 disagree. Fagerland, Lydersen and Laake 2014 (Statistics
    # in Medicine 33:2850), table V, asymptotic score: -0.517 to -0.026; exact McNemar p = 0.070.
    interval = paired_difference(1, 7, 21, 0.95)
    assert interval.lower == pytest.approx(-0.517, abs=5e-4)
    assert interval.upper == pytest.approx(-0.026, abs=5e-4)
    assert mcnemar(1, 7) == pytest.approx(0.0703, abs=5e-5)


pairs = st.integers(1, 300).flatmap(
    lambda n: st.integers(0, n).flatmap(lambda b: st.tuples(st.just(b), st.integers(0, n - b), st.just(n)))
)


@given(pairs, st.floats(0.5, 0.999))
def test_the_interval_of_a_difference_holds_it_and_is_the_same_the_other_way_round(
    count: tuple[int, int, int], confidence: float
):
    gains, losses, n = count
    interval, turned = paired_difference(gains, losses, n, confidence), paired_difference(losses, gains, n, confidence)
    assert -1.0 <= interval.lower <= (gains - losses) / n + 1e-9
    assert (gains - losses) / n - 1e-9 <= interval.upper <= 1.0
    assert (turned.lower, turned.upper) == (-interval.upper, -interval.lower)


def test_pairs_that_all_agree_still_leave_doubt():
    # The score test of a difference d without a pair that disagrees: n d / sqrt(n d (1 - d)) = z, solved for d.
    z2 = 1.959963984540054**2
    interval = paired_difference(0, 0, 100, 0.95)
    assert interval.upper == pytest.approx(z2 / (100 + z2), abs=2e-9)
    assert interval.lower == -interval.upper


def test_no_pair_says_nothing_and_no_disagreement_is_no_evidence():
    assert paired_difference(0, 0, 0, 0.95) == Interval(lower=-1.0, upper=1.0)
    assert mcnemar(0, 0) == 1.0


@pytest.mark.parametrize(("gains", "losses", "n"), [(-1, 0, 3), (0, -1, 3), (2, 2, 3)])
def test_numbers_that_are_no_pairs_are_refused(gains: int, losses: int, n: int):
    with pytest.raises(ValueError, match="pairs"):
        paired_difference(gains, losses, n, 0.95)


@pytest.mark.parametrize("quantile", [0.05, 0.5, 0.9])
def test_the_ranks_of_a_quantile_are_those_that_scipy_takes(quantile: float):
    values = np.arange(1.0, 201.0)
    theirs = quantile_test(values, p=quantile).confidence_interval(0.95)
    assert quantile_interval(list(values), quantile, 0.95) == Interval(lower=theirs.low, upper=theirs.high)


def test_too_few_values_leave_a_quantile_open():
    # Conover: none of n values below the quantile has probability (1 - q)^n, which is 2.5 % at n = 72 for q = 0.05.
    assert 0.95**71 > 0.025 > 0.95**72
    assert quantile_interval([1.0] * 71, 0.05, 0.95).lower == -math.inf
    assert quantile_interval([1.0] * 72, 0.05, 0.95).lower == 1.0
    assert quantile_interval([], 0.5, 0.95) == Interval(lower=-math.inf, upper=math.inf)


@given(st.lists(st.floats(-9, 9), min_size=1, max_size=60), st.floats(0.05, 0.95))
def test_an_interval_of_a_quantile_from_above_is_that_from_below_turned_over(values: list[float], quantile: float):
    interval = quantile_interval(values, quantile, 0.9)
    turned = quantile_interval([-value for value in values], 1.0 - quantile, 0.9)
    assert (interval.lower, interval.upper) == (-turned.upper, -turned.lower)


@pytest.mark.parametrize("wrong", [(0.0, 0.9), (1.0, 0.9), (0.5, 0.0), (0.5, 1.0)])
def test_numbers_that_are_no_quantile_are_refused(wrong: tuple[float, float]):
    with pytest.raises(ValueError, match="quantile"):
        quantile_ranks(10, *wrong)


# How often intervals cover, over simulated batches: the seed is fixed, so that the test has one answer. The standard
# error of 95 % over so many is 0.15 points.
_SIMULATED = 20_000


@pytest.mark.parametrize("n", [100, 384, 1000])
def test_wilsons_95_percent_cover_94_to_97_percent_over_the_rates_that_robots_have(n: int):
    rates = np.random.default_rng(1).uniform(0.6, 0.99, _SIMULATED)
    successes = np.random.default_rng(2).binomial(n, rates)
    covered = [_held(int(count), n, rate) for count, rate in zip(successes, rates, strict=True)]
    assert 0.94 <= np.mean(covered) <= 0.97


@pytest.mark.parametrize(("n", "rate"), [(384, 0.95), (384, 0.5), (1000, 0.98)])
def test_wilsons_95_percent_cover_94_to_97_percent_at_single_rates_of_a_batch_like_the_quickstarts(n: int, rate: float):
    assert 0.94 <= _wilson_coverage(n, rate) <= 0.97


def test_wilsons_coverage_at_a_single_rate_of_a_small_batch_may_be_a_little_less():
    # Counts are whole numbers, so that coverage jumps with rate and size (Brown, Cai and DasGupta 2001, Statistical
    # Science 16:101). docs/guide/gate.md says so.
    assert 0.93 <= _wilson_coverage(100, 0.9) < 0.94
    assert min(_wilson_coverage(384, rate / 100) for rate in range(60, 100)) > 0.93


@cache
def _wilson(count: int, n: int) -> Interval:
    return wilson(count, n, 0.95)


def _held(count: int, n: int, rate: float) -> bool:
    return _wilson(count, n).lower <= rate <= _wilson(count, n).upper


def _wilson_coverage(n: int, rate: float) -> float:
    """Returns the exact chance that the 95 % interval holds the rate."""
    held = [count for count in range(n + 1) if _held(count, n, rate)]
    return float(binom.cdf(held[-1], n, rate) - binom.cdf(held[0] - 1, n, rate))


@pytest.mark.parametrize(
    ("n", "gain", "loss"), [(100, 0.05, 0.05), (384, 0.03, 0.05), (384, 0.02, 0.02), (1000, 0.02, 0.01)]
)
def test_95_percent_of_a_paired_difference_cover_94_to_97_percent(n: int, gain: float, loss: float):
    drawn = np.random.default_rng(2).multinomial(n, [gain, loss, 1.0 - gain - loss], _SIMULATED)
    found = cache(lambda gains, losses: paired_difference(gains, losses, n, 0.95))
    covered = [
        found(int(gains), int(losses)).lower <= gain - loss <= found(int(gains), int(losses)).upper
        for gains, losses, _ in drawn
    ]
    assert 0.94 <= np.mean(covered) <= 0.97


@pytest.mark.parametrize(("n", "quantile"), [(384, 0.05), (384, 0.5), (1000, 0.95)])
def test_95_percent_of_a_quantile_cover_94_to_97_percent(n: int, quantile: float):
    # Of a uniform distribution each quantile is its own number.
    lower, upper = quantile_ranks(n, quantile, 0.95)
    values = np.sort(np.random.default_rng(3).random((_SIMULATED // 2, n)), axis=1)
    covered = (values[:, lower - 1] <= quantile) & (quantile <= values[:, upper - 1])
    assert 0.94 <= np.mean(covered) <= 0.97


families = st.builds(IntervalFamily, size=st.integers(1, 500), confidence=st.floats(0.5, 0.999))
group_counts = st.integers(1, 400).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n)))


def _missed(n: int, rate: float, confidence: float) -> float:
    """Returns how often the interval of a share does not cover it, by all outcomes."""
    outcomes = ((x, math.comb(n, x) * rate**x * (1.0 - rate) ** (n - x)) for x in range(n + 1))
    alone = IntervalFamily(size=1, confidence=confidence)
    bounds = ((alone.interval(x, n), chance) for x, chance in outcomes)
    return sum(chance for found, chance in bounds if not found.lower <= rate <= found.upper)


@given(families)
def test_what_all_may_miss_is_what_one_alone_might(family: IntervalFamily):
    assert family.size * (1.0 - family.each) == pytest.approx(1.0 - family.confidence)


@given(families, group_counts)
def test_more_groups_make_no_interval_narrower(family: IntervalFamily, count: tuple[int, int]):
    narrow, wide = family.interval(*count), family.model_copy(update={"size": family.size + 1}).interval(*count)
    assert wide.lower <= narrow.lower <= count[0] / count[1] <= narrow.upper <= wide.upper


@settings(max_examples=40)
@given(families, st.integers(1, 30), st.floats(0.5, 0.999))
def test_no_rate_is_missed_more_often_than_its_share_allows(family: IntervalFamily, n: int, rate: float):
    assert family.size * _missed(n, rate, family.each) <= 1.0 - family.confidence + 1e-9


def test_whenever_a_batch_is_ended_the_intervals_of_its_groups_hold_together():
    """Of the rule that ends it at the look at which a group seems worst, which hurts most; by simulation."""
    looks, rate, family = 8, 0.9, IntervalFamily(size=1, confidence=0.9, looks=8)
    passed = np.random.default_rng(4).binomial(8, rate, (2_000, looks)).cumsum(axis=1)
    intervals = {(int(k), n): family.interval(int(k), n) for n in range(8, 65, 8) for k in range(n + 1)}
    missed = [any(intervals[int(k), 8 * (at + 1)].upper < rate for at, k in enumerate(row)) for row in passed]
    alone = [any(wilson(int(k), 8 * (at + 1), 0.9).upper < rate for at, k in enumerate(row)) for row in passed]
    assert np.mean(missed) <= 0.05 < np.mean(alone)


def test_wilson_s_interval_would_miss_forty_times_as_often_as_it_may():
    """The reason for exact ones: 7 of 8 come of a rate of 0.995 in 4 % of all groups, and Wilson's misses it then."""
    family, seven = IntervalFamily(size=48, confidence=0.95), np.array(7.0)
    assert wilson_bounds(seven, np.array(8.0), family.each)[1] < 0.995 < family.interval(7, 8).upper
    assert math.comb(8, 7) * 0.995**7 * 0.005 > 37 * (1.0 - family.each)


@given(group_counts, st.floats(1e-9, 0.49))
def test_exact_bounds_have_the_bits_of_scipys(count: tuple[int, int], tail: float):
    (shown, n), found = count, clopper_pearson(*count, tail)
    assert found.lower == (float(beta.ppf(tail, shown, n - shown + 1)) if shown else 0.0)
    assert found.upper == (float(beta.ppf(1.0 - tail, shown + 1, n - shown)) if shown < n else 1.0)


def test_a_group_without_episodes_says_nothing():
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


def test_one_stratum_has_the_exact_interval():
    found = stratum_interval(Stratum(384, 24, 0.0), 0.95)
    assert (found.lower, found.upper) == pytest.approx((0.0, 1 - 0.025 ** (1 / 24)))
    assert total_interval([Stratum(384, 24, 0.0)], 0.95) == found


def test_the_audit_computes_the_same_bounds():
    strata = [Stratum(360, 24, 1 / 24), Stratum(24, 7.5, 0.25)]
    assert share_bounds(0.25, 7.5, 0.95) == tuple(stratum_interval(strata[1], 0.95).model_dump().values())
    bounds = [share_bounds(each.rate, each.effective, 0.95) for each in strata]
    theirs = total_share(
        [
            FlipShare(episodes=each.episodes, rate=each.rate, lower=lower, upper=upper)
            for each, (lower, upper) in zip(strata, bounds, strict=True)
        ]
    )
    ours = total_interval(strata, 0.95)
    assert (theirs.rate, theirs.lower, theirs.upper) == pytest.approx((total_rate(strata), ours.lower, ours.upper))


def test_of_nothing_everything_is_possible():
    assert total_interval([], 0.95) == Interval(lower=0.0, upper=1.0)
    with pytest.raises(ValueError, match="effective > 0"):
        stratum_interval(Stratum(1, 0, 0.0), 0.95)


@pytest.mark.parametrize("failed", [0.02, 0.1, 0.5])
@pytest.mark.parametrize(("passes", "failures"), [(0.0, 0.05), (0.01, 0.05), (0.05, 0.05), (0.02, 0.5), (0.2, 0.2)])
def test_the_interval_of_two_strata_covers(failed: float, passes: float, failures: float):
    """By enumeration of all outcomes of 24 and 8 lanes."""
    truth, covered = (1 - failed) * passes + failed * failures, 0.0
    for one, other in itertools.product(range(25), range(9)):
        chance = _binomial(one, 24, passes) * _binomial(other, 8, failures)
        if chance > 1e-9:
            found = total_interval([Stratum(1 - failed, 24, one / 24), Stratum(failed, 8, other / 8)], 0.95)
            covered += chance * (found.lower <= truth <= found.upper)
    assert covered >= 0.95


def _binomial(count: int, n: int, rate: float) -> float:
    return comb(n, count) * rate**count * (1 - rate) ** (n - count)


@pytest.mark.parametrize(("at_most", "lanes"), [(0.2, 17), (0.1, 36), (0.05, 72)])
def test_so_many_lanes_show_a_small_share(at_most: float, lanes: int):
    assert lanes_needed(at_most, 0.95) == lanes
    assert total_interval([Stratum(9, lanes, 0.0)], 0.95).upper <= at_most
    assert total_interval([Stratum(9, lanes - 1, 0.0)], 0.95).upper > at_most


def test_what_is_lost_lowers_the_bound_and_never_raises_it():
    assert discounted_bound(0.98, 0.96, 0.0, 0.0) == pytest.approx(0.96)
    assert discounted_bound(0.98, 0.96, 0.04, 0.2) == pytest.approx(0.98 * 0.96 - (0.02**2 + (0.98 * 0.16) ** 2) ** 0.5)
    assert discounted_bound(0.5, 0.1, 0.9, 1.0) == 0.0


text_counts = st.integers(1, 5000).flatmap(lambda episodes: st.tuples(st.integers(0, episodes), st.just(episodes)))


@pytest.mark.parametrize(
    ("worlds", "here", "elsewhere"),
    [
        (0, "in no world", "in no world"),
        (1, "in this 1 world", "in worlds like this 1"),
        (8, "in these 8 worlds", "in worlds like these 8"),
        (1200, "in these 1,200 worlds", "in worlds like these 1,200"),
    ],
)
def test_it_is_of_these_worlds_or_of_worlds_like_these(worlds: int, here: str, elsewhere: str):
    assert (in_worlds(worlds), in_worlds(worlds, like_these=True)) == (here, elsewhere)


@given(text_counts)
def test_only_all_is_printed_as_all_and_only_none_as_none(count: tuple[int, int]):
    successes, episodes = count
    shown = percent(successes / episodes)
    assert (shown == "100.0\u00a0%") == (successes == episodes)
    assert (shown == "0.0\u00a0%") == (successes == 0)
