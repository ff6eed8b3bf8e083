"""The test that may be looked at any time: it errs no more often than it says, whenever one stops."""

import bisect
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jaxtyping import Bool, Int

from tasks.results.statistics.anytime import confidence_sequence, log_capital_above, log_capital_below
from tasks.results.statistics.intervals import Interval, wilson

BATCHES, EPISODES, ALPHA = 2_000, 384, 0.05
counts = st.integers(1, 400).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n)))


LOOKS = range(8, EPISODES + 1, 8)
ENOUGH = math.log(2 / ALPHA)
Batches = Int[np.ndarray, "batches episodes"]


def least(n: int, bar: float) -> int:
    """Returns how many of n must pass to be found above the bar; more than n if none do."""
    return bisect.bisect_left(
        range(n + 1), x=True, key=lambda s: s >= n * bar and log_capital_above(s, n, bar) >= ENOUGH
    )


def most(n: int, bar: float) -> int:
    """Returns how many of n may pass to be found below the bar; -1 if none do."""
    return n - least(n, 1.0 - bar)


def called(successes: Batches, bar: float) -> tuple[float, float]:
    """Returns the shares of batches that were ever found above the bar, and below it, by running numbers of successes.

    The bet below is the bet above with failures for successes, which another test shows.
    """
    above = np.any([successes[:, n - 1] >= least(n, bar) for n in LOOKS], axis=0)
    below = np.any([successes[:, n - 1] <= most(n, bar) for n in LOOKS], axis=0)
    return float(above.mean()), float(below.mean())


def running(passes: Bool[np.ndarray, "batches episodes"]) -> Batches:
    return np.cumsum(passes, axis=1, dtype=np.int64)


@pytest.mark.parametrize("bar", [0.9, 0.5])
def test_of_2000_batches_at_the_bar_no_more_than_alpha_are_ever_called_above_or_below(bar: float):
    drawn = np.random.default_rng(7).random((BATCHES, EPISODES)) < bar
    above, below = called(running(drawn), bar)
    assert above + below <= ALPHA
    assert above > 0.0  # it can err, so that the simulation shows something


def test_an_interval_that_is_looked_at_again_and_again_errs_more_often_than_it_says():
    # Why there is a test of its own: Wilson's interval, stopped as soon as it is above the bar, in the same batches.
    successes = running(np.random.default_rng(7).random((BATCHES, EPISODES)) < 0.9)

    def enough(n: int) -> int:
        return bisect.bisect_left(range(n + 1), x=True, key=lambda s: wilson(s, n, 0.95).lower > 0.9)

    above = np.any([successes[:, n - 1] >= enough(n) for n in LOOKS], axis=0)
    assert above.mean() > 2 * ALPHA


def test_worlds_of_different_difficulty_in_a_shuffled_order_lead_to_no_more_errors():
    # 8 worlds, half of them hopeless every fifth time, so that the batch's rate is the bar; shuffled, as batches are.
    generator = np.random.default_rng(11)
    chance = np.repeat([0.8, 0.8, 0.8, 0.8, 1.0, 1.0, 1.0, 1.0], EPISODES // 8)
    drawn = generator.permuted(generator.random((BATCHES, EPISODES)) < chance, axis=1)
    above, below = called(running(drawn), 0.9)
    assert above + below <= ALPHA


def test_worlds_in_their_own_order_would_lead_to_errors():
    # The same worlds unshuffled: the easy ones come first, and half of the batch passes without a failure.
    chance = np.repeat([1.0, 1.0, 1.0, 1.0, 0.8, 0.8, 0.8, 0.8], EPISODES // 8)
    drawn = np.random.default_rng(11).random((BATCHES, EPISODES)) < chance
    above, _ = called(running(drawn), 0.9)
    assert above == 1.0


def test_it_is_sure_long_before_the_end_of_a_batch_when_the_answer_is_clear():
    successes = running(np.random.default_rng(5).random((BATCHES, EPISODES)) < 0.99)
    assert called(successes, 0.9)[0] == 1.0
    half = EPISODES // 2
    assert (successes[:, half - 1] >= least(half, 0.9)).mean() > 0.99


@given(counts, st.floats(0.02, 0.98), st.floats(0.5, 0.999))
def test_the_interval_ends_where_the_bet_has_grown_enough(count: tuple[int, int], bar: float, confidence: float):
    successes, n = count
    interval, enough = confidence_sequence(successes, n, confidence), math.log(2 / (1 - confidence))
    near = 1e-6
    if bar + near < interval.lower:
        assert log_capital_above(successes, n, bar) >= enough
    if bar - near > interval.upper:
        assert log_capital_below(successes, n, bar) >= enough
    if interval.lower + near < bar < interval.upper - near:
        assert log_capital_above(successes, n, bar) < enough
        assert log_capital_below(successes, n, bar) < enough


@given(counts, st.floats(0.5, 0.999))
def test_the_interval_holds_the_estimate_and_mirrors_what_failed(count: tuple[int, int], confidence: float):
    successes, n = count
    interval, mirrored = (
        confidence_sequence(successes, n, confidence),
        confidence_sequence(n - successes, n, confidence),
    )
    assert 0.0 <= interval.lower <= successes / n <= interval.upper <= 1.0
    assert interval.lower == pytest.approx(1.0 - mirrored.upper, abs=2e-9)


@given(counts, st.floats(0.02, 0.98))
def test_the_bet_below_is_the_bet_above_on_failures(count: tuple[int, int], bar: float):
    successes, n = count
    assert log_capital_below(successes, n, bar) == log_capital_above(n - successes, n, 1.0 - bar)


def test_nothing_counted_says_nothing():
    assert confidence_sequence(0, 0, 0.95) == Interval(lower=0.0, upper=1.0)


def test_the_capital_is_what_the_integral_over_the_alternatives_gives():
    from scipy.integrate import quad  # noqa: PLC0415

    def density(share: float) -> float:
        return share**-0.5 * (1.0 - share) ** -0.5

    likelihood, _ = quad(lambda share: density(share) * share**18 * (1.0 - share) ** 2, 0.7, 1.0)
    weight, _ = quad(density, 0.7, 1.0)
    expected = math.log(likelihood / weight) - 18 * math.log(0.7) - 2 * math.log(0.3)
    assert log_capital_above(18, 20, 0.7) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("wrong", [(3, 2, 0.5), (-1, 2, 0.5), (1, 2, 0.0), (1, 2, 1.0)])
def test_numbers_that_are_no_count_are_refused(wrong: tuple[int, int, float]):
    with pytest.raises(ValueError, match="successes"):
        log_capital_above(*wrong)
