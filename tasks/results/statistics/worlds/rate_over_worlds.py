"""The interval of a rate in worlds like those that were drawn, which differ by more than chance.

Each world has a chance of its own, beta distributed, and the rate is the mean of the chances. The interval holds the
rates whose profile likelihood, with the spread between worlds at its best, is near the highest one (Williams 1975,
Biometrics 31:949). Near is t(K - 1)^2 / 2 of the K worlds instead of z^2 / 2: the spread is known by K worlds alone.
"""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from tasks.results.statistics.intervals import Interval
from tasks.results.statistics.worlds.beta_binomial import highest, log_likelihoods, tails

_DIGITS = 1e9
_NEAREST = 1e-9


def rate_over_worlds(successes: Sequence[int], n: Sequence[int], confidence: float) -> Interval:
    """Returns the two-sided interval of the rate in worlds like these; 0 to 1 of fewer than two worlds.

    Args:
        successes: Of each world, 0 to its ``n``.
        n: Episodes of each world, 1 at least.
        confidence: Coverage, between 0 and 1.

    Raises:
        ValueError: The numbers are not such.
    """
    passed, episodes = np.asarray(successes, np.int64), np.asarray(n, np.int64)
    if passed.shape != episodes.shape or (passed < 0).any() or (passed > episodes).any() or (episodes < 1).any():
        raise ValueError(f"{successes} successes of {n}: one of each per world, 0 <= successes <= n, n >= 1")
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"confidence {confidence}: between 0 and 1")
    if len(passed) < 2:
        return Interval(lower=0.0, upper=1.0)
    lower = _lower(passed, episodes, confidence)
    upper = 1.0 - _lower(episodes - passed, episodes, confidence)
    return Interval(lower=math.floor(lower * _DIGITS) / _DIGITS, upper=math.ceil(upper * _DIGITS) / _DIGITS)


def threshold(worlds: int, confidence: float) -> float:
    """Returns how far below the highest log likelihood the bounds of an interval lie."""
    from scipy.stats import t  # noqa: PLC0415 - most commands judge nothing

    return float(t.ppf((1.0 + confidence) / 2.0, worlds - 1)) ** 2 / 2.0


def profile(
    successes: Int[np.ndarray, "sets worlds"], n: Int[np.ndarray, "#sets worlds"], rate: float
) -> Float[np.ndarray, " sets"]:
    """Returns the log likelihood of a rate, with the spread at its best, of many data sets, less a constant of each."""
    most = int(n.max())
    ends = [(tails(successes, most), rate), (tails(n - successes, most), 1.0 - rate)]
    return highest(log_likelihoods(ends, tails(n, most)))


def _lower(passed: Int[np.ndarray, " worlds"], n: Int[np.ndarray, " worlds"], confidence: float) -> float:
    from scipy.optimize import minimize_scalar, root_scalar  # noqa: PLC0415 - most commands judge nothing

    if not passed.any():
        return 0.0

    def likelihood(rate: float) -> float:
        return float(profile(passed[None], n[None], rate)[0])

    if (passed == n).all():
        best, peak = 1.0 - _NEAREST, 0.0
    else:
        found = minimize_scalar(
            lambda rate: -likelihood(rate), bounds=(_NEAREST, 1.0 - _NEAREST), method="bounded", options={"xatol": 1e-9}
        )
        best, peak = float(found.x), -float(found.fun)
    enough = peak - threshold(len(n), confidence)
    if likelihood(_NEAREST) >= enough:
        return 0.0
    return float(root_scalar(lambda rate: likelihood(rate) - enough, bracket=(_NEAREST, best), xtol=1e-12).root)
