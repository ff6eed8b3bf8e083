"""Episodes for a power: as many as an exact count of all outcomes finds, with the intervals that the gate uses."""

import math

import pytest
from scipy.stats import binom

from tasks.results.statistics.intervals import quantile_ranks, wilson
from tasks.results.statistics.power import at_most, effective_episodes, quantile_needs, share_needs


def share_power(n: int, bar: float, rate: float) -> float:
    passing = (k for k in range(math.floor(bar * n), n + 1) if wilson(k, n, 0.95).lower >= bar)
    fewest = next(passing, n + 1)
    return float(binom.sf(fewest - 1, n, rate))


def test_a_rate_of_95_percent_against_a_bar_of_90_needs_what_the_design_note_measured():
    needs = share_needs(0.9, 0.95, 0.95, 140)
    assert needs is not None
    assert (needs.for_80, needs.for_90) == (254, 315)
    assert needs.power == pytest.approx(share_power(140, 0.9, 0.95), abs=1e-9)


@pytest.mark.parametrize(("bar", "rate", "wanted"), [(0.9, 0.98, 0.8), (0.8, 0.9, 0.9), (0.5, 0.75, 0.8)])
def test_from_the_needed_number_on_the_power_is_never_below(bar: float, rate: float, wanted: float):
    needs = share_needs(bar, 0.95, rate, 1)
    assert needs is not None
    needed = needs.for_80 if wanted == 0.8 else needs.for_90
    assert share_power(needed - 1, bar, rate) < wanted
    assert all(share_power(n, bar, rate) >= wanted for n in range(needed, needed + 25))


def test_a_quantile_is_counted_by_its_ranks():
    needs = quantile_needs(0.05, 0.95, 0.02, 300)
    assert needs is not None

    def power(n: int) -> float:
        return float(binom.cdf(quantile_ranks(n, 0.05, 0.95)[0] - 1, n, 0.02))

    assert power(needs.for_80 - 1) < 0.8
    assert all(power(n) >= 0.8 for n in range(needs.for_80, needs.for_80 + 60))
    assert needs.power == pytest.approx(power(300), abs=1e-9)


def test_what_is_not_above_the_bar_needs_a_number_that_there_is_not():
    assert share_needs(0.9, 0.95, 0.9, 384) is None
    assert quantile_needs(0.05, 0.95, 0.05, 384) is None
    assert share_needs(0.0, 0.95, 0.5, 3) == (1, 1, 1.0)


@pytest.mark.parametrize(("count", "n", "chance"), [(0, 10, 0.3), (7, 10, 0.3), (3, 400, 0.02), (500, 900, 0.5)])
def test_the_binomial_sum_is_scipys(count: int, n: int, chance: float):
    assert at_most(count, n, chance) == pytest.approx(float(binom.cdf(count, n, chance)), rel=1e-9)


def test_more_worlds_with_fewer_seeds_are_worth_more_independent_episodes():
    worth = [effective_episodes(worlds, 384 // worlds, 0.1) for worlds in (8, 48, 384)]
    assert worth == pytest.approx([67.4, 225.9, 384.0], abs=0.05)
