"""An interval of a share at each of the looks at a batch of known size, that holds at all of them together.

At a look it holds the shares against which the group-sequential test has not spoken: repeated confidence intervals by
inversion (Jennison and Turnbull 1989, JRSS B 51:305). So it says of any bar what the test says, and is valid for a bar
that comes to mind later. A share is tested in both directions, each with half of the error, and neither relies on the
batch having been stopped by the other.

Whole numbers keep the test from being quite monotonous: once in a while it speaks against a share and not against a
slightly lower one. The interval's lower bound is below both, so that whoever passes a bar passes all lower ones.
"""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int

from tasks.results.statistics.intervals import Interval
from tasks.results.statistics.looks.binomial_walk import least_successes
from tasks.results.statistics.looks.spent_error import spent_error

# Tested are multiples of a step, in millionths: how far from 0 and 1 a step is fine enough, and the step.
_WHOLE = 1_000_000
_STEPS = ((100_000, 500), (10_000, 100), (1_000, 10), (0, 1))
_RESERVE, _ABOVE, _ROUNDING = 1e-8, 1e-9, 1e-6


@lru_cache(maxsize=4096)
def repeated_interval(successes: int, n: int, looks: tuple[int, ...], confidence: float) -> Interval:
    """Returns the interval that holds the share at all looks together with at least that confidence.

    Args:
        successes: Of the episodes so far.
        n: How many there were: one of the looks; none says nothing.
        looks: After how many episodes the batch is looked at, rising, the last being all of its episodes.
        confidence: Coverage, between 0 and 1.

    Raises:
        ValueError: The numbers are not such.
    """
    if n == 0:
        return Interval(lower=0.0, upper=1.0)
    if n not in looks or not 0 <= successes <= n:
        raise ValueError(f"{successes} successes of {n}: 0 <= successes <= n, and n one of the looks {looks}")
    seen = looks[: looks.index(n) + 1]
    spent = spent_error(looks, (1.0 - confidence) / 2.0)[: len(seen)]
    return Interval(lower=_bound(successes, seen, spent), upper=round(1.0 - _bound(n - successes, seen, spent), 9))


def inner_interval(successes: int, n: int, looks: tuple[int, ...], confidence: float) -> Interval:
    """Returns an interval that the repeated one reaches beyond: where it is not clear of a bar, that is not either.

    It takes no walk, so that one can ask at each of many looks whether it is worth while to ask for the other. It is
    that of Clopper and Pearson 1934 (Biometrika 26:404), with all the error that may be spent until that look.
    """
    if n == 0:
        return Interval(lower=0.0, upper=1.0)
    from scipy.stats import beta  # noqa: PLC0415

    spent = spent_error(looks, (1.0 - confidence) / 2.0)[looks.index(n)]
    lower = beta.ppf(spent, successes, n - successes + 1) if successes else 0.0
    upper = beta.isf(spent, successes + 1, n - successes) if successes < n else 1.0
    return Interval(lower=float(lower), upper=float(upper))


def tested_shares(lowest: float, highest: float) -> Float[np.ndarray, " shares"]:
    """Returns the shares that are tested between two; each stands for those from the one before it on.

    Args:
        lowest: The first is at or below it.
        highest: The last is at or above it.
    """
    points = [_round_down(lowest)]
    while points[-1] < highest * _WHOLE - _ROUNDING:
        points.append(_next(points[-1]))
    return np.array([point for point in points if point]) / _WHOLE


def _bound(successes: int, looks: Sequence[int], spent: Sequence[float]) -> float:
    """Returns the lower bound: right above the highest share that is rejected, as that is not in the interval."""
    rejected = _lower(successes, looks, spent)
    return rejected / _WHOLE + _ABOVE if rejected else 0.0


def _lower(successes: int, looks: Sequence[int], spent: Sequence[float]) -> int:
    """Returns the highest share, in millionths, that the test rejects together with all lower ones.

    Where the ordinary tail is within what this look alone may spend, a share is rejected for certain; where it exceeds
    what all looks may have spent, it is not. Only what is between has to be walked through.
    """
    if successes == 0:
        return 0
    from scipy.stats import beta  # noqa: PLC0415 - most commands judge nothing

    n, before = looks[-1], spent[-2] if len(spent) > 1 else 0.0
    least = max(spent[-1] - before - _RESERVE, 0.0)
    certain, possible = beta.ppf([least, spent[-1]], successes, n - successes + 1)
    start = _round_down(float(certain))
    points = _grid(start, math.floor(possible * _WHOLE))
    if not len(points):
        return start
    rejected = least_successes(looks, spent, points / _WHOLE)[:, -1] <= successes
    count = len(points) if rejected.all() else int(np.argmin(rejected))
    return int(points[count - 1]) if count else start


def _round_down(share: float) -> int:
    millionths = math.floor(share * _WHOLE)
    step = _step(millionths)
    return millionths // step * step


def _grid(above: int, highest: int) -> Int[np.ndarray, " points"]:
    """Returns the shares that are tested, above one and up to another, in millionths."""
    points, point = list[int](), above
    while (point := _next(point)) <= highest:
        points.append(point)
    return np.array(points, dtype=np.int64)


def _next(millionths: int) -> int:
    """Returns the next share that is tested; what is tested is the same wherever one begins."""
    step = _step(millionths + 1)
    return (millionths // step + 1) * step


def _step(millionths: int) -> int:
    edge = min(millionths, _WHOLE - millionths)
    return next(step for least, step in _STEPS if edge >= least)
