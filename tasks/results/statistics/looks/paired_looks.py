"""An interval of the difference of two shares on the same episodes, at each of the looks at a batch of known size.

At each look it is the ordinary interval at a stricter level, which follows from what that look may spend
(``spent_error``). Strict levels ask for more than the normal tail of Tango's score: where one in fifty pairs disagrees,
five losses of fifty are a hundred times likelier than it says. So the tail of the difference is computed without an
approximation, with the nuisance parameter at its maximum likelihood under the difference that is tested (Tango 1998,
Statistics in Medicine 17:891, equation 2.3, for the likelihood; Lloyd 2008, Biometrics 64:716, for such tails and how
near they are to exact).
"""

import math
from functools import lru_cache

import numpy as np

from tasks.results.statistics.intervals import Interval
from tasks.results.statistics.looks.spent_error import nominal_levels, spent_error

_HALVINGS = 40
_DIGITS = 1e6


@lru_cache(maxsize=4096)
def paired_interval(gains: int, losses: int, n: int, looks: tuple[int, ...], confidence: float) -> Interval:
    """Returns the interval that holds the difference at all looks together with about that confidence.

    Args:
        gains: How many pairs so far succeeded with the first and not with the second.
        losses: How many succeeded with the second and not with the first.
        n: How many pairs there were, those that agree included: one of the looks; none says nothing.
        looks: After how many pairs the batch is looked at, rising, the last being all of its pairs.
        confidence: Coverage, between 0 and 1.

    Raises:
        ValueError: The numbers are not such.
    """
    if n == 0:
        return Interval(lower=-1.0, upper=1.0)
    if n not in looks or not (gains >= 0 <= losses and gains + losses <= n):
        raise ValueError(f"{gains} gains and {losses} losses of {n} pairs, {n} being one of the looks {looks}")
    level = _levels(looks, confidence)[looks.index(n)]
    upper = -_lower(losses, gains, n, level)
    return Interval(lower=_lower(gains, losses, n, level), upper=upper)


def difference_tail(gains: int, losses: int, n: int, difference: float) -> float:
    """Returns how likely so many more gains than losses are, or still more, if the difference is the one given.

    Args:
        gains: Pairs that count for a higher difference.
        losses: Pairs that count against it.
        n: All pairs.
        difference: Between -1 and 1.
    """
    lost = _likeliest_lost(gains, losses, n, difference)
    gained = max(0.0, lost + difference)
    size = 1 << (2 * n + 1).bit_length()
    turn = np.exp(-2j * np.pi * np.arange(size // 2 + 1) / size)
    # The generating function of one pair, to the power of n: the chances of each difference, modulo the size.
    chances = np.fft.irfft((lost / turn + max(0.0, 1.0 - gained - lost) + gained * turn) ** n, size)
    above = gains - losses
    tail = chances[above : n + 1].sum() if above >= 0 else chances[: n + 1].sum() + chances[above:].sum()
    return float(tail)


@lru_cache(maxsize=128)
def _levels(looks: tuple[int, ...], confidence: float) -> tuple[float, ...]:
    return nominal_levels(looks, spent_error(looks, (1.0 - confidence) / 2.0))


def _lower(gains: int, losses: int, n: int, level: float) -> float:
    """Returns the highest difference that the level rejects, rounded down to the same number on any machine."""
    low, high = -1.0, (gains - losses) / n
    if high == low:
        return low
    for _ in range(_HALVINGS):
        middle = (low + high) / 2.0
        rejected = difference_tail(gains, losses, n, middle) <= level
        low, high = (middle, high) if rejected else (low, middle)
    return math.floor(low * _DIGITS) / _DIGITS


def _likeliest_lost(gains: int, losses: int, n: int, difference: float) -> float:
    """Returns the share of losses that makes what was seen likeliest, if the difference is the one given."""
    linear = (2 * n - gains + losses) * difference - gains - losses
    constant = -losses * difference * (1.0 - difference)
    lost = (math.sqrt(max(0.0, linear * linear - 8 * n * constant)) - linear) / (4 * n)
    return max(lost, 0.0, -difference)
