"""Worlds whose chances are known, drawn at random: what intervals over worlds are tried on."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

Chances = Callable[[np.random.Generator, tuple[int, int]], Float[np.ndarray, "sets worlds"]]
REPLICATES = 4_000
CONFIDENCE = 0.95
# Worlds x episodes in each: 384 episodes, and 768.
DESIGNS = ((8, 48), (16, 24), (48, 8), (8, 96), (16, 48), (48, 16))
ICCS = (0.0, 0.05, 0.1, 0.3)
RATES = (0.9, 0.95, 0.98, 0.99)
_AT_ONCE = 200
_MIDDLES = 20_000


def beta(rate: float, icc: float) -> Chances:
    """Returns worlds whose chances are beta distributed; all alike where the correlation is 0."""
    if icc == 0.0:
        return lambda _, shape: np.full(shape, rate)
    total = 1.0 / icc - 1.0
    return lambda random, shape: random.beta(rate * total, (1.0 - rate) * total, shape)


def mixture(common: float, rare: float, share: float) -> Chances:
    """Returns worlds of two kinds, of which one has the given share."""
    return lambda random, shape: np.where(random.random(shape) < share, rare, common)


def logit_normal(middle: float, spread: float) -> Chances:
    """Returns worlds whose log odds are normally distributed about those of a chance."""
    centre = np.log(middle / (1.0 - middle))
    return lambda random, shape: 1.0 / (1.0 + np.exp(-random.normal(centre, spread, shape)))


def logit_normal_rate(middle: float, spread: float) -> float:
    """Returns the mean chance of such worlds, by the middles of equally likely parts."""
    from scipy.stats import norm  # noqa: PLC0415 - as in the code that is measured

    normal = norm.ppf((np.arange(_MIDDLES) + 0.5) / _MIDDLES)
    return float(np.mean(1.0 / (1.0 + np.exp(-(np.log(middle / (1.0 - middle)) + spread * normal)))))


def shares_of(
    shown: Callable[[Int[np.ndarray, "sets worlds"]], tuple[np.ndarray, np.ndarray]],
    counts: Int[np.ndarray, "sets worlds"],
    *,
    alike: bool = True,
) -> tuple[float, float]:
    """Returns the shares of data sets that show that a rate is above one, and below it; equal ones are asked once.

    Args:
        shown: Which of many data sets show so.
        counts: Successes by data set and world.
        alike: Whether worlds have as many episodes, so that their order does not matter.
    """
    some, turn = np.unique(np.sort(counts, axis=1) if alike else counts, axis=0, return_inverse=True)
    answers = [shown(some[first : first + _AT_ONCE]) for first in range(0, len(some), _AT_ONCE)]
    above, below = (np.concatenate([answer[side] for answer in answers])[turn.ravel()].mean() for side in (0, 1))
    return float(above), float(below)
