"""The comparison of two versions at looks: exact tails, an interval that says what the test says, seldom wrong."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tasks.results.statistics.interim_analyses import difference_tail, paired_interval
from tasks.results.statistics.intervals import Interval, paired_difference

LOOKS = (16, 32, 48, 64)
pairs = st.sampled_from(LOOKS).flatmap(
    lambda n: st.integers(0, n).flatmap(lambda gains: st.tuples(st.just(gains), st.integers(0, n - gains), st.just(n)))
)


def test_the_tail_is_the_sum_over_all_that_might_have_been_seen():
    gains, losses, n, difference = 3, 1, 9, -0.1
    # The share of losses that is likeliest under the difference, found by trying.
    tried = np.arange(0.1, 0.55, 1e-5)
    likelihood = gains * np.log(np.maximum(tried + difference, 1e-300)) + losses * np.log(tried)
    likelihood += (n - gains - losses) * np.log(np.maximum(1.0 - 2.0 * tried - difference, 1e-300))
    lost = float(tried[np.argmax(likelihood)])
    gained, rest = lost + difference, 1.0 - 2.0 * lost - difference
    exact = sum(
        math.comb(n, up) * math.comb(n - up, down) * gained**up * lost**down * rest ** (n - up - down)
        for up, down in itertools.product(range(n + 1), repeat=2)
        if up + down <= n and up - down >= gains - losses
    )
    assert difference_tail(gains, losses, n, difference) == pytest.approx(exact, rel=1e-3)


def test_without_disagreement_the_tail_is_that_no_loss_was_seen():
    assert difference_tail(0, 0, 50, -0.05) == pytest.approx(0.95**50)


@settings(max_examples=40)
@given(pairs)
def test_the_interval_holds_the_estimate_and_mirrors_what_the_other_version_gains(found: tuple[int, int, int]):
    gains, losses, n = found
    interval, mirrored = paired_interval(gains, losses, n, LOOKS, 0.95), paired_interval(losses, gains, n, LOOKS, 0.95)
    assert -1.0 <= interval.lower <= (gains - losses) / n <= interval.upper <= 1.0
    assert (interval.lower, interval.upper) == (-mirrored.upper, -mirrored.lower)


def test_at_the_end_it_is_wider_than_that_of_one_look_and_not_much():
    interval, alone = paired_interval(4, 3, 64, LOOKS, 0.95), paired_difference(4, 3, 64, 0.95)
    assert interval.lower < alone.lower
    assert interval.lower - alone.lower > -0.05


def test_nothing_counted_says_nothing_and_what_is_no_look_is_refused():
    assert paired_interval(0, 0, 0, LOOKS, 0.95) == Interval(lower=-1.0, upper=1.0)
    with pytest.raises(ValueError, match="one of the looks"):
        paired_interval(0, 0, 17, LOOKS, 0.95)


@pytest.mark.long
@pytest.mark.parametrize(("margin", "disagreeing"), [(0.05, 0.05), (0.05, 0.1)])
def test_of_versions_that_are_worse_by_the_margin_no_more_than_a_fortieth_is_ever_found_no_worse_or_worse(
    margin: float, disagreeing: float
):
    looks, batches = (48, 96, 144, 192), 4_000
    drawn, better = np.random.default_rng(5).random((batches, looks[-1])), (disagreeing - margin) / 2.0
    gains = np.cumsum(drawn < better, axis=1)
    losses = np.cumsum((drawn >= better) & (drawn < disagreeing), axis=1)
    passed, failed = np.zeros(batches, dtype=bool), np.zeros(batches, dtype=bool)
    for n in looks:
        counted = np.stack([gains[:, n - 1], losses[:, n - 1]], axis=1)
        kinds, kind = np.unique(counted, axis=0, return_inverse=True)
        found = [paired_interval(int(up), int(down), n, looks, 0.95) for up, down in kinds]
        passed |= np.array([each.lower >= -margin for each in found])[kind.ravel()]
        failed |= np.array([each.upper < -margin for each in found])[kind.ravel()]
    assert passed.mean() <= 0.025
    assert failed.mean() <= 0.025
