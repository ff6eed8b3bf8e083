"""Intervals of rates, differences and quantiles in worlds like those that were drawn, which differ by more than chance.

Each world has chances of its own: one for success, beta distributed; or, of pairs of episodes, three for gain, loss and
tie, Dirichlet distributed. The rate, or the difference, is that of the mean chances. The interval holds those whose
profile likelihood, with the spread between worlds and the share of ties at their best, is near the highest one
(Williams 1975, Biometrics 31:949). docs/decisions/0021 says what near is, and why; docs/reference/statistics.md how
often it covers.
"""

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from specs.base import Spec
from tasks.results.statistics.dirichlet_multinomial import Peak, Tails, likelihood_drop, peak, profile, tails
from tasks.results.statistics.intervals import Interval, in_worlds, paired_difference, percent_range, wilson

_FEWEST_WORLDS = 2
_WORLDS_IN_THE_TAIL = 2.0
_ROUNDING = 1e-9


def why_refused(of: Literal["rate", "quantile", "difference"], worlds: int, tail: float = 1.0) -> str:
    """Returns why an interval over worlds says nothing, as a sentence; empty where it says something.

    Args:
        of: What the interval is of.
        worlds: How many worlds have episodes.
        tail: Of a quantile: the share of values beyond it on the side of the bound, 0-1. That is the quantile for its
            lower bound, and 1 less the quantile for its upper one.
    """
    if worlds < _FEWEST_WORLDS:
        return f"{worlds} {'world says' if worlds == 1 else 'worlds say'} nothing of other worlds: draw 2 or more"
    fewest = math.ceil(_WORLDS_IN_THE_TAIL / tail - _ROUNDING)
    if of == "quantile" and worlds < fewest:
        return f"{worlds} worlds show too little of where {100.0 * tail:g} % of the values end: draw {fewest} or more"
    return ""


_DIGITS = 1e9
_NEAREST = 1e-9
_SUCCESS_AND_FAILURE = np.array([[1.0, -1.0]])


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
    data, plain = _rate_data(passed[None], episodes), wilson(int(passed.sum()), int(episodes.sum()), confidence)
    lower = (
        _lower_rate(data, float(likelihood_drop(data.ends[1][:, 0], len(n), confidence)[0])) if passed.any() else 0.0
    )
    turned = Tails(data.ends[::-1], data.episodes)
    below = (
        _lower_rate(turned, float(likelihood_drop(data.ends[0][:, 0], len(n), confidence)[0]))
        if data.ends[1].any()
        else 0.0
    )
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

    data = _rate_data(successes, n)
    best = best_rates(data)
    doubt = best.value - profile(data, np.array([rate, 1.0 - rate]))
    above = best.shares[0] > rate
    seldom = np.where(above, data.ends[1][:, 0], data.ends[0][:, 0])
    unlike = doubt > likelihood_drop(seldom, len(n), confidence)
    score = (successes.sum(axis=1) / n.sum() - rate) / math.sqrt(rate * (1.0 - rate) / n.sum())
    z = float(ndtri((1.0 + confidence) / 2.0))
    return unlike & above & (score > z), unlike & ~above & (score < -z)


def best_rates(data: Tails) -> Peak:
    """Returns the most likely rate of each data set, and how likely it is."""
    passed = data.ends[0].sum(axis=1) / data.episodes.sum(axis=1)
    start = np.clip(passed, _NEAREST, 1.0 - _NEAREST)
    return peak(data, np.stack([start, 1.0 - start]), _SUCCESS_AND_FAILURE)


def _rate_data(successes: Int[np.ndarray, "sets worlds"], n: Int[np.ndarray, " worlds"]) -> Tails:
    return tails(np.stack([successes, n - successes]))


def _lower_rate(data: Tails, near: float) -> float:
    from scipy.optimize import root_scalar  # noqa: PLC0415 - most commands judge nothing

    best = best_rates(data)
    enough = float(best.value[0]) - near

    def excess(rate: float) -> float:
        return float(profile(data, np.array([rate, 1.0 - rate]))[0]) - enough

    if excess(_NEAREST) >= 0.0:
        return 0.0
    return float(root_scalar(excess, bracket=(_NEAREST, float(best.shares[0, 0])), xtol=1e-12).root)


_AT_ONCE = 24


