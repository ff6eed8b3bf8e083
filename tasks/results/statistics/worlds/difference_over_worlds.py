"""The interval of the difference of two rates in worlds like those that were drawn, from the same episodes of both."""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Int

from tasks.results.statistics.intervals import Interval
from tasks.results.statistics.worlds.beta_binomial import highest, log_likelihoods, tails
from tasks.results.statistics.worlds.rate_over_worlds import threshold

_DIGITS = 1e9
_NEAREST = 1e-9


def difference_over_worlds(
    gains: Sequence[int], losses: Sequence[int], n: Sequence[int], confidence: float
) -> Interval:
    """Returns the interval of the difference of two success rates in worlds like these; -1 to 1 of fewer than two.

    Args:
        gains: Of each world, how many episodes succeeded with the first and not with the second.
        losses: Of each world, how many succeeded with the second and not with the first.
        n: Of each world, how many pairs there are, those that agree included; 1 at least.
        confidence: Coverage, between 0 and 1.

    Raises:
        ValueError: The numbers are not such.
    """
    won, lost, pairs = (np.asarray(counts, np.int64) for counts in (gains, losses, n))
    if not (won.shape == lost.shape == pairs.shape) or (won < 0).any() or (lost < 0).any() or (pairs < 1).any():
        raise ValueError(
            f"{gains} gains and {losses} losses of {n} pairs: one of each per world, none negative, n >= 1"
        )
    if (won + lost > pairs).any() or not 0.0 < confidence < 1.0:
        raise ValueError(f"{gains} gains and {losses} losses of {n} pairs with confidence {confidence}")
    if len(pairs) < 2:
        return Interval(lower=-1.0, upper=1.0)
    lower, upper = _lower(won, lost, pairs, confidence), -_lower(lost, won, pairs, confidence)
    return Interval(lower=math.floor(lower * _DIGITS) / _DIGITS, upper=math.ceil(upper * _DIGITS) / _DIGITS)


def _lower(
    gains: Int[np.ndarray, " worlds"],
    losses: Int[np.ndarray, " worlds"],
    n: Int[np.ndarray, " worlds"],
    confidence: float,
) -> float:
    from scipy.optimize import minimize_scalar, root_scalar  # noqa: PLC0415 - most commands judge nothing

    most = int(n.max())
    won, lost, tied = (tails(counts[None], most) for counts in (gains, losses, n - gains - losses))
    pairs = tails(n[None], most)

    def likelihood(difference: float) -> float:
        def at(share: float) -> float:  # of pairs that disagree, between |difference| and 1
            ends = [(won, (share + difference) / 2.0), (lost, (share - difference) / 2.0), (tied, 1.0 - share)]
            return float(highest(log_likelihoods(ends, pairs))[0])

        least = abs(difference)
        found = minimize_scalar(
            lambda share: -at(share), bounds=(least, 1.0), method="bounded", options={"xatol": 1e-7}
        )
        return max(-float(found.fun), at(least), at(1.0))

    found = minimize_scalar(lambda d: -likelihood(d), bounds=(-1.0, 1.0), method="bounded", options={"xatol": 1e-7})
    enough = -float(found.fun) - threshold(len(n), confidence)
    least = -1.0 + _NEAREST
    if likelihood(least) >= enough:
        return -1.0
    return float(root_scalar(lambda d: likelihood(d) - enough, bracket=(least, float(found.x)), xtol=1e-10).root)
