"""Confidence intervals of shares, of differences of shares and of quantiles, and how they are written in words.

All intervals are two-sided; the distributions are scipy's. scipy takes a second to import, and most commands judge
nothing, so that it is imported where it is needed.

A rate that was measured in eight worlds is the rate in these eight, with other seeds. What it is in worlds like them is
another question, with a wider interval (`tasks.results.statistics.over_worlds`). Wherever an interval stands, a phrase
of this module says which one it is.
"""

import math
from collections.abc import Sequence
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from specs.base import Spec

_Counts = int | Int[np.ndarray, "..."]
_Numbers = float | Float[np.ndarray, "..."]


class Interval(Spec):
    """Two bounds, the lower first; of a share 0-1, of a difference of shares -1 to 1."""

    lower: float
    upper: float


def wilson(successes: int, n: int, confidence: float) -> Interval:
    """Returns the two-sided score interval of a share (Wilson 1927, JASA 22:209), without continuity correction.

    Args:
        successes: 0 to ``n``.
        n: How many were counted; none says nothing, so the interval is then 0 to 1.
        confidence: Coverage, between 0 and 1.

    Raises:
        ValueError: The numbers are not such.
    """
    if not (0 <= successes <= n and 0.0 < confidence < 1.0):
        raise ValueError(f"{successes} successes of {n} with confidence {confidence}: 0 <= successes <= n, 0 < c < 1")
    if n == 0:
        return Interval(lower=0.0, upper=1.0)
    # The same bits as scipy.stats.binomtest, whose import takes half a second of the processor.
    from scipy.special import ndtri  # noqa: PLC0415

    lower, upper = _score_bounds(successes / n, n, ndtri(0.5 + 0.5 * confidence))
    return Interval(lower=float(lower) if successes else 0.0, upper=float(upper) if successes < n else 1.0)


def wilson_bounds(
    successes: Float[np.ndarray, "..."], n: Float[np.ndarray, "..."], confidence: float
) -> tuple[Float[np.ndarray, "..."], Float[np.ndarray, "..."]]:
    """Returns the lower and upper bounds of many shares at once, as `wilson` has them; it needs no scipy.

    Args:
        successes: Each 0 to ``n``.
        n: How many were counted, 1 at least.
        confidence: Coverage, between 0 and 1.
    """
    lower, upper = _score_bounds(successes / n, n, NormalDist().inv_cdf((1.0 + confidence) / 2.0))
    return np.maximum(lower, 0.0), np.minimum(upper, 1.0)


def clopper_pearson(shown: float, n: float, tail: float) -> Interval:
    """Returns the two-sided exact interval of a share (Clopper and Pearson 1934, Biometrika 26:404).

    It covers at least as often as asked for, whatever the share, and also where chances differ within a group, as they
    do between worlds: sums of unlike chances scatter less than those of equal ones (Hoeffding 1956, Annals of
    Mathematical Statistics 27:713). Counts need not be whole: those of weighted things are effective numbers (Korn and
    Graubard 1998, Survey Methodology 24:193).

    Args:
        shown: 0 to ``n``.
        n: How many were counted; none says nothing, so the interval is then 0 to 1.
        tail: How often each bound may miss, between 0 and 0.5.

    Raises:
        ValueError: The numbers are not such.
    """
    if not (0.0 <= shown <= n and 0.0 < tail < 0.5):
        raise ValueError(f"{shown} of {n} with tails of {tail}: 0 <= shown <= n, 0 < tail < 0.5")
    # The same bits as quantiles of scipy.stats.beta, whose import takes half a second of the processor.
    from scipy.special import betaincinv  # noqa: PLC0415

    return Interval(
        lower=float(betaincinv(shown, n - shown + 1.0, tail)) if shown > 0.0 else 0.0,
        upper=float(betaincinv(shown + 1.0, n - shown, 1.0 - tail)) if shown < n else 1.0,
    )


def weighted_count_interval(estimate: float, variance: float, one_more: float, tail: float) -> Interval:
    """Returns the interval of a share that is a sum of Poisson counts, each with a weight.

    It is that of Fay and Feuer 1997 (Statistics in Medicine 16:791): above, it allows for one more count.

    Args:
        estimate: The share.
        variance: Of it: the sum of the weights' squares.
        one_more: The weight of that one more; with the largest that a count may have, the upper bound always holds.
        tail: How often each bound may miss, between 0 and 0.5.
    """
    from scipy.special import gammaincinv  # noqa: PLC0415 - it takes long to load

    lower = float(gammaincinv(estimate**2 / variance, tail)) * variance / estimate if estimate > 0.0 else 0.0
    most, largest = estimate + one_more, variance + one_more**2
    upper = float(gammaincinv(most**2 / largest, 1.0 - tail)) * largest / most
    return Interval(lower=lower, upper=min(upper, 1.0))


