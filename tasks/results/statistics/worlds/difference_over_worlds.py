"""The interval of the difference of two rates in worlds like those that were drawn, from the same episodes of both.

A pair of episodes is a gain, a loss or a tie. Each world has chances of its own for the three, Dirichlet distributed;
the difference is that of the mean chances. The interval holds the differences whose profile likelihood, with the share
of ties and the spread between worlds at their best, is near the highest one, as `rate_over_worlds` does for one rate.
"""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from tasks.results.statistics.intervals import Interval, paired_difference
from tasks.results.statistics.worlds.dirichlet_multinomial import Peak, Tails, peak, tails
from tasks.results.statistics.worlds.nearness import nearness
from tasks.results.statistics.worlds.refusal import why_refused

_DIGITS = 1e9
_NEAREST = 1e-9
_ALL = np.array([[1.0, 0.0, -1.0], [0.0, 1.0, -1.0]])
_DISAGREEING = np.array([[0.5, 0.5, -1.0]])


def difference_over_worlds(
    gains: Sequence[int], losses: Sequence[int], n: Sequence[int], confidence: float
) -> Interval:
    """Returns the interval of the difference of two success rates in worlds like these, which holds Tango's of all.

    Args:
        gains: Of each world, how many episodes succeeded with the first and not with the second.
        losses: Of each world, how many succeeded with the second and not with the first.
        n: Of each world, how many pairs there are, those that agree included; 1 at least.
        confidence: Coverage, between 0 and 1.

    Returns:
        The interval; -1 to 1 of too few worlds (`why_refused`).

    Raises:
        ValueError: The numbers are not such.
    """
    won, lost, pairs = (np.asarray(counts, np.int64) for counts in (gains, losses, n))
    if not won.shape == lost.shape == pairs.shape or (won < 0).any() or (lost < 0).any() or (won + lost > pairs).any():
        raise ValueError(f"{gains} gains and {losses} losses of {n} pairs: one of each per world, gains + losses <= n")
    if (pairs < 1).any() or not 0.0 < confidence < 1.0:
        raise ValueError(f"{n} pairs with confidence {confidence}: n >= 1, 0 < confidence < 1")
    if why_refused("difference", len(pairs)):
        return Interval(lower=-1.0, upper=1.0)
    data = _data(won[None], lost[None], pairs)
    turned = Tails(data.ends[[1, 0, 2]], data.episodes)
    plain = paired_difference(int(won.sum()), int(lost.sum()), int(pairs.sum()), confidence)
    lower = _lower(data, float(nearness(data.ends[1][:, 0], len(n), confidence)[0]))
    below = _lower(turned, float(nearness(data.ends[0][:, 0], len(n), confidence)[0]))
    return Interval(
        lower=min(math.floor(lower * _DIGITS) / _DIGITS, plain.lower),
        upper=max(-math.floor(below * _DIGITS) / _DIGITS, plain.upper),
    )


def differences_shown(
    gains: Int[np.ndarray, "sets worlds"],
    losses: Int[np.ndarray, "sets worlds"],
    n: Int[np.ndarray, " worlds"],
    difference: float,
    confidence: float,
) -> tuple[Bool[np.ndarray, " sets"], Bool[np.ndarray, " sets"]]:
    """Returns which data sets show that the difference is above one, and which that it is below.

    It is `difference_over_worlds` of many data sets at once; to ask whether one difference is inside needs no bounds.
    What Tango's interval of all pairs would add is left out.

    Args:
        gains: Of each data set and world.
        losses: Of each data set and world.
        n: Pairs of each world, two worlds at least.
        difference: Between -1 and 1.
        confidence: Coverage, between 0 and 1.
    """
    data = _data(gains, losses, n)
    best = _best(data)
    above = best.shares[0] - best.shares[1] > difference
    seldom = np.where(above, data.ends[1][:, 0], data.ends[0][:, 0])
    unlike = best.value - _profile(data, difference) > nearness(seldom, len(n), confidence)
    return unlike & above, unlike & ~above


def _data(
    gains: Int[np.ndarray, "sets worlds"], losses: Int[np.ndarray, "sets worlds"], n: Int[np.ndarray, " worlds"]
) -> Tails:
    return tails(np.stack([gains, losses, n - gains - losses]))


def _pooled(data: Tails) -> Float[np.ndarray, "3 sets"]:
    shares = np.maximum(data.ends.sum(axis=2), _NEAREST)
    return shares / shares.sum(axis=0)


def _best(data: Tails) -> Peak:
    return peak(data, _pooled(data), _ALL)


def _profile(data: Tails, difference: float) -> Float[np.ndarray, " sets"]:
    """Returns the log likelihood of a difference, with the share of ties and the spread at their best."""
    pooled = _pooled(data)
    least = abs(difference)
    disagreeing = np.clip(pooled[0] + pooled[1], least + _NEAREST, 1.0 - _NEAREST)
    shares = np.stack([(disagreeing + difference) / 2.0, (disagreeing - difference) / 2.0, 1.0 - disagreeing])
    return peak(data, np.maximum(shares, _NEAREST / 4.0), _DISAGREEING).value


def _lower(data: Tails, near: float) -> float:
    from scipy.optimize import root_scalar  # noqa: PLC0415 - most commands judge nothing

    best, least = _best(data), -1.0 + 4.0 * _NEAREST
    enough = float(best.value[0]) - near

    def excess(difference: float) -> float:
        return float(_profile(data, difference)[0]) - enough

    if excess(least) >= 0.0:
        return -1.0
    likeliest = float(best.shares[0, 0] - best.shares[1, 0])
    return float(root_scalar(excess, bracket=(least, likeliest), xtol=1e-12).root)
