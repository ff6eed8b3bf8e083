"""The interval of a quantile in worlds like those that were drawn."""

import itertools
import math
from collections.abc import Sequence

import numpy as np

from tasks.results.statistics.intervals import Interval
from tasks.results.statistics.worlds.rate_over_worlds import rate_over_worlds


def quantile_over_worlds(values_by_world: Sequence[Sequence[float]], quantile: float, confidence: float) -> Interval:
    """Returns the interval of a quantile: the values at which the share of smaller ones may be the quantile.

    Woodruff 1952 (JASA 47:635): the interval of the share below a value is turned into one of the value. Where there
    are too few worlds for a bound, it is infinite.

    Args:
        values_by_world: Of each world its values, in any order; infinite ones stand for what is not known but on that
            side.
        quantile: Between 0 and 1.
        confidence: Coverage, between 0 and 1.

    Raises:
        ValueError: The quantile or the confidence is not between 0 and 1.
    """
    if not (0.0 < quantile < 1.0 and 0.0 < confidence < 1.0):
        raise ValueError(f"quantile {quantile} with confidence {confidence}: both between 0 and 1")
    worlds = [sorted(values) for values in values_by_world if len(values)]
    turned = [[-value for value in values] for values in worlds]
    return Interval(lower=_lower(worlds, quantile, confidence), upper=-_lower(turned, 1.0 - quantile, confidence))


def _lower(worlds: list[list[float]], quantile: float, confidence: float) -> float:
    """Returns the first value that is not shown to be below the quantile, going up from the lowest one."""
    n = [len(values) for values in worlds]
    bounds = [-math.inf, *sorted({value for values in worlds for value in values})]
    for below, value in itertools.pairwise(bounds):
        counts = [int(np.searchsorted(values, below, side="right")) for values in worlds]
        if rate_over_worlds(counts, n, confidence).upper >= quantile:
            return below
        if value == bounds[-1]:
            return value
    return -math.inf
