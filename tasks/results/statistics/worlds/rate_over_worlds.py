"""The interval of a rate in worlds like those that were drawn, which differ by more than chance.

Each world has a chance of its own, beta distributed, and the rate is the mean of the chances. The interval holds the
rates whose profile likelihood, with the spread between worlds at its best, is near the highest one (Williams 1975,
Biometrics 31:949). docs/decisions/0021 says what near is, and why; docs/reference/statistics.md how often it covers.
"""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Int

from tasks.results.statistics.intervals import Interval, wilson
from tasks.results.statistics.worlds.dirichlet_multinomial import Peak, Tails, peak, profile, tails
from tasks.results.statistics.worlds.nearness import nearness
from tasks.results.statistics.worlds.refusal import why_refused

_DIGITS = 1e9
_NEAREST = 1e-9
_ALONG = np.array([[1.0, -1.0]])


def rate_over_worlds(successes: Sequence[int], n: Sequence[int], confidence: float) -> Interval:
    """Returns the two-sided interval of the rate in worlds like these, which holds Wilson's of all episodes.

    Args:
        successes: Of each world, 0 to its ``n``.
        n: Episodes of each world, 1 at least.
        confidence: Coverage, between 0 and 1.

    Returns:
        The interval; 0 to 1 of too few worlds (`why_refused`).

    Raises:
        ValueError: The numbers are not such.
    """
    passed, episodes = np.asarray(successes, np.int64), np.asarray(n, np.int64)
    if passed.shape != episodes.shape or (passed < 0).any() or (passed > episodes).any() or (episodes < 1).any():
        raise ValueError(f"{successes} successes of {n}: one of each per world, 0 <= successes <= n, n >= 1")
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"confidence {confidence}: between 0 and 1")
    if why_refused("rate", len(passed)):
        return Interval(lower=0.0, upper=1.0)
    data, plain = _data(passed[None], episodes), wilson(int(passed.sum()), int(episodes.sum()), confidence)
    lower = _lower(data, float(nearness(data.ends[1][:, 0], len(n), confidence)[0])) if passed.any() else 0.0
    turned = Tails(data.ends[::-1], data.episodes)
    below = _lower(turned, float(nearness(data.ends[0][:, 0], len(n), confidence)[0])) if data.ends[1].any() else 0.0
    return Interval(
        lower=min(math.floor(lower * _DIGITS) / _DIGITS, plain.lower),
        upper=max(math.ceil((1.0 - below) * _DIGITS) / _DIGITS, plain.upper),
    )


def rates_shown(
    successes: Int[np.ndarray, "sets worlds"], n: Int[np.ndarray, " worlds"], rate: float, confidence: float
) -> tuple[Bool[np.ndarray, " sets"], Bool[np.ndarray, " sets"]]:
    """Returns which data sets show that the rate is above one, and which that it is below: those without it inside.

    It is `rate_over_worlds` of many data sets at once; to ask whether one rate is in an interval needs no bounds.

    Args:
        successes: Of each data set and world.
        n: Episodes of each world, 1 at least, two worlds at least.
        rate: Between 0 and 1.
        confidence: Coverage, between 0 and 1.
    """
    from scipy.special import ndtri  # noqa: PLC0415 - most commands judge nothing

    data = _data(successes, n)
    best = best_rates(data)
    doubt = best.value - profile(data, np.array([rate, 1.0 - rate]))
    above = best.shares[0] > rate
    seldom = np.where(above, data.ends[1][:, 0], data.ends[0][:, 0])
    unlike = doubt > nearness(seldom, len(n), confidence)
    score = (successes.sum(axis=1) / n.sum() - rate) / math.sqrt(rate * (1.0 - rate) / n.sum())
    z = float(ndtri((1.0 + confidence) / 2.0))
    return unlike & above & (score > z), unlike & ~above & (score < -z)


def best_rates(data: Tails) -> Peak:
    """Returns the most likely rate of each data set, and how likely it is."""
    passed = data.ends[0].sum(axis=1) / data.episodes.sum(axis=1)
    start = np.clip(passed, _NEAREST, 1.0 - _NEAREST)
    return peak(data, np.stack([start, 1.0 - start]), _ALONG)


def _data(successes: Int[np.ndarray, "sets worlds"], n: Int[np.ndarray, " worlds"]) -> Tails:
    return tails(np.stack([successes, n - successes]))


def _lower(data: Tails, near: float) -> float:
    from scipy.optimize import root_scalar  # noqa: PLC0415 - most commands judge nothing

    best = best_rates(data)
    enough = float(best.value[0]) - near

    def excess(rate: float) -> float:
        return float(profile(data, np.array([rate, 1.0 - rate]))[0]) - enough

    if excess(_NEAREST) >= 0.0:
        return 0.0
    return float(root_scalar(excess, bracket=(_NEAREST, float(best.shares[0, 0])), xtol=1e-12).root)
