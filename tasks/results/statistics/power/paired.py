"""How many pairs show with a certain power that a version is no worse than another one it is as good as, exactly.

Of n pairs a binomial number disagrees, and of these half are gains; the rule passes by Tango's score test (Tango 1998,
Statistics in Medicine 17:891). The power is the sum over all numbers that disagree; no normal approximation is used.
"""

import math
from statistics import NormalDist

import numpy as np
from jaxtyping import Bool, Float, Int

from tasks.results.statistics.power.shares import PowerNeeds

_MOST = 1 << 17
_BLOCK = 32
_SPREADS = 5.5
# The power goes up where one more pair may be lost, every 1 / margin pairs; of thousands of pairs by a hair.
_TEETH = 4
_SMOOTH = 4000


def pair_needs(margin: float, confidence: float, disagreeing: float, there: int) -> PowerNeeds | None:
    """Returns what the rule needs if both versions are equally good; None where no number is enough.

    Args:
        margin: How much worse the version may be.
        confidence: Coverage of the two-sided interval.
        disagreeing: The share of pairs that one passes and the other fails, half of them each.
        there: How many pairs there are.
    """
    if margin == 0.0:
        return None
    z = NormalDist().inv_cdf((1.0 + confidence) / 2.0)
    needed = [_fewest(margin, z, disagreeing, power) for power in (0.8, 0.9)]
    if None in needed:
        return None
    power = float(pair_power(np.array([there]), margin, z, disagreeing)[0]) if there else 0.0
    return PowerNeeds(needed[0] or 0, needed[1] or 0, power)


def pair_power(pairs: Int[np.ndarray, " N"], margin: float, z: float, disagreeing: float) -> Float[np.ndarray, " N"]:
    """Returns the probability that the rule passes, for several numbers of pairs.

    Args:
        pairs: How many there are, at least 1.
        margin: How much worse the version may be, above 0.
        z: The normal quantile of the interval.
        disagreeing: The share of pairs that one passes and the other fails, half of them each.
    """
    n = np.asarray(pairs, np.int64)[:, None]
    middle, spread = disagreeing * n, np.sqrt(disagreeing * n) + 1.0
    first = max(0, int(np.floor((middle - _SPREADS * spread).min())))
    last = min(int(n.max()), int(np.ceil((middle + _SPREADS * spread).max())))
    unlike = np.arange(first, last + 1)[None, :]
    logs = np.concatenate([[0.0], np.cumsum(np.log(np.arange(1, int(n.max()) + 1)))])
    gains = _fewest_gains(unlike, n, margin, z)
    passes = np.where(unlike <= n, _half_above(first, last, logs)[unlike - first, gains], 0.0)
    return (passes * _chances(unlike, n, disagreeing, logs)).sum(axis=1)


def _fewest(margin: float, z: float, disagreeing: float, power: float) -> int | None:
    """Returns from how many pairs on the power is never below, or None."""

    def enough(n: int) -> bool:
        return bool(pair_power(np.array([n]), margin, z, disagreeing)[0] >= power)

    known, other = 0, 1
    while not enough(other):
        if other >= _MOST:
            return None
        known, other = other, 2 * other
    while other - known > 1:
        middle = (known + other) // 2
        known, other = (known, middle) if enough(middle) else (middle, other)
    if other > _SMOOTH:
        return other
    for top in range(math.ceil(other + _TEETH / margin), 0, -_BLOCK):
        block = np.arange(max(1, top - _BLOCK + 1), top + 1)
        short = pair_power(block, margin, z, disagreeing) < power
        if short.any():
            return int(block[short].max()) + 1
    return 1


def _fewest_gains(unlike: Int[np.ndarray, "1 D"], n: Int[np.ndarray, "N 1"], margin: float, z: float) -> np.ndarray:
    """Returns how many of those that disagree must be gains; one more than all where not even all are enough."""
    least = np.zeros(np.broadcast_shapes(unlike.shape, n.shape), np.int64)
    most = np.broadcast_to(unlike + 1, least.shape).copy()
    while (least < most).any():
        middle = (least + most) // 2
        shown = _shown(middle, unlike - middle, n, margin, z)
        least, most = np.where(shown, least, np.minimum(middle + 1, most)), np.where(shown, middle, most)
    return most


def _shown(
    gains: Int[np.ndarray, "N D"], losses: Int[np.ndarray, "N D"], n: Int[np.ndarray, "N 1"], margin: float, z: float
) -> Bool[np.ndarray, "N D"]:
    """Returns whether the score at the margin is at least z, its nuisance parameter at the maximum likelihood."""
    linear = -(2 * n - gains + losses) * margin - gains - losses
    constant = losses * margin * (1.0 + margin)
    lost = (np.sqrt(np.maximum(0.0, linear * linear - 8 * n * constant)) - linear) / (4 * n)
    variance = n * (2.0 * lost - margin * (1.0 + margin))
    return gains - losses + n * margin >= z * np.sqrt(np.maximum(variance, 0.0))


def _half_above(first: int, last: int, logs: Float[np.ndarray, " n"]) -> Float[np.ndarray, "D G"]:
    """Returns the probability of at least G heads of D tosses, for D from the first to the last and G from 0 on."""
    tosses, heads = np.arange(first, last + 1)[:, None], np.arange(last + 2)[None, :]
    below = np.maximum(tosses - heads, 0)
    log = logs[tosses] - logs[np.minimum(heads, len(logs) - 1)] - logs[below] - tosses * math.log(2.0)
    chance = np.where(heads <= tosses, np.exp(log), 0.0)
    return np.cumsum(chance[:, ::-1], axis=1)[:, ::-1]


def _chances(
    unlike: Int[np.ndarray, "1 D"], n: Int[np.ndarray, "N 1"], disagreeing: float, logs: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "N D"]:
    if disagreeing == 0.0:
        return np.where(unlike == 0, 1.0, 0.0) * np.ones_like(n)
    alike = np.maximum(n - unlike, 0)
    log = logs[n] - logs[np.minimum(unlike, n)] - logs[alike]
    log = log + unlike * math.log(disagreeing) + alike * math.log1p(-disagreeing)
    return np.where(unlike <= n, np.exp(log), 0.0)
