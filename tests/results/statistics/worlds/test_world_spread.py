"""ICC, design effect, and why nothing is said of other worlds."""

import numpy as np
import pytest

from benchmarks.statistics.simulated_worlds import beta
from tasks.results.statistics.over_worlds import why_refused, world_spread


def test_the_correlation_is_that_of_the_analysis_of_variance():
    passed, n = np.array([40, 45, 48, 47, 30]), 48
    outcomes = np.array([[1.0] * count + [0.0] * (n - count) for count in passed])
    between = n * outcomes.mean(axis=1).var(ddof=1)
    within = outcomes.var(axis=1, ddof=1).mean()
    found = world_spread(passed.tolist(), [n] * 5)
    assert found.icc == pytest.approx((between - within) / (between + (n - 1) * within))
    assert found.design_effect == pytest.approx(1 + (n - 1) * (found.icc or 0.0))
    assert found.independent_episodes == pytest.approx(240 / (found.design_effect or 1.0))


def test_it_finds_the_correlation_of_worlds_that_were_drawn_with_one():
    random = np.random.default_rng(3)
    n = random.integers(5, 40, 2_000)
    passed = random.binomial(n, beta(0.8, 0.2)(random, (1, 2_000))[0])
    assert world_spread(passed.tolist(), n.tolist()).icc == pytest.approx(0.2, abs=0.02)


def test_worlds_that_pass_all_or_nothing_are_worth_one_episode_each():
    found = world_spread([48, 48, 0, 48], [48] * 4)
    assert (found.icc, found.independent_episodes) == (1.0, 4.0)


def test_worlds_that_are_more_alike_than_chance_have_no_correlation():
    found = world_spread([24] * 8, [48] * 8)
    assert (found.icc, found.design_effect, found.independent_episodes) == (0.0, 1.0, 384.0)


@pytest.mark.parametrize(
    ("passed", "n"), [([48, 48], [48, 48]), ([0, 0], [48, 48]), ([3], [8]), ([1, 0], [1, 1]), ([], [])]
)
def test_counts_that_do_not_show_a_correlation_have_none(passed: list[int], n: list[int]):
    found = world_spread(passed, n)
    assert (found.icc, found.design_effect, found.independent_episodes) == (None, None, None)


def test_worlds_without_episodes_do_not_count():
    assert world_spread([3, 0, 5], [8, 0, 8]) == world_spread([3, 5], [8, 8])


def test_numbers_that_are_no_counts_are_refused():
    with pytest.raises(ValueError, match="successes"):
        world_spread([3], [2])


def test_a_refusal_says_how_many_worlds_are_enough():
    assert why_refused("rate", 8) == why_refused("difference", 2) == why_refused("quantile", 8, tail=0.5) == ""
    assert why_refused("rate", 1) == "1 world says nothing of other worlds: draw 2 or more"
    assert why_refused("quantile", 8, tail=0.05).endswith("5 % of the values end: draw 40 or more")
    assert why_refused("quantile", 40, tail=0.05) == ""
