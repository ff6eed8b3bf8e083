"""The likelihood of counts by world when each world has a chance of its own, of many data sets at once.

The chances of a world's episodes to come to each end are Dirichlet distributed (of two ends: beta), so that its counts
are Dirichlet-multinomial (Mosimann 1962, Biometrika 49:65; of two ends beta-binomial, Skellam 1948, JRSS B 10:257). In
Griffiths' form (1973, Biometrics 29:637) the log likelihood is a sum of ``log(share + i spread)`` over the episodes i
of each end, which holds at spread 0 too: there all worlds are equal. The correlation of two episodes in one world, the
ICC, is ``spread / (1 + spread)``.
"""

import numpy as np
from jaxtyping import Float, Int

# From worlds that are equal to worlds that pass all or nothing. A step is 15 %; between steps a parabola is laid.
_STEPS = np.geomspace(1e-4, 1e4, 121)
_SPREADS = np.concatenate([[0.0], _STEPS])
_LEAST_SHARE = 1e-12


def tails(counts: Int[np.ndarray, "sets worlds"], most: int) -> Float[np.ndarray, "sets most"]:
    """Returns in how many worlds there are more than 0, 1, 2, ... ``most - 1`` of something."""
    above = np.stack([(counts > i).sum(axis=1) for i in range(most)], axis=1)
    return above.astype(np.float64)


def log_likelihoods(
    ends: list[tuple[Float[np.ndarray, "sets most"], float]], episodes: Float[np.ndarray, "#sets most"]
) -> Float[np.ndarray, "sets spreads"]:
    """Returns the log likelihood of data sets for each spread, less a constant of the data set.

    Args:
        ends: Of each end that an episode may come to, the tails of its counts and its share, 0-1.
        episodes: The tails of the numbers of episodes.
    """
    turns = np.arange(episodes.shape[1])[:, None] * _SPREADS
    found = -(episodes @ np.log1p(turns))
    for counts, share in ends:
        found = found + counts @ np.log(max(share, _LEAST_SHARE) + turns)
    return found


def highest(values: Float[np.ndarray, "sets spreads"]) -> Float[np.ndarray, " sets"]:
    """Returns the highest log likelihood over all spreads: that of a step, or of the parabola through it."""
    best = np.clip(values[:, 1:].argmax(axis=1) + 1, 2, values.shape[1] - 2)
    rows = np.arange(len(values))
    before, at, after = values[rows, best - 1], values[rows, best], values[rows, best + 1]
    bend = 2.0 * at - before - after
    slope = after - before
    with np.errstate(divide="ignore", invalid="ignore"):
        above = np.where((bend > 0.0) & (np.abs(slope) <= 2.0 * bend), slope * slope / (8.0 * bend), 0.0)
    return np.maximum(values.max(axis=1), at + above)
