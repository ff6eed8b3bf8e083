"""The interval of a quantile in worlds like those that were drawn."""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from tasks.results.statistics.intervals import Interval
from tasks.results.statistics.worlds.rate_over_worlds import rates_shown
from tasks.results.statistics.worlds.refusal import why_refused

_AT_ONCE = 24
_EXACT = 1e-9


def quantile_over_worlds(values_by_world: Sequence[Sequence[float]], quantile: float, confidence: float) -> Interval:
    """Returns the interval of a quantile: the values at which the share of smaller ones may be the quantile.

    Woodruff 1952 (JASA 47:635): the interval of the share below a value, here `rate_over_worlds`, is turned into one
    of the value. Where there are too few worlds for a bound, it is infinite.

    Args:
        values_by_world: Of each world its values, in any order; infinite ones stand for what is not known but on that
            side. Worlds without any do not count.
        quantile: Between 0 and 1.
        confidence: Coverage, between 0 and 1.

    Raises:
        ValueError: The quantile or the confidence is not between 0 and 1.
    """
    if not (0.0 < quantile < 1.0 and 0.0 < confidence < 1.0):
        raise ValueError(f"quantile {quantile} with confidence {confidence}: both between 0 and 1")
    worlds = [np.sort(np.asarray(values, np.float64)) for values in values_by_world if len(values)]
    turned = [-values[::-1] for values in worlds]
    return Interval(lower=_lower(worlds, quantile, confidence), upper=-_lower(turned, 1.0 - quantile, confidence))


def _lower(worlds: list[Float[np.ndarray, " values"]], quantile: float, confidence: float) -> float:
    """Returns the lowest value, going down from the quantile of all, whose predecessor is shown to be below it."""
    if why_refused("quantile", len(worlds), tail=quantile):
        return -math.inf
    together = np.sort(np.concatenate(worlds))
    middle = together[max(0, math.ceil(quantile * len(together) - _EXACT) - 1)]
    cuts = np.unique(together[together <= middle])
    # Values equal to a cut are below it or at it; none is at the last, lowest cut.
    for first in range(len(cuts) - 1, -1, -_AT_ONCE):
        some = np.arange(first, max(-1, first - _AT_ONCE), -1)
        below = np.concatenate([cuts, [-math.inf]])[some - 1]
        shown = _below(worlds, below, some == 0, quantile, confidence)
        if shown.any():
            return float(cuts[some[shown.argmax()]])
    return -math.inf


def _below(
    worlds: list[Float[np.ndarray, " values"]],
    cuts: Float[np.ndarray, " cuts"],
    lowest: Bool[np.ndarray, " cuts"],
    quantile: float,
    confidence: float,
) -> Bool[np.ndarray, " cuts"]:
    """Returns at which cuts the share of values up to there is shown to be less than the quantile."""
    counts = np.stack([np.searchsorted(values, cuts, side="right") for values in worlds], axis=1)
    counts[lowest] = 0
    return rates_shown(counts, np.array([len(values) for values in worlds]), quantile, confidence)[1]
