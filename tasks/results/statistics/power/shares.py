"""How many episodes give a rule about a share of episodes a certain power, exactly.

The power is the chance that the rule passes, each episode being good with a probability that one expects. A rule of
that kind tolerates so many bad episodes of n; where it tolerates one more, the power jumps up, and between two jumps it
falls (Chernick and Liu 2002, The American Statistician 56:149). So the fewest episodes are those from which on it never
falls below what is asked for.
"""

import math
from collections.abc import Callable
from functools import cache
from statistics import NormalDist
from typing import NamedTuple

_MOST_BAD = 1 << 22
_NEGLIGIBLE = 1e-17
_RAGGED = 64


class PowerNeeds(NamedTuple):
    """What a rule needs, and what it has.

    Attributes:
        for_80: Episodes, pairs or worlds from which on the rule passes with a probability of 0.8 at least.
        for_90: Those for 0.9.
        power: The probability, 0-1, with as many as there are.
    """

    for_80: int
    for_90: int
    power: float


def share_needs(at_least: float, confidence: float, rate: float, there: int) -> PowerNeeds | None:
    """Returns what a rule needs whose lower Wilson bound must reach a bar; None where no number is enough.

    The bound reaches the bar exactly when the score test does: share - bar >= z sqrt(bar (1 - bar) / n).

    Args:
        at_least: The bar, 0-1.
        confidence: Coverage of the two-sided interval.
        rate: The share of good episodes that one expects, 0-1.
        there: How many episodes there are.
    """
    if at_least == 0.0:
        return PowerNeeds(1, 1, 1.0 if there else 0.0)
    if rate <= at_least:
        return None
    return _needs(_by_wilson(at_least, confidence), 1.0 - rate, there)


def quantile_needs(tail: float, confidence: float, beyond: float, there: int) -> PowerNeeds | None:
    """Returns what a rule needs that bounds a quantile by order statistics; None where no number is enough.

    Args:
        tail: The share of episodes that may be beyond the bar: of a bar from below the quantile, else 1 less it.
        confidence: Coverage of the two-sided interval.
        beyond: The share of episodes beyond the bar that one expects.
        there: How many episodes there are.
    """
    if beyond >= tail:
        return None
    return _needs(_by_rank(tail, confidence), beyond, there)


def effective_episodes(worlds: int, per_world: int, icc: float) -> float:
    """Returns how many independent episodes tell as much of the mean rate of worlds like these.

    Kish 1965, Survey Sampling, section 8.2: the design effect of clusters of equal size is 1 + (size - 1) icc.

    Args:
        worlds: How many there are.
        per_world: Episodes of each.
        icc: How alike the episodes of one world are, 0-1.
    """
    return worlds * per_world / (1.0 + (per_world - 1) * max(0.0, icc))


def _by_wilson(at_least: float, confidence: float) -> Callable[[int], int]:
    """Returns the fewest episodes of which so many may be bad, as a function of these."""
    z = NormalDist().inv_cdf((1.0 + confidence) / 2.0)
    spread = z * math.sqrt(at_least * (1.0 - at_least))

    def fewest(bad: int) -> int:
        # (1 - bar) n - spread sqrt(n) - bad >= 0 is a quadratic inequality of sqrt(n).
        root = (spread + math.sqrt(spread * spread + 4.0 * (1.0 - at_least) * bad)) / (2.0 * (1.0 - at_least))
        n = max(1, math.ceil(root * root) - 1)
        while (1.0 - at_least) * n - bad < spread * math.sqrt(n):
            n += 1
        return n

    return fewest


def _by_rank(tail: float, confidence: float) -> Callable[[int], int]:
    """Returns the fewest episodes of which so many may be beyond, as a function of these."""
    chance = (1.0 - confidence) / 2.0

    def fewest(bad: int) -> int:
        known, enough = bad, max(1, 2 * bad)
        while at_most(bad, enough, tail) >= chance:
            known, enough = enough, 2 * enough
        while enough - known > 1:
            middle = (known + enough) // 2
            known, enough = (known, middle) if at_most(bad, middle, tail) < chance else (middle, enough)
        return enough

    return fewest


def _needs(fewest: Callable[[int], int], bad_rate: float, there: int) -> PowerNeeds | None:
    fewest = cache(fewest)
    needed = [_fewest_for(fewest, bad_rate, power) for power in (0.8, 0.9)]
    if None in needed:
        return None
    tolerated = _last(lambda bad: fewest(bad) <= there)
    power = 0.0 if tolerated is None else at_most(tolerated, there, bad_rate)
    return PowerNeeds(needed[0] or 0, needed[1] or 0, power)


def _fewest_for(fewest: Callable[[int], int], bad_rate: float, power: float) -> int | None:
    """Returns from how many episodes on the power is never below; the lowest is right before the next jump."""

    def short(bad: int) -> bool:
        return at_most(bad, fewest(bad + 1) - 1, bad_rate) < power

    last = _last(short)
    if last == _MOST_BAD:
        return None
    # The lows rise, but as n is whole, not each above the one before it.
    last = max((bad for bad in range(last or 0, (last or 0) + _RAGGED) if short(bad)), default=None)
    return fewest(0 if last is None else last + 1)


def _last(holds: Callable[[int], bool]) -> int | None:
    """Returns the last number for which something holds that later does not; None if it does not hold for 0."""
    if not holds(0):
        return None
    known, other = 0, 1
    while holds(other):
        known, other = other, 2 * other
        if other > _MOST_BAD:
            return _MOST_BAD
    while other - known > 1:
        middle = (known + other) // 2
        known, other = (middle, other) if holds(middle) else (known, middle)
    return known


def at_most(count: int, n: int, chance: float) -> float:
    """Returns the probability that a binomial number is at most so large; scipy would take a second to import.

    Args:
        count: At least 0.
        n: How many tries there are.
        chance: Of each, 0-1.
    """
    if count >= n or chance <= 0.0:
        return 1.0
    if chance >= 1.0:
        return 0.0
    if count + 1 > n * chance:  # the shorter sum is that above
        return 1.0 - _sum(count + 1, 1, n, chance)
    return _sum(count, -1, n, chance)


def _sum(start: int, step: int, n: int, chance: float) -> float:
    """Returns the sum of probabilities from one count on, away from the mean."""
    odds = chance / (1.0 - chance)
    log = math.lgamma(n + 1) - math.lgamma(start + 1) - math.lgamma(n - start + 1)
    term = math.exp(log + start * math.log(chance) + (n - start) * math.log1p(-chance))
    total, count = term, start
    while 0 <= count + step <= n and term > _NEGLIGIBLE * total:
        term *= odds * (n - count) / (count + 1) if step > 0 else count / (odds * (n - count + 1))
        count += step
        total += term
    return total
