"""Shares from strata: exact where one stratum is all, covered where there are two, and no wider than need be."""

import itertools
from math import comb

import pytest

from tasks.results.statistics.intervals import (
    Interval,
    Stratum,
    lanes_needed,
    less_lost,
    stratum_interval,
    total_interval,
    total_rate,
)
from tasks.simulate.audit.audit_report import FlipShare, share_bounds, total_share


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
    assert less_lost(0.98, 0.96, 0.0, 0.0) == pytest.approx(0.96)
    assert less_lost(0.98, 0.96, 0.04, 0.2) == pytest.approx(0.98 * 0.96 - (0.02**2 + (0.98 * 0.16) ** 2) ** 0.5)
    assert less_lost(0.5, 0.1, 0.9, 1.0) == 0.0
