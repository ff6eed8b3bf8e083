"""How many episodes, pairs and worlds a rule needs: what its own interval says, by enumeration and by simulation."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import binom

from tasks.results.statistics.intervals import paired_difference, quantile_ranks, wilson
from tasks.results.statistics.over_worlds import rate_over_worlds, rates_shown
from tasks.results.statistics.power import (
    PowerNeeds,
    at_most,
    effective_episodes,
    pair_needs,
    pair_power,
    quantile_needs,
    share_needs,
    world_needs,
)


def share_power(n: int, bar: float, rate: float) -> float:
    passing = (k for k in range(math.floor(bar * n), n + 1) if wilson(k, n, 0.95).lower >= bar)
    fewest = next(passing, n + 1)
    return float(binom.sf(fewest - 1, n, rate))


def test_a_rate_of_95_percent_against_a_bar_of_90_needs_what_the_design_note_measured():
    needs = share_needs(0.9, 0.95, 0.95, 140)
    assert needs is not None
    assert (needs.for_80, needs.for_90) == (254, 315)
    assert needs.power == pytest.approx(min(share_power(n, 0.9, 0.95) for n in range(140, 200)), abs=1e-9)


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
    assert needs.power == pytest.approx(min(power(n) for n in range(300, 420)), abs=1e-9)


# 7 of 15 needed episodes were NOT ENOUGH, with a power of 86 %: right there, and less with a few more.
@pytest.mark.parametrize(
    "needs",
    [
        lambda there: share_needs(0.8, 0.8, 0.98, there),
        lambda there: quantile_needs(0.2, 0.8, 0.02, there),
        lambda there: pair_needs(0.1, 0.8, 0.02, there),
        lambda there: world_needs(0.8, 0.9, 0.95, icc=0.1, per_world=4, there=there),
    ],
    ids=["share", "quantile", "pairs", "worlds"],
)
def test_the_power_says_what_the_needed_numbers_say(needs: Callable[[int], PowerNeeds | None]):
    found = [each for there in range(1, 40) if (each := needs(there))]
    assert len(found) == 39
    for there, (for_80, for_90, power) in enumerate(found, start=1):
        assert (power >= 0.8, power >= 0.9) == (there >= for_80, there >= for_90)


def test_the_power_never_falls_with_more_episodes():
    powers = [found.power for there in range(1, 90) if (found := share_needs(0.8, 0.8, 0.98, there))]
    assert powers == sorted(powers)


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


Z = 1.959963984540054


def power(n: int, margin: float, disagreeing: float) -> float:
    total = 0.0
    for unlike in range(int(binom.ppf(1 - 1e-9, n, disagreeing)) + 1):
        passing = (g for g in range(unlike + 1) if paired_difference(g, unlike - g, n, 0.95).lower >= -margin)
        fewest = next(passing, unlike + 1)
        total += binom.pmf(unlike, n, disagreeing) * binom.sf(fewest - 1, unlike, 0.5)
    return float(total)


def test_the_power_is_that_of_the_interval_which_the_gate_uses():
    counted = pair_power(np.array([60, 205]), 0.05, Z, 0.05)
    assert counted == pytest.approx([power(60, 0.05, 0.05), power(205, 0.05, 0.05)], abs=1e-6)


def test_five_points_and_five_percent_that_disagree_need_what_was_measured():
    needs = pair_needs(0.05, 0.95, 0.05, 132)
    assert needs is not None
    assert (needs.for_80, needs.for_90) == (205, 266)  # 258 have 90.4 %, and 265 have 89.8 %
    assert needs.power == pytest.approx(0.58, abs=0.01)


@pytest.mark.parametrize(("margin", "disagreeing"), [(0.02, 0.0), (0.05, 0.02)])
def test_from_the_needed_number_on_the_power_of_pairs_is_never_below(margin: float, disagreeing: float):
    needs = pair_needs(margin, 0.95, disagreeing, 0)
    assert needs is not None
    assert (pair_power(np.arange(needs.for_80, 2 * needs.for_80), margin, Z, disagreeing) >= 0.8).all()
    assert pair_power(np.array([needs.for_80 - 1]), margin, Z, disagreeing)[0] < 0.8


def test_no_number_of_pairs_shows_a_margin_of_nothing():
    assert pair_needs(0.0, 0.95, 0.05, 384) is None


@pytest.mark.parametrize(("rate", "icc", "per_world", "worlds"), [(0.95, 0.1, 8, 48), (0.98, 0.05, 8, 28)])
def test_the_power_of_worlds_is_near_that_of_the_gates_interval(rate: float, icc: float, per_world: int, worlds: int):
    rng, total, draws = np.random.default_rng(3), 1.0 / icc - 1.0, 400
    chances = rng.beta(rate * total, (1.0 - rate) * total, (draws, worlds))
    shown, _ = rates_shown(rng.binomial(per_world, chances), np.full(worlds, per_world), 0.9, 0.95)
    needs = world_needs(0.9, 0.95, rate, icc=icc, per_world=per_world, there=worlds)
    assert needs is not None
    assert needs.power == pytest.approx(shown.mean(), abs=0.08)


def test_worlds_that_are_more_alike_inside_are_needed_in_greater_number():
    needs = [world_needs(0.9, 0.95, 0.95, icc=icc, per_world=8, there=48) for icc in (0.0, 0.1)]
    assert needs[0] is not None
    assert needs[1] is not None
    assert needs[0].for_80 < needs[0].for_90
    assert needs[0].for_80 < needs[1].for_80
    assert needs[0].power > needs[1].power


def test_worlds_without_a_failure_are_enough_when_the_gates_interval_says_so():
    needs = world_needs(0.9, 0.95, 1.0, icc=0.05, per_world=8, there=48)
    assert needs is not None
    assert rate_over_worlds([8] * needs.for_90, [8] * needs.for_90, 0.95).lower >= 0.9
    assert rate_over_worlds([8] * (needs.for_90 - 1), [8] * (needs.for_90 - 1), 0.95).lower < 0.9


def test_what_is_not_above_the_bar_is_shown_by_no_number_of_worlds():
    assert world_needs(0.9, 0.95, 0.9, icc=0.05, per_world=8, there=48) is None