def paired_difference(gains: int, losses: int, n: int, confidence: float) -> Interval:
    """Returns the score interval of the difference of two shares that were measured on the same n things.

    Tango 1998 (Statistics in Medicine 17:891): the differences at which the score statistic, with the nuisance
    parameter at its maximum likelihood, is within the normal quantile. Fagerland, Lydersen and Laake 2014 (Statistics
    in Medicine 33:2850) recommend it for small samples too. Its end at ``-margin`` is Tango's non-inferiority test.

    Args:
        gains: How many succeeded with the first and not with the second.
        losses: How many succeeded with the second and not with the first.
        n: How many pairs there are, those that agree included.
        confidence: Coverage, between 0 and 1.

    Raises:
        ValueError: The numbers are not such.
    """
    if not (gains >= 0 <= losses and gains + losses <= n and 0.0 < confidence < 1.0):
        raise ValueError(f"{gains} gains and {losses} losses of {n} pairs with confidence {confidence}")
    if n == 0:
        return Interval(lower=-1.0, upper=1.0)
    from scipy.special import ndtri  # noqa: PLC0415

    z = float(ndtri((1.0 + confidence) / 2.0))
    return Interval(lower=_score_bound(gains, losses, n, z), upper=-_score_bound(losses, gains, n, z))


def likeliest_losses(gains: _Counts, losses: _Counts, n: _Counts, difference: float) -> _Numbers:
    """Returns the share of losses that makes what was seen likeliest, if the difference is the one given (Tango 1998).

    Args:
        gains: Pairs that succeeded with the first and not with the second.
        losses: Pairs that succeeded with the second and not with the first.
        n: All pairs.
        difference: Between -1 and 1.
    """
    linear = (2 * n - gains + losses) * difference - gains - losses
    constant = -losses * difference * (1.0 - difference)
    return (np.sqrt(np.maximum(0.0, linear * linear - 8 * n * constant)) - linear) / (4 * n)


def mcnemar(gains: int, losses: int) -> float:
    """Returns the exact two-sided p-value of McNemar's test: that gains and losses are equally likely.

    McNemar 1947 (Psychometrika 12:153); of the pairs that disagree, each is a gain with probability 1/2.
    """
    if gains + losses == 0:
        return 1.0
    from scipy.stats import binomtest  # noqa: PLC0415

    return float(binomtest(gains, gains + losses, 0.5).pvalue)


def quantile_interval(values: Sequence[float], quantile: float, confidence: float) -> Interval:
    """Returns an interval of a quantile that holds whatever the distribution is: between two of the values.

    The number of values below the quantile is binomial, so the ranks are its quantiles (Conover 1999, Practical
    Nonparametric Statistics, section 3.2). Coverage is at least what is asked for. Where there are too few values
    for a bound, it is infinite.

    Args:
        values: In any order; infinite ones stand for what is not known but on that side.
        quantile: Between 0 and 1.
        confidence: Coverage, between 0 and 1.
    """
    lower, upper = quantile_ranks(len(values), quantile, confidence)
    ordered = sorted(values)
    return Interval(
        lower=ordered[lower - 1] if lower >= 1 else -math.inf,
        upper=ordered[upper - 1] if upper <= len(ordered) else math.inf,
    )


def quantile_ranks(n: int, quantile: float, confidence: float) -> tuple[int, int]:
    """Returns the ranks, from 1, of the values that bound a quantile; 0 and n + 1 where there is none.

    Raises:
        ValueError: The quantile or the confidence is not between 0 and 1.
    """
    if not (0.0 < quantile < 1.0 and 0.0 < confidence < 1.0):
        raise ValueError(f"quantile {quantile} with confidence {confidence}: both between 0 and 1")
    if n == 0:
        return 0, 1
    from scipy.stats import binom  # noqa: PLC0415

    tail = (1.0 - confidence) / 2.0
    # P(fewer than k of n are below) <= tail up to k = ppf(tail); the same from above.
    return int(binom.ppf(tail, n, quantile)), n + 1 - int(binom.ppf(tail, n, 1.0 - quantile))


