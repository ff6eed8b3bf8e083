"""What becomes of a batch that may be ended at any of its looks: how often it passes, and after how many episodes.

Computed state by state, without drawing anything. The boundary is that of the interval by which a batch is judged: that
of the test at the bar, and of the tests at shares below it, one of which may ask for one success more.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from tasks.results.statistics.looks.binomial_walk import Walk, least_successes, start_walk, step_walk
from tasks.results.statistics.looks.repeated_interval import tested_shares
from tasks.results.statistics.looks.spent_error import spent_error

_DEVIATIONS = 2.0


class Chances(NamedTuple):
    """What becomes of a batch.

    Attributes:
        passes: The probability that it is found at or above the bar.
        fails: The probability that it is found below.
        episodes: How many it drives in the mean.
    """

    passes: float
    fails: float
    episodes: float


class Boundary(NamedTuple):
    """Where a batch ends.

    Attributes:
        passes: From how many successes on it passes, at each look; more than there are episodes where it cannot.
        fails: Up to how many it fails; below 0 where it cannot.
    """

    passes: tuple[int, ...]
    fails: tuple[int, ...]


def looks_of(episodes: int, chunk: int) -> tuple[int, ...]:
    """Returns after how many episodes a batch in chunks is looked at: after each chunk."""
    return (*range(chunk, episodes, chunk), episodes)


@lru_cache(maxsize=512)
def boundary(looks: tuple[int, ...], bar: float, confidence: float) -> Boundary:
    """Returns the numbers of successes at which a batch is certain.

    Args:
        looks: After how many episodes it is looked at, rising, the last being all of its episodes.
        bar: The share, above 0 and below 1.
        confidence: Coverage of the two-sided interval.
    """
    spent = spent_error(looks, (1.0 - confidence) / 2.0)
    above, below = (closed_boundary(looks, spent, share) for share in (bar, 1.0 - bar))
    return Boundary(above, tuple(look - failures for look, failures in zip(looks, below, strict=True)))


def closed_boundary(looks: Sequence[int], spent: Sequence[float], bar: float) -> tuple[int, ...]:
    """Returns from how many successes on a bar and the shares below it are rejected, at each look.

    Of shares further below than two standard deviations of the whole batch none asks for more.

    Args:
        looks: Episodes at each look, rising.
        spent: How much error may be used up after each look.
        bar: The share.
    """
    deviation = math.sqrt(bar * (1.0 - bar) / looks[-1])
    shares = tested_shares(max(bar - _DEVIATIONS * deviation, bar / 2.0), bar)
    return tuple(int(successes) for successes in least_successes(looks, spent, shares).max(axis=0))


def chances(looks: tuple[int, ...], bar: float, confidence: float, rate: float) -> Chances:
    """Returns what becomes of a batch whose true rate is known: its power where that is above the bar.

    Args:
        looks: After how many episodes it is looked at, rising, the last being all of its episodes.
        bar: The share, above 0 and below 1.
        confidence: Coverage of the two-sided interval.
        rate: The true share of successes, 0-1.
    """
    return chances_between(looks, boundary(looks, bar, confidence), rate)


def chances_between(looks: Sequence[int], ends: Boundary, rate: float) -> Chances:
    """Returns what becomes of a batch that ends at such numbers of successes."""
    walk, before, passed, failed, episodes = start_walk(1), 0, 0.0, 0.0, 0.0
    for look, above, below in zip(looks, ends.passes, ends.fails, strict=True):
        going = float(walk.chances.sum())
        episodes += going * (look - before)
        walk = step_walk(walk, np.array([rate]), look - before)
        counts = walk.first + np.arange(walk.chances.shape[1])
        passes, fails = counts >= above, (counts <= below) & (counts < above)
        passed, failed = passed + float(walk.chances[0, passes].sum()), failed + float(walk.chances[0, fails].sum())
        walk, before = Walk(walk.first, np.where(passes | fails, 0.0, walk.chances)), look
    return Chances(passed, failed, episodes)


def passes_after(looks: tuple[int, ...], bar: float, confidence: float, rate: float) -> int | None:
    """Returns after how many episodes a batch passes that is exactly as good as expected; None if it does not.

    Args:
        looks: After how many episodes it is looked at, rising.
        bar: The share, above 0 and below 1.
        confidence: Coverage of the two-sided interval.
        rate: The share of successes, rounded down to whole episodes at each look.
    """
    ends = boundary(looks, bar, confidence).passes
    reached = (look for look, above in zip(looks, ends, strict=True) if int(rate * look + 1e-9) >= above)
    return next(reached, None)
