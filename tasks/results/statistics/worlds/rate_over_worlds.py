"""The interval of a rate in worlds like those that were drawn, which differ by more than chance.

Episodes in one world share what makes it hard. Each world has a chance of its own, beta distributed, so that its
successes are beta-binomial (Skellam 1948, JRSS B 10:257; Williams 1975, Biometrics 31:949), and the rate is the mean of
the chances. The interval holds the rates whose profile likelihood, with the spread between worlds at its best, is near
the highest one. Near is t(K - 1)^2 / 2 of the K worlds instead of z^2 / 2: the spread is known by K worlds alone.
"""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from tasks.results.statistics.intervals import Interval

# Beta distributions by a + b: from worlds that pass all or nothing to worlds that are equal.
_TOTALS = np.geomspace(1e-4, 1e7, 111)
_DIGITS = 1e9


def rate_over_worlds(successes: Sequence[int], n: Sequence[int], confidence: float) -> Interval:
    """Returns the two-sided interval of the rate in worlds like these; 0 to 1 of fewer than two worlds.

    Args:
        successes: Of each world, 0 to its ``n``.
        n: Episodes of each world, 1 at least.
        confidence: Coverage, between 0 and 1.

    Raises:
        ValueError: The numbers are not such.
    """
    passed, episodes = np.asarray(successes, np.float64), np.asarray(n, np.float64)
    if passed.shape != episodes.shape or (passed < 0).any() or (passed > episodes).any() or (episodes < 1).any():
        raise ValueError(f"{successes} successes of {n}: one of each per world, 0 <= successes <= n, n >= 1")
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"confidence {confidence}: between 0 and 1")
    if len(passed) < 2:
        return Interval(lower=0.0, upper=1.0)
    lower = _lower(passed, episodes, confidence)
    upper = 1.0 - _lower(episodes - passed, episodes, confidence)
    return Interval(lower=math.floor(lower * _DIGITS) / _DIGITS, upper=math.ceil(upper * _DIGITS) / _DIGITS)


def _lower(passed: Float[np.ndarray, "K"], n: Float[np.ndarray, "K"], confidence: float) -> float:
    from scipy.optimize import minimize_scalar, root_scalar  # noqa: PLC0415 - most commands judge nothing
    from scipy.stats import t  # noqa: PLC0415

    if not passed.any():
        return 0.0
    near = float(t.ppf((1.0 + confidence) / 2.0, len(n) - 1)) ** 2 / 2.0
    if (passed == n).all():
        best, highest = 1.0, 0.0
    else:
        found = minimize_scalar(lambda rate: -_profile(passed, n, rate), bounds=(1e-9, 1.0 - 1e-9), method="bounded")
        best, highest = float(found.x), -float(found.fun)
    least = 1e-9

    def excess(rate: float) -> float:
        return highest - _profile(passed, n, rate) - near

    if excess(least) <= 0.0:
        return 0.0
    return float(root_scalar(excess, bracket=(least, min(best, 1.0 - 1e-12)), xtol=1e-12).root)


def _profile(passed: Float[np.ndarray, "K"], n: Float[np.ndarray, "K"], rate: float) -> float:
    """Returns the log likelihood of a rate, with the spread between worlds at its best, less a constant."""
    from scipy.special import betaln, xlog1py, xlogy  # noqa: PLC0415

    equal = float(np.sum(xlogy(passed, rate) + xlog1py(n - passed, -rate)))
    a, b = rate * _TOTALS, (1.0 - rate) * _TOTALS
    unlike = np.sum(betaln(passed[:, None] + a, (n - passed)[:, None] + b) - betaln(a, b), axis=0)
    return max(equal, float(unlike.max()))