def quantile_over_worlds(values_by_world: Sequence[Sequence[float]], quantile: float, confidence: float) -> Interval:
    """Returns the interval of a quantile: the values at which the share of smaller ones may be the quantile.

    Woodruff 1952 (JASA 47:635): the interval of the share below a value, here `rate_over_worlds`, is turned into one
    of the value. Where there are too few worlds for a bound, it is infinite.

    Args:
        values_by_world: Of each world its values, in any order; infinite ones stand for what is not known but on that
            side. Worlds without any do not count.
        quantile: Between 0 and 1.
        confidence: Coverage, between 0 and 1.

    Raises:
        ValueError: The quantile or the confidence is not between 0 and 1.
    """
    if not (0.0 < quantile < 1.0 and 0.0 < confidence < 1.0):
        raise ValueError(f"quantile {quantile} with confidence {confidence}: both between 0 and 1")
    worlds = [np.sort(np.asarray(values, np.float64)) for values in values_by_world if len(values)]
    turned = [-values[::-1] for values in worlds]
    return Interval(
        lower=_lower_quantile(worlds, quantile, confidence), upper=-_lower_quantile(turned, 1.0 - quantile, confidence)
    )


def _lower_quantile(worlds: list[Float[np.ndarray, " values"]], quantile: float, confidence: float) -> float:
    """Returns the lowest value, going down from the quantile of all, whose predecessor is shown to be below it."""
    if why_refused("quantile", len(worlds), tail=quantile):
        return -math.inf
    together = np.sort(np.concatenate(worlds))
    middle = together[max(0, math.ceil(quantile * len(together) - _ROUNDING) - 1)]
    cuts = np.unique(together[together <= middle])
    # Values equal to a cut are below it or at it; none is at the last, lowest cut.
    for first in range(len(cuts) - 1, -1, -_AT_ONCE):
        some = np.arange(first, max(-1, first - _AT_ONCE), -1)
        below = np.concatenate([cuts, [-math.inf]])[some - 1]
        shown = _below(worlds, below, some == 0, quantile, confidence)
        if shown.any():
            return float(cuts[some[shown.argmax()]])
    return -math.inf


def _below(
    worlds: list[Float[np.ndarray, " values"]],
    cuts: Float[np.ndarray, " cuts"],
    lowest: Bool[np.ndarray, " cuts"],
    quantile: float,
    confidence: float,
) -> Bool[np.ndarray, " cuts"]:
    """Returns at which cuts the share of values up to there is shown to be less than the quantile."""
    counts = np.stack([np.searchsorted(values, cuts, side="right") for values in worlds], axis=1)
    counts[lowest] = 0
    return rates_shown(counts, np.array([len(values) for values in worlds]), quantile, confidence)[1]


_GAIN_LOSS_TIE = np.array([[1.0, 0.0, -1.0], [0.0, 1.0, -1.0]])
_DISAGREEING = np.array([[0.5, 0.5, -1.0]])


# A pair of episodes is a gain, a loss or a tie. Each world has chances of its own for the three, Dirichlet
# distributed; the difference is that of the mean chances. The interval holds the differences whose profile
# likelihood, with the share of ties and the spread between worlds at their best, is near the highest one, as
# `rate_over_worlds` does for one rate.
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
    data = _pair_data(won[None], lost[None], pairs)
    turned = Tails(data.ends[[1, 0, 2]], data.episodes)
    plain = paired_difference(int(won.sum()), int(lost.sum()), int(pairs.sum()), confidence)
    lower = _lower_difference(data, float(likelihood_drop(data.ends[1][:, 0], len(n), confidence)[0]))
    below = _lower_difference(turned, float(likelihood_drop(data.ends[0][:, 0], len(n), confidence)[0]))
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
    data = _pair_data(gains, losses, n)
    best = _best_differences(data)
    above = best.shares[0] - best.shares[1] > difference
    seldom = np.where(above, data.ends[1][:, 0], data.ends[0][:, 0])
    unlike = best.value - _difference_profile(data, difference) > likelihood_drop(seldom, len(n), confidence)
    return unlike & above, unlike & ~above


def _pair_data(
    gains: Int[np.ndarray, "sets worlds"], losses: Int[np.ndarray, "sets worlds"], n: Int[np.ndarray, " worlds"]
) -> Tails:
    return tails(np.stack([gains, losses, n - gains - losses]))