def _score_bounds(rate: _Numbers, n: _Numbers, z: float) -> tuple[_Numbers, _Numbers]:
    """Returns the shares whose score is z below and above a rate that was seen (Wilson 1927)."""
    scale = 2 * (n + z**2)
    centre, reach = (2 * n * rate + z**2) / scale, z / scale * np.sqrt(4 * n * rate * (1 - rate) + z**2)
    return centre - reach, centre + reach


def _score_bound(gains: int, losses: int, n: int, z: float) -> float:
    """Returns the lowest difference at which the score is not above z."""
    estimate = (gains - losses) / n
    if estimate == -1.0:
        return -1.0
    from scipy.optimize import root_scalar  # noqa: PLC0415

    def excess(difference: float) -> float:
        return _score(gains, losses, n, difference) - z

    # Rounded outwards, to the same number on any machine.
    return math.floor(float(root_scalar(excess, bracket=(-1.0, estimate), xtol=1e-13).root) * 1e9) / 1e9


def _score(gains: int, losses: int, n: int, difference: float) -> float:
    """Returns Tango's statistic for a difference, standard normal where it is the true one."""
    lost = float(likeliest_losses(gains, losses, n, difference))
    variance = n * (2.0 * lost + difference * (1.0 - difference))
    above = gains - losses - n * difference
    if above == 0.0:
        return 0.0
    return above / math.sqrt(variance) if variance > 0.0 else math.copysign(math.inf, above)


# Of forty intervals, each at 95 %, two miss by chance, and a reader looks at the worst group first. A family of
# intervals shares what one may miss (Bonferroni): with any dependence between groups, all of them hold in at least as
# many reports as the confidence says. The intervals are exact ones. Wilson's, at the confidence that each then needs,
# miss too often near 1: docs/decisions/0032 has the figures.
class IntervalFamily(Spec):
    """How many intervals a page shows or selects from, and how sure all of them together are.

    Attributes:
        size: How many there are; those of groups that are left out because others are worse count, too.
        confidence: How often all of them hold, between 0 and 1.
        looks: At how many looks the batch might have been ended by what it showed, so that each holds at all of them; 0
            of a batch that was driven to its end.
    """

    size: int
    confidence: float
    looks: int = 0

    @property
    def each(self) -> float:
        """The confidence of each interval, such that all hold together (Dunn 1961, JASA 56:52)."""
        return 1.0 - (1.0 - self.confidence) / (max(1, self.size) * max(1, self.looks))

    def interval(self, successes: int, n: int) -> Interval:
        """Returns the interval of one group's share.

        Args:
            successes: 0 to ``n``.
            n: How many were counted; none says nothing, so the interval is then 0 to 1.

        Raises:
            ValueError: The numbers are not such.
        """
        tail = (1.0 - self.each) / 2.0
        lower, beyond = (clopper_pearson(shown, n, tail).lower for shown in (successes, n - successes))
        # Rounded outwards, to the same number on any machine.
        return Interval(lower=math.floor(lower * 1e9) / 1e9, upper=1.0 - math.floor(beyond * 1e9) / 1e9)

    def sentence(self, of: str = "reports") -> str:
        """Returns how many intervals there are and what that means; empty of none.

        Args:
            of: What there are many of, if all is done again, such as ``reports``.
        """
        sure = f"{100 * self.confidence:g}\u00a0% of such {of}"
        if self.size < 2:
            return f"1 interval of a group; it holds in {sure}" if self.size else ""
        return f"{self.size:,} intervals of groups; all {self.size:,} hold together in {sure}"


def share_alone(successes: int, n: int, confidence: float, looks: int = 0) -> Interval:
    """Returns the interval of a share by itself: Wilson's, or an exact one that holds at all looks at its batch.

    Args:
        successes: 0 to ``n``.
        n: How many were counted; none says nothing, so the interval is then 0 to 1.
        confidence: Coverage, between 0 and 1.
        looks: At how many looks the batch might have been ended; 0 of one that was driven to its end.
    """
    if not looks:
        return wilson(successes, n, confidence)
    return IntervalFamily(size=1, confidence=confidence, looks=looks).interval(successes, n)


class Stratum(NamedTuple):
    """Some of a batch's episodes, of which a few were looked at.

    Attributes:
        episodes: How many there are, or an estimate of it.
        effective: To how many equally weighted ones those come that were looked at; above 0.
        rate: The share of them that shows something, weighted, 0-1.
    """

    episodes: float
    effective: float
    rate: float


