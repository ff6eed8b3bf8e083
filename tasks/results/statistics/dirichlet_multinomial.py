"""The likelihood of counts by world when each world has chances of its own, of many data sets at once.

The chances of a world's episodes to come to each end, such as success and failure, are Dirichlet distributed, so that
its counts are Dirichlet-multinomial (Mosimann 1962, Biometrika 49:65); of two ends they are beta-binomial (Skellam
1948, JRSS B 10:257). In Griffiths' form (1973, Biometrics 29:637) the log likelihood is a sum of
``log(share + i spread)`` over the episodes of each end, less that of ``log(1 + i spread)`` over all episodes, with i
from 0 up in each world. That holds at spread 0 too: there all worlds are equal. The correlation of two episodes in one
world, the ICC, is ``spread / (1 + spread)``.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

# From worlds that are equal to worlds that pass all or nothing. A step is 17 %; between steps a parabola is laid.
SPREADS = np.concatenate([[0.0], np.geomspace(1e-4, 1e4, 121)])
_BESIDE = 2
_LEAST = 1e-12
_NEAR = 1e-11
_NEWTON_STEPS = 80
_TO_THE_EDGE = 0.9


class Tails(NamedTuple):
    """In how many worlds there are more than 0, 1, 2, ... episodes of each end, and of all ends.

    Attributes:
        ends: Of each end, by data set.
        episodes: Of all ends, by data set.
    """

    ends: Float[np.ndarray, "ends sets most"]
    episodes: Float[np.ndarray, "sets most"]


class Peak(NamedTuple):
    """The highest log likelihood of each data set, and where it is.

    Attributes:
        value: Less a constant of the data set.
        shares: Of each end, 0-1.
    """

    value: Float[np.ndarray, " sets"]
    shares: Float[np.ndarray, "ends sets"]


def tails(counts: Int[np.ndarray, "ends sets worlds"]) -> Tails:
    """Returns what the likelihood needs of data sets, given how many episodes of each world came to each end."""
    n = counts.sum(axis=0)
    most = int(n.max())
    return Tails(np.stack([_above(end, most) for end in counts]), _above(n, most))


def profile(data: Tails, shares: Float[np.ndarray, " ends"]) -> Float[np.ndarray, " sets"]:
    """Returns the log likelihood of shares, with the spread at its best, less a constant of each data set."""
    turns = np.arange(data.episodes.shape[1])[:, None] * SPREADS
    values = -(data.episodes @ np.log1p(turns))
    for end, share in zip(data.ends, shares, strict=True):
        values = values + end @ np.log(max(share, _LEAST) + turns)
    return _highest(values)


def peak(data: Tails, shares: Float[np.ndarray, "ends sets"], directions: Float[np.ndarray, "directions ends"]) -> Peak:
    """Returns the highest log likelihood over all spreads, and over all shares that lie in some directions.

    For one spread the likelihood is concave in the shares, a sum of logarithms, so that Newton's steps find its peak.

    Args:
        data: The data sets.
        shares: Where to begin, in the directions of which the peak is sought; each above 0, their sum 1.
        directions: One or two; the sum of each is 0.
    """
    start = shares
    for _ in range(2):  # the best spread depends a little on the shares
        values = _by_spread(data, start)
        start, _ = _climb(data, SPREADS[values.argmax(axis=1)], start, directions)
    values = _by_spread(data, start)
    rows, middle, found = np.arange(len(values)), values.argmax(axis=1), start
    for beside in range(-_BESIDE, _BESIDE + 1):
        column = np.clip(middle + beside, 0, len(SPREADS) - 1)
        at, values[rows, column] = _climb(data, SPREADS[column], start, directions)
        found = at if beside == 0 else found
    return Peak(_highest(values), found)


def _above(counts: Int[np.ndarray, "sets worlds"], most: int) -> Float[np.ndarray, "sets most"]:
    return np.stack([(counts > i).sum(axis=1) for i in range(most)], axis=1).astype(np.float64)


def _by_spread(data: Tails, shares: Float[np.ndarray, "ends sets"]) -> Float[np.ndarray, "sets spreads"]:
    turns = np.arange(data.episodes.shape[1])[:, None] * SPREADS
    values = -(data.episodes @ np.log1p(turns))
    for end, share in zip(data.ends, shares, strict=True):
        some = int(end.any(axis=0).sum())  # seldom ends come to few episodes of a world
        values = values + np.einsum("sm,smt->st", end[:, :some], np.log(share[:, None, None] + turns[:some]))
    return values


def _climb(
    data: Tails,
    spread: Float[np.ndarray, " sets"],
    start: Float[np.ndarray, "ends sets"],
    directions: Float[np.ndarray, "directions ends"],
) -> tuple[Float[np.ndarray, "ends sets"], Float[np.ndarray, " sets"]]:
    """Returns the best shares of one spread a data set, and their log likelihood."""
    turns = spread[:, None] * np.arange(data.episodes.shape[1])
    shares = start
    for _ in range(_NEWTON_STEPS):
        step = _newton_step(data, shares[:, :, None] + turns, directions)
        # Not beyond the edge, where a share is 0, but most of the way to it.
        room = np.where(step < 0.0, _TO_THE_EDGE * (shares - _LEAST) / np.maximum(-step, _LEAST), 1.0).min(axis=0)
        step = step * np.minimum(room, 1.0)
        shares = shares + step
        if float(np.abs(step).max()) < _NEAR:
            break
    value = (data.ends * np.log(shares[:, :, None] + turns)).sum(axis=(0, 2))
    return shares, value - (data.episodes * np.log1p(turns)).sum(axis=1)


def _newton_step(
    data: Tails, at: Float[np.ndarray, "ends sets most"], directions: Float[np.ndarray, "directions ends"]
) -> Float[np.ndarray, "ends sets"]:
    slope = (data.ends / at).sum(axis=2)
    bend = (data.ends / (at * at)).sum(axis=2)
    uphill = np.einsum("de,es->sd", directions, slope)
    curve = np.einsum("de,es,fe->sdf", directions, bend, directions) + _LEAST * np.eye(len(directions))
    return np.einsum("de,sd->es", directions, np.linalg.solve(curve, uphill[:, :, None])[:, :, 0])


def _highest(values: Float[np.ndarray, "sets spreads"]) -> Float[np.ndarray, " sets"]:
    """Returns the highest log likelihood over all spreads: that of a step, or of the parabola through it."""
    best = values.argmax(axis=1)
    middle = np.clip(best, 2, values.shape[1] - 2)
    rows = np.arange(len(values))
    before, at, after = values[rows, middle - 1], values[rows, middle], values[rows, middle + 1]
    bend, slope = 2.0 * at - before - after, after - before
    inside = (best == middle) & (bend > 0.0)
    return values[rows, best] + np.where(inside, slope * slope / np.where(inside, 8.0 * bend, 1.0), 0.0)


def likelihood_drop(seldom: Float[np.ndarray, " sets"], worlds: int, confidence: float) -> Float[np.ndarray, " sets"]:
    """Returns the greater of what few worlds and what few events ask for.

    Few worlds: ``t(K - 1)^2 / 2`` instead of ``z^2 / 2``, since the spread is known by K worlds alone. Few events: of
    f worlds that had one, as the limit of many worlds in which it is rare, f is of a Poisson distribution, whose exact
    bound is ``u = chi2(2 f + 2) / 2`` (Garwood 1936, Biometrika 28:437); there the log likelihood is ``u - f -
    f log(u / f)`` below its highest.

    Args:
        seldom: Of each data set, in how many worlds there was what the bound limits: a failure for a lower bound of
            the success rate, a success for an upper one.
        worlds: Two at least.
        confidence: Coverage, between 0 and 1.
    """
    from scipy.special import gammaincinv, stdtrit, xlogy  # noqa: PLC0415 - most commands judge nothing

    sure = (1.0 + confidence) / 2.0
    bound = gammaincinv(seldom + 1.0, sure)
    few_events = bound - seldom - xlogy(seldom, bound) + xlogy(seldom, seldom)
    return np.maximum(float(stdtrit(worlds - 1, sure)) ** 2 / 2.0, few_events)
