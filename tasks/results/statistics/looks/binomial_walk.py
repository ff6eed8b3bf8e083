"""The numbers of successes at which a share is found too high to be chance, at each of the looks at a batch.

The count of successes is a walk: at a look it goes up by a binomial number. What it does until it first reaches a
boundary is computed state by state, without an approximation (Jennison and Turnbull 2000, Group Sequential Methods with
Applications to Clinical Trials, section 12.1), for many shares at once.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

# States less likely than that are left out, and the error that may be spent is smaller by more than all of them have.
_NEGLIGIBLE, _RESERVE = 1e-14, 1e-8

Shares = Float[np.ndarray, " shares"]


class Walk(NamedTuple):
    """Where the walk is before any boundary was reached.

    Attributes:
        first: The number of successes of the first column.
        chances: The probability of each number of successes, a row a share.
    """

    first: int
    chances: Float[np.ndarray, "shares counts"]


def least_successes(looks: Sequence[int], spent: Sequence[float], shares: Shares) -> Int[np.ndarray, "shares looks"]:
    """Returns from how many successes on a share is found to be higher, at each look.

    They are the fewest at which the chance to have reached one of them, at this look or before, is no more than may be
    spent until then. What whole numbers leave over of an earlier look is spent at a later one.

    Args:
        looks: Episodes at each look, rising.
        spent: How much error may be used up after each look.
        shares: The shares against which is tested, a row of the answer each.
    """
    walk, used, before = start_walk(len(shares)), np.zeros(len(shares)), 0
    found: list[Int[np.ndarray, " shares"]] = []
    for look, allowed in zip(looks, spent, strict=True):
        walk = step_walk(walk, shares, look - before)
        tails = np.cumsum(walk.chances[:, ::-1], axis=1)[:, ::-1]
        skipped = (used[:, None] + tails > allowed - _RESERVE).sum(axis=1)
        used = used + np.where(skipped < tails.shape[1], tails[_rows(skipped, tails)], 0.0)
        found.append(walk.first + skipped)
        walk = Walk(walk.first, np.where(np.arange(tails.shape[1]) < skipped[:, None], walk.chances, 0.0))
        before = look
    return np.stack(found, axis=1)


def start_walk(shares: int) -> Walk:
    """Returns the walk before the first episode."""
    return Walk(0, np.ones((shares, 1)))


def step_walk(walk: Walk, shares: Shares, episodes: int) -> Walk:
    """Returns the walk after more episodes, without states that are next to impossible.

    Args:
        walk: Where it was.
        shares: The chance of a success, a row each.
        episodes: How many more there are.
    """
    from scipy.stats import binom  # noqa: PLC0415 - most commands judge nothing

    steps = binom.pmf(np.arange(episodes + 1), episodes, shares[:, None])
    width = walk.chances.shape[1]
    chances = np.zeros((len(shares), width + episodes))
    for more in np.flatnonzero(steps.max(axis=0) > _NEGLIGIBLE):
        chances[:, more : more + width] += steps[:, more, None] * walk.chances
    likely = np.flatnonzero(chances.max(axis=0) > _NEGLIGIBLE)
    first, last = (int(likely[0]), int(likely[-1])) if len(likely) else (0, 0)
    return Walk(walk.first + first, chances[:, first : last + 1])


def _rows(columns: Int[np.ndarray, " shares"], table: Float[np.ndarray, "shares counts"]) -> tuple[np.ndarray, ...]:
    return np.arange(len(columns)), np.minimum(columns, table.shape[1] - 1)
