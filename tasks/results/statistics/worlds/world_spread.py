"""How much of the scatter of outcomes is between worlds, and what that makes of the number of episodes."""

from collections.abc import Sequence

import numpy as np

from specs.base import Spec


class WorldSpread(Spec):
    """How alike the episodes of one world are.

    Attributes:
        worlds: How many worlds have episodes.
        episodes: Episodes of all of them.
        icc: Correlation of two episodes in one world, 0-1; none where the counts do not show it: one world, one episode
            in each, or all episodes alike.
        design_effect: How many times as many episodes these are as independent ones would be, 1 at least; none where
            the correlation is not known.
    """

    worlds: int
    episodes: int
    icc: float | None
    design_effect: float | None

    @property
    def independent_episodes(self) -> float | None:
        """Returns how many episodes, each in a world of its own, these are worth."""
        return None if self.design_effect is None else self.episodes / self.design_effect


def world_spread(successes: Sequence[int], n: Sequence[int]) -> WorldSpread:
    """Returns the intraclass correlation of outcomes in worlds, and the design effect.

    The correlation is that of the analysis of variance (Donner 1986, International Statistical Review 54:67, section 2;
    for counts Ridout, Demetrio and Firth 1999, Biometrics 55:137), 0 where it comes out negative. The design effect is
    that of the share over all episodes, ``1 + (sum n^2 / sum n - 1) icc`` (Kish 1965, Survey Sampling, section 5.4;
    with unequal sizes Donner, section 4).

    Args:
        successes: Of each world, 0 to its ``n``.
        n: Episodes of each world; worlds without any do not count.

    Raises:
        ValueError: The numbers are not such.
    """
    passed, sizes = np.asarray(successes, np.float64), np.asarray(n, np.float64)
    if passed.shape != sizes.shape or (passed < 0).any() or (passed > sizes).any():
        raise ValueError(f"{successes} successes of {n}: one of each per world, 0 <= successes <= n")
    passed, sizes = passed[sizes > 0], sizes[sizes > 0]
    worlds, episodes = len(sizes), float(sizes.sum())
    unknown = WorldSpread(worlds=worlds, episodes=int(episodes), icc=None, design_effect=None)
    if worlds < 2 or episodes == worlds or passed.sum() in {0.0, episodes}:
        return unknown
    rates, rate = passed / sizes, passed.sum() / episodes
    between = float((sizes * (rates - rate) ** 2).sum()) / (worlds - 1)
    within = float((sizes * rates * (1.0 - rates)).sum()) / (episodes - worlds)
    usual = (episodes - float((sizes**2).sum()) / episodes) / (worlds - 1)
    icc = max(0.0, (between - within) / (between + (usual - 1.0) * within))
    effect = 1.0 + (float((sizes**2).sum()) / episodes - 1.0) * icc
    return unknown.model_copy(update={"icc": icc, "design_effect": effect})