def stratum_interval(stratum: Stratum, confidence: float) -> Interval:
    """Returns the two-sided interval of a stratum's share, exact where the weights are equal.

    Args:
        stratum: What was seen.
        confidence: Coverage, between 0 and 1.

    Raises:
        ValueError: The numbers are not such.
    """
    _, effective, rate = stratum
    if not (effective > 0.0 and 0.0 <= rate <= 1.0 and 0.0 < confidence < 1.0):
        raise ValueError(f"{stratum} with confidence {confidence}: effective > 0, 0 <= rate <= 1, 0 < c < 1")
    return clopper_pearson(rate * effective, effective, (1.0 - confidence) / 2.0)


def total_rate(strata: Sequence[Stratum]) -> float:
    """Returns the share over all strata, each weighted by its episodes; 0 of none."""
    episodes = sum(each.episodes for each in strata)
    return sum(each.episodes * each.rate for each in strata) / episodes if episodes else 0.0


def total_interval(strata: Sequence[Stratum], confidence: float) -> Interval:
    """Returns the two-sided interval of the share over all strata.

    The distances of the strata's bounds from their estimates are independent, so their squares add up (Zou and Donner
    2008, Statistics in Medicine 27:1693, section 2).

    Args:
        strata: What was seen; of none nothing is known.
        confidence: Coverage, between 0 and 1.
    """
    episodes = sum(each.episodes for each in strata)
    if not episodes:
        return Interval(lower=0.0, upper=1.0)
    rate, below, above = total_rate(strata), 0.0, 0.0
    for each in strata:
        share, bounds = each.episodes / episodes, stratum_interval(each, confidence)
        below += (share * (each.rate - bounds.lower)) ** 2
        above += (share * (bounds.upper - each.rate)) ** 2
    return Interval(lower=max(0.0, rate - math.sqrt(below)), upper=min(1.0, rate + math.sqrt(above)))


def lanes_needed(at_most: float, confidence: float) -> int:
    """Returns how many lanes show that a share is small enough, if none of them shows anything.

    Of n lanes without one the upper bound of Clopper and Pearson is 1 - ((1 - confidence) / 2)^(1 / n).

    Args:
        at_most: The most that the share may be, between 0 and 1.
        confidence: Coverage of the two-sided interval, between 0 and 1.
    """
    return math.ceil(math.log((1.0 - confidence) / 2.0) / math.log1p(-at_most) - 1e-9)


def discounted_bound(kept: float, lower: float, lost: float, lost_upper: float) -> float:
    """Returns the lower bound of a share of which a part may not be what it seems.

    The share is ``kept`` times ``1 - lost``; both were estimated apart, so the distances of their bounds add up as
    squares (Zou and Donner 2008, section 2).

    Args:
        kept: The share as it was seen, 0-1.
        lower: The lower bound of its interval.
        lost: The part of it that is not what it seems, as it was seen, 0-1.
        lost_upper: The upper bound of that.
    """
    distance = math.hypot(max(0.0, kept - lower), kept * (lost_upper - lost))
    return max(0.0, min(lower, kept * (1.0 - lost) - distance))


def in_worlds(worlds: int, *, like_these: bool = False) -> str:
    """Returns where a rate holds, such as ``in these 8 worlds``.

    Args:
        worlds: How many worlds its episodes were in.
        like_these: Whether its interval is of worlds like these, and not of these alone.
    """
    if worlds < 1:
        return "in no world"
    if like_these:
        return f"in worlds like {'this 1' if worlds == 1 else f'these {worlds:,}'}"
    return "in this 1 world" if worlds == 1 else f"in these {worlds:,} worlds"


def percent(share: float) -> str:
    """Returns a share as text; what is not quite everything or nothing is never rounded to it."""
    shown = round(100.0 * share, 1)
    if shown in (0.0, 100.0) and share not in (0.0, 1.0):
        return ">\u00a099.9\u00a0%" if shown else "<\u00a00.1\u00a0%"
    return f"{shown:.1f}\u00a0%"


def percent_range(interval: Interval) -> str:
    """Returns an interval as text, rounded outwards, so that no bound is printed on the wrong side of a bar."""
    return f"{math.floor(1000 * interval.lower) / 10:.1f} to {math.ceil(1000 * interval.upper) / 10:.1f}\u00a0%"
