"""Confidence intervals of shares, of differences of shares, and of quantiles; the distributions are scipy's.

All intervals are two-sided. scipy takes a second to import, and most commands judge nothing, so that it is imported
where it is needed.
"""

import math
from collections.abc import Sequence

from specs.base import Spec


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

    z, rate = ndtri(0.5 + 0.5 * confidence), successes / n
    scale = 2 * (n + z**2)
    centre, reach = (2 * n * rate + z**2) / scale, z / scale * math.sqrt(4 * n * rate * (1 - rate) + z**2)
    return Interval(
        lower=float(centre - reach) if successes else 0.0, upper=float(centre + reach) if successes < n else 1.0
    )


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
    from scipy.stats import norm  # noqa: PLC0415

    z = float(norm.ppf((1.0 + confidence) / 2.0))
    return Interval(lower=_score_bound(gains, losses, n, z), upper=-_score_bound(losses, gains, n, z))


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
    linear = (2 * n - gains + losses) * difference - gains - losses
    constant = -losses * difference * (1.0 - difference)
    lost = (math.sqrt(max(0.0, linear * linear - 8 * n * constant)) - linear) / (4 * n)
    variance = n * (2.0 * lost + difference * (1.0 - difference))
    above = gains - losses - n * difference
    if above == 0.0:
        return 0.0
    return above / math.sqrt(variance) if variance > 0.0 else math.copysign(math.inf, above)
