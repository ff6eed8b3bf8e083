"""The likelihood of counts by world: scipy's distribution, and a search that knows nothing of Newton."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.special import gammaln
from scipy.stats import betabinom, dirichlet_multinomial

from tasks.results.statistics.dirichlet_multinomial import SPREADS, peak, profile, tails

counts = st.integers(2, 6).flatmap(
    lambda worlds: st.lists(st.integers(0, 12), min_size=worlds, max_size=worlds).filter(
        lambda x: 0 < sum(x) < 12 * worlds
    )
)


@given(counts, st.floats(0.05, 0.95))
@settings(max_examples=8)
def test_the_profile_of_a_rate_is_the_best_beta_binomial_likelihood(passed: list[int], rate: float):
    successes, n = np.array(passed), np.full(len(passed), 12)
    theirs = max(
        betabinom.logpmf(successes, n, rate / spread, (1 - rate) / spread).sum() for spread in SPREADS[1:]
    ) - _choices(successes, n)
    ours = profile(tails(np.stack([successes, n - successes])[:, None]), np.array([rate, 1 - rate]))[0]
    assert theirs - 1e-6 <= ours <= theirs + 0.02


@given(counts)
@settings(max_examples=5)
def test_the_peak_is_what_a_search_over_rates_and_spreads_finds(passed: list[int]):
    successes, n = np.array(passed), np.full(len(passed), 12)
    data = tails(np.stack([successes, n - successes])[:, None])
    start = np.array([[successes.sum()], [(n - successes).sum()]]) / n.sum()
    ours = peak(data, start, np.array([[1.0, -1.0]])).value[0]
    theirs = max(profile(data, np.array([rate, 1 - rate]))[0] for rate in np.linspace(0.01, 0.99, 99))
    assert theirs - 1e-4 <= ours <= theirs + 0.05


def test_three_ends_are_scipys_dirichlet_multinomial():
    counted = np.array([[3, 0, 5], [1, 1, 6], [0, 4, 4]])
    data = tails(counted.T[:, None, :])
    start = counted.sum(axis=0)[:, None] / counted.sum()
    found = peak(data, start, np.array([[1.0, 0.0, -1.0], [0.0, 1.0, -1.0]]))

    def unlikely(at: np.ndarray) -> float:
        return -dirichlet_multinomial(np.exp(at), [8, 8, 8]).logpmf(counted).sum()

    theirs = minimize(
        unlikely, np.zeros(3), method="Nelder-Mead", options={"maxiter": 4000, "fatol": 1e-9, "xatol": 1e-7}
    )
    choices = sum(gammaln(9) - gammaln(row + 1).sum() for row in counted)
    assert found.value[0] == pytest.approx(-theirs.fun - choices, abs=0.01)
    assert found.shares[:, 0] == pytest.approx(np.exp(theirs.x) / np.exp(theirs.x).sum(), abs=0.01)


def test_data_sets_together_have_the_likelihoods_that_they_have_alone():
    successes = np.random.default_rng(1).binomial(10, 0.8, (7, 4))
    both = np.stack([successes, 10 - successes])
    start = both.sum(axis=2) / 40
    together = peak(tails(both), start, np.array([[1.0, -1.0]])).value
    alone = [
        peak(tails(both[:, [row]]), start[:, [row]], np.array([[1.0, -1.0]])).value[0] for row in range(len(successes))
    ]
    assert together == pytest.approx(alone, abs=1e-9)


def _choices(successes: np.ndarray, n: np.ndarray) -> float:
    """The logarithm of the ways to choose which episodes passed, which the likelihood leaves out."""
    return float((gammaln(n + 1) - gammaln(successes + 1) - gammaln(n - successes + 1)).sum())