def _pooled(data: Tails) -> Float[np.ndarray, "3 sets"]:
    shares = np.maximum(data.ends.sum(axis=2), _NEAREST)
    return shares / shares.sum(axis=0)


def _best_differences(data: Tails) -> Peak:
    return peak(data, _pooled(data), _GAIN_LOSS_TIE)


def _difference_profile(data: Tails, difference: float) -> Float[np.ndarray, " sets"]:
    """Returns the log likelihood of a difference, with the share of ties and the spread at their best."""
    pooled = _pooled(data)
    least = abs(difference)
    disagreeing = np.clip(pooled[0] + pooled[1], least + _NEAREST, 1.0 - _NEAREST)
    shares = np.stack([(disagreeing + difference) / 2.0, (disagreeing - difference) / 2.0, 1.0 - disagreeing])
    return peak(data, np.maximum(shares, _NEAREST / 4.0), _DISAGREEING).value


def _lower_difference(data: Tails, near: float) -> float:
    from scipy.optimize import root_scalar  # noqa: PLC0415 - most commands judge nothing

    best, least = _best_differences(data), -1.0 + 4.0 * _NEAREST
    enough = float(best.value[0]) - near

    def excess(difference: float) -> float:
        return float(_difference_profile(data, difference)[0]) - enough

    if excess(least) >= 0.0:
        return -1.0
    likeliest = float(best.shares[0, 0] - best.shares[1, 0])
    return float(root_scalar(excess, bracket=(least, likeliest), xtol=1e-12).root)


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


# An interval of independent episodes would be a fortieth shorter at most.
_ALIKE = 1.05


class WorldsLikeThese(Spec):
    """What the episodes of some worlds say of worlds that were not drawn.

    Attributes:
        spread: How much the worlds differ.
        confidence: Coverage of the interval, between 0 and 1.
        interval: Of the rate in worlds like these; None where nothing is said of it.
        refused: Why nothing is said; else empty.
    """

    spread: WorldSpread
    confidence: float
    interval: Interval | None = None
    refused: str = ""

    def sentences(self) -> tuple[str, ...]:
        """Returns how much the worlds differ, and what the rate is in worlds like these, as far as that is known."""
        return tuple(filter(None, [self._spread(), self._rate()]))

    def _spread(self) -> str:
        found = self.spread
        if found.icc is None or found.design_effect is None or found.independent_episodes is None:
            return ""
        shown = f"(ICC {found.icc:.2f}, design effect {found.design_effect:.1f})"
        if found.design_effect < _ALIKE:
            return f"No difference between these worlds is seen {shown}."
        worth = max(1, round(found.independent_episodes))
        return (
            f"Worlds differ {shown}: these {found.episodes:,} episodes tell as much about worlds like these as about "
            f"{worth:,} independent one{'s' * (worth > 1)}."
        )

    def _rate(self) -> str:
        where = in_worlds(self.spread.worlds, like_these=True)
        if self.interval is None:
            return f"Nothing is said of the rate {where}: {self.refused}." if self.refused else ""
        return f"The rate {where}: {100 * self.confidence:g}\u00a0% interval {percent_range(self.interval)}."


def worlds_like_these(
    successes: Sequence[int], n: Sequence[int], confidence: float, *, refused: str = ""
) -> WorldsLikeThese:
    """Returns what episodes say of worlds like theirs.

    Args:
        successes: Of each world, 0 to its ``n``.
        n: Episodes of each world; worlds without any do not count.
        confidence: Coverage of the interval, between 0 and 1.
        refused: Why no interval holds, such as that the batch might have ended early; else empty.

    Raises:
        ValueError: The numbers are not such.
    """
    spread = world_spread(successes, n)
    why = refused or (why_refused("rate", spread.worlds) if spread.worlds else "")
    if why or not spread.worlds:
        return WorldsLikeThese(spread=spread, confidence=confidence, refused=why)
    counted = [(passed, count) for passed, count in zip(successes, n, strict=True) if count]
    interval = rate_over_worlds([passed for passed, _ in counted], [count for _, count in counted], confidence)
    return WorldsLikeThese(spread=spread, confidence=confidence, interval=interval)
