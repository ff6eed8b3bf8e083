"""Shares of a batch from a sample of strata: intervals, and how many lanes show that a share is small."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from tasks.results.statistics.intervals import Interval


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
    """Returns the two-sided interval of a stratum's share.

    The exact interval of Clopper and Pearson 1934 (Biometrika 26:404), whose bounds are quantiles of beta
    distributions, with the effective number of lanes (Korn and Graubard 1998, Survey Methodology 24:193). It covers at
    least as often as stated where the weights are equal.

    Args:
        stratum: What was seen.
        confidence: Coverage, between 0 and 1.

    Raises:
        ValueError: The numbers are not such.
    """
    _, effective, rate = stratum
    if not (effective > 0.0 and 0.0 <= rate <= 1.0 and 0.0 < confidence < 1.0):
        raise ValueError(f"{stratum} with confidence {confidence}: effective > 0, 0 <= rate <= 1, 0 < c < 1")
    from scipy.stats import beta  # noqa: PLC0415

    tail, seen = (1.0 - confidence) / 2.0, rate * effective
    lower = float(beta.ppf(tail, seen, effective - seen + 1.0)) if seen > 0.0 else 0.0
    upper = float(beta.ppf(1.0 - tail, seen + 1.0, effective - seen)) if seen < effective else 1.0
    return Interval(lower=lower, upper=upper)


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


def less_lost(kept: float, lower: float, lost: float, lost_upper: float) -> float:
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
