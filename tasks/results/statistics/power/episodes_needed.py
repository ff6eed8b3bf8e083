"""Computes how many episodes a rule of a gate needs, for a share of successes that one expects."""

import math
from collections.abc import Callable
from statistics import NormalDist

from tasks.results.statistics.intervals import paired_difference, quantile_ranks
from tasks.results.statistics.looks.anytime import log_capital_above

_MOST = 10_000_000
_EXACT = 1e-9


def episodes_needed(at_least: float, confidence: float, assumed_rate: float) -> int | None:
    """Returns the fewest episodes that pass when the assumed share of them, rounded down, succeeds; None if none do.

    The lower Wilson bound reaches the bar exactly when the score test does: share - bar >= z sqrt(bar (1 - bar) / n).

    Args:
        at_least: The bar, 0-1.
        confidence: Coverage of the two-sided interval.
        assumed_rate: The share of successes that one expects, 0-1.
    """
    if at_least == 0.0:
        return 1
    if assumed_rate <= at_least:
        return None
    spread = NormalDist().inv_cdf((1.0 + confidence) / 2.0) ** 2 * at_least * (1.0 - at_least)
    n = max(1, math.ceil(spread / (assumed_rate - at_least) ** 2))
    while not _reaches(math.floor(assumed_rate * n + _EXACT), n, at_least, spread):
        n += 1
    return n


def episodes_needed_at_any_look(at_least: float, confidence: float, assumed_rate: float) -> int | None:
    """Returns about how many episodes pass the test that may be looked at while they come in; None if none do.

    Args:
        at_least: The bar, 0-1.
        confidence: Coverage of the confidence sequence.
        assumed_rate: The share of successes that one expects, 0-1.
    """
    enough = math.log(2.0 / (1.0 - confidence))
    if at_least == 0.0:
        return 1
    if assumed_rate <= at_least:
        return None
    return _fewest(lambda n: log_capital_above(math.floor(assumed_rate * n + _EXACT), n, at_least) >= enough)


def pairs_needed(margin: float, confidence: float, disagreeing: float) -> int | None:
    """Returns about how many pairs show that a version is no worse, if it is as good as the other; None if none do.

    Args:
        margin: How much worse it may be.
        confidence: Coverage of the two-sided interval.
        disagreeing: The share of pairs that one passes and the other fails, half of them each.
    """
    if margin == 0.0:
        return None

    def shown(n: int) -> bool:
        each = math.ceil(disagreeing * n / 2.0 - _EXACT)
        return 2 * each <= n and paired_difference(each, each, n, confidence).lower >= -margin

    return _fewest(shown)


def episodes_needed_for_quantile(quantile: float, confidence: float, beyond: float, *, at_least: bool) -> int | None:
    """Returns about how many episodes show that a quantile is within its bar; None if none do.

    Args:
        quantile: Between 0 and 1.
        confidence: Coverage of the two-sided interval.
        beyond: The share of episodes whose value one expects on the wrong side of the bar.
        at_least: Whether the bar is one from below.
    """
    tail = quantile if at_least else 1.0 - quantile
    if beyond >= tail:
        return None
    # The values beyond a bar from above are as many as those below one from below, seen from the other end.
    return _fewest(lambda n: quantile_ranks(n, tail, confidence)[0] > math.ceil(beyond * n - _EXACT))


def _fewest(shown: Callable[[int], bool]) -> int | None:
    """Returns a number that shows it where half as many do not; found by doubling and halving."""
    known, unknown = 0, 1
    while not shown(unknown):
        if unknown >= _MOST:
            return None
        known, unknown = unknown, 2 * unknown
    while unknown - known > 1:
        middle = (known + unknown) // 2
        known, unknown = (known, middle) if shown(middle) else (middle, unknown)
    return unknown


def _reaches(successes: int, n: int, at_least: float, spread: float) -> bool:
    above = successes / n - at_least
    return above >= 0.0 and above * above * n >= spread
