"""The interval of a rate in worlds like these: an independent formula, what must always hold, how often it covers."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import betabinom, binom, chi2, t

from benchmarks.statistics.rates import shown
from benchmarks.statistics.simulated_worlds import beta
from tasks.results.statistics.intervals import Interval, wilson
from tasks.results.statistics.over_worlds import rate_over_worlds, rates_shown

worlds = st.lists(
    st.integers(1, 20).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))), min_size=2, max_size=9
)
few = settings(max_examples=8)


def interval(counts: list[tuple[int, int]], confidence: float = 0.95) -> Interval:
    return rate_over_worlds([passed for passed, _ in counts], [n for _, n in counts], confidence)


@given(worlds, st.sampled_from([0.8, 0.95, 0.99]))
@few
def test_it_holds_the_rate_and_wilsons_interval(counts: list[tuple[int, int]], confidence: float):
    passed, n = sum(count[0] for count in counts), sum(count[1] for count in counts)
    found, plain = interval(counts, confidence), wilson(passed, n, confidence)
    assert 0.0 <= found.lower <= plain.lower <= passed / n <= plain.upper <= found.upper <= 1.0


@given(worlds)
@few
def test_failures_instead_of_successes_turn_it_over(counts: list[tuple[int, int]]):
    found, turned = interval(counts), interval([(n - passed, n) for passed, n in counts])
    assert turned.lower == pytest.approx(1.0 - found.upper, abs=1e-6)
    assert turned.upper == pytest.approx(1.0 - found.lower, abs=1e-6)


@given(worlds, st.integers(0, 99))
@few
def test_the_order_of_worlds_does_not_matter(counts: list[tuple[int, int]], seed: int):
    mixed = [counts[k] for k in np.random.default_rng(seed).permutation(len(counts))]
    assert interval(mixed).lower == pytest.approx(interval(counts).lower, abs=1e-6)
    assert interval(mixed).upper == pytest.approx(interval(counts).upper, abs=1e-6)


@given(worlds)
@few
def test_more_confidence_never_narrows_it(counts: list[tuple[int, int]]):
    narrow, wide = interval(counts, 0.8), interval(counts, 0.99)
    assert wide.lower <= narrow.lower <= narrow.upper <= wide.upper


@given(worlds, st.floats(0.02, 0.98))
@few
def test_many_data_sets_at_once_show_what_the_intervals_show(counts: list[tuple[int, int]], rate: float):
    found = interval(counts)
    above, below = rates_shown(np.array([[p for p, _ in counts]]), np.array([n for _, n in counts]), rate, 0.95)
    if min(abs(found.lower - rate), abs(found.upper - rate)) > 1e-6:
        assert (bool(above[0]), bool(below[0])) == (found.lower > rate, found.upper < rate)


def test_it_is_what_a_search_with_scipys_distribution_finds():
    passed, n = np.array([40, 45, 48, 47, 30, 46, 44, 41]), np.full(8, 48)
    totals = np.geomspace(0.1, 1e4, 400)

    def likelihood(rate: float) -> float:
        chances = betabinom.logpmf(passed[:, None], n[:, None], rate * totals, (1.0 - rate) * totals)
        return float(chances.sum(axis=0).max())

    highest = max(likelihood(rate) for rate in np.linspace(0.8, 0.95, 151))
    # Failures in eight worlds are not few: t(7)^2 / 2 is more than the Poisson bound asks for.
    near = t.ppf(0.975, 7) ** 2 / 2.0
    found = rate_over_worlds(passed.tolist(), n.tolist(), 0.95)
    assert likelihood(found.lower) == pytest.approx(highest - near, abs=0.01)
    assert likelihood(found.upper) == pytest.approx(highest - near, abs=0.01)


def test_worlds_that_all_pass_are_as_many_witnesses_as_there_are_worlds():
    # Worlds may pass all or nothing: then K worlds are K episodes, the bound is exp(-chi2(2) / 2 / K) = .025^(1 / K).
    assert chi2.ppf(0.975, 2) / 2 == pytest.approx(-np.log(0.025))
    for count in (8, 16, 48):
        assert rate_over_worlds([24] * count, [24] * count, 0.95).lower == pytest.approx(0.025 ** (1 / count), abs=1e-4)


def test_worlds_with_a_failure_each_are_alike_and_say_more():
    assert rate_over_worlds([47] * 8, [48] * 8, 0.95).lower > 0.9 > rate_over_worlds([48] * 8, [48] * 8, 0.95).lower


def test_one_episode_in_each_world_is_an_ordinary_share():
    found = rate_over_worlds([1] * 380 + [0] * 20, [1] * 400, 0.95)
    assert binom.cdf(379, 400, found.lower) > 0.97  # 380 or more have less than 3 % at the lower end
    assert found.lower == pytest.approx(wilson(380, 400, 0.95).lower, abs=0.004)


def test_one_world_says_nothing_of_others():
    assert rate_over_worlds([48], [48], 0.95) == Interval(lower=0.0, upper=1.0)
    assert rate_over_worlds([], [], 0.95) == Interval(lower=0.0, upper=1.0)


@pytest.mark.parametrize(
    ("successes", "n", "confidence"),
    [([2, 1], [1, 1], 0.9), ([-1, 1], [1, 1], 0.9), ([0, 0], [0, 1], 0.9), ([1], [1, 1], 0.9), ([1, 2], [1, 1], 0.9)],
)
def test_numbers_that_are_no_counts_are_refused(successes: list[int], n: list[int], confidence: float):
    with pytest.raises(ValueError, match="successes"):
        rate_over_worlds(successes, n, confidence)


# 1,000 batches: the standard error of 95 % is 0.7 points. docs/reference/statistics.md has 4,000 of more designs.
@pytest.mark.parametrize(("count", "n", "rate", "icc"), [(16, 24, 0.95, 0.3), (48, 8, 0.98, 0.1)])
def test_it_covers_worlds_that_differ(count: int, n: int, rate: float, icc: float):
    above, below = shown(count, n, beta(rate, icc), rate, replicates=1_000)
    assert above <= 0.04
    assert above + below <= 0.065
