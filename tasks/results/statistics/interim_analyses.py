"""Tests and intervals of a batch that is analysed before its last episode, and may be ended by what is seen then.

A test that looks K times has to share its error among the looks. A spending function says how much may be used up once
a share t of the episodes is in, whatever the looks are (Lan and DeMets 1983, Biometrika 70:659). The one here is that
of Hwang, Shih and DeCani 1990 (Statistics in Medicine 9:1439) with the parameter -2: it lies between O'Brien and
Fleming, who spend next to nothing at first, and equal parts. What it was compared with, and why it was taken, is in
``docs/decisions/0022-looks-with-an-end-in-sight.md``.

The count of successes is a walk: at a look it goes up by a binomial number. What it does until it first reaches a
boundary is computed state by state, without an approximation (Jennison and Turnbull 2000, Group Sequential Methods with
Applications to Clinical Trials, section 12.1), for many shares at once.

The interval of a share at a look holds the shares against which that test has not spoken: repeated confidence intervals
by inversion (Jennison and Turnbull 1989, JRSS B 51:305). So it says of any bar what the test says, and is valid for a
bar that comes to mind later. A share is tested in both directions, each with half of the error, and neither relies on
the batch having been stopped by the other. Whole numbers keep the test from being quite monotonous: once in a while it
speaks against a share and not against a slightly lower one. The interval's lower bound is below both, so that whoever
passes a bar passes all lower ones.

The interval of a difference of two shares is the ordinary one at a stricter level, which follows from what a look may
spend. Strict levels ask for more than the normal tail of Tango's score: where one in fifty pairs disagrees, five losses
of fifty are a hundred times likelier than it says. So the tail of the difference is computed without an approximation,
with the nuisance parameter at its maximum likelihood under the difference that is tested (Tango 1998, Statistics in
Medicine 17:891, equation 2.3, for the likelihood; Lloyd 2008, Biometrics 64:716, for such tails and how near they are
to exact).

What becomes of a batch that may be ended at any look, how often it passes and after how many episodes, is computed from
the same walk: the boundary is that of the test at the bar, and of the tests at shares below it, one of which may ask
for one success more.
"""

import itertools
import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from tasks.results.statistics.intervals import Interval, clopper_pearson, likeliest_losses

_GAMMA = -2.0
# The walk's density lives within eight standard deviations; Simpson's rule on so many points errs by less than 1e-9.
_DENSITY_REACH, _DENSITY_POINTS = 8.0, 401
_LEVEL_HALVINGS = 60


def spent_error(looks: Sequence[int], alpha: float) -> tuple[float, ...]:
    """Returns how much error may be used up after each look, the last number being ``alpha``.

    Args:
        looks: Episodes at each look, rising; the last number is that of the whole batch.
        alpha: Of a one-sided test, between 0 and 1.

    Raises:
        ValueError: The looks do not rise from 1 on, or there are none.
    """
    if not looks or looks[0] < 1 or any(later <= look for look, later in itertools.pairwise(looks)):
        raise ValueError(f"looks at {tuple(looks)} episodes: at least one, rising from 1 on")
    whole = math.expm1(-_GAMMA)
    return tuple(alpha * math.expm1(-_GAMMA * look / looks[-1]) / whole for look in looks)


def nominal_levels(looks: Sequence[int], spent: Sequence[float]) -> tuple[float, ...]:
    """Returns the level of the ordinary one-sided test at each look, at which all looks together err as they may.

    For a statistic that is normal with independent increments, by numerical integration over the walk's density
    (Armitage, McPherson and Rowe 1969, JRSS A 132:235; Jennison and Turnbull 2000, Group Sequential Methods, chapter
    19). Five equal looks that spend alpha as O'Brien and Fleming give their critical values.

    Args:
        looks: Episodes at each look, rising.
        spent: How much error may be used up after each.
    """
    levels, used, before = list[float](), 0.0, 0.0
    points, mass = np.zeros(1), np.ones(1)
    for look, allowed in zip(looks, spent, strict=True):
        time = look / looks[-1]
        step, deviation = math.sqrt(time - before), math.sqrt(time)
        bar = _bar(points, mass, step, allowed - used, deviation)
        levels.append(0.5 * math.erfc(bar / deviation / math.sqrt(2.0)))
        points, mass = _survivors(points, mass, step, bar, deviation)
        used, before = allowed, time
    return tuple(levels)


def _bar(
    points: Float[np.ndarray, " points"], mass: Float[np.ndarray, " points"], step: float, allowed: float, top: float
) -> float:
    """Returns where the walk has to be so that it is there, or above, with that probability."""
    from scipy.special import ndtr  # noqa: PLC0415 - most commands judge nothing

    low, high = -_DENSITY_REACH * top, (_DENSITY_REACH + 2.0) * top
    for _ in range(_LEVEL_HALVINGS):
        middle = (low + high) / 2.0
        reached = float(mass @ ndtr((points - middle) / step))
        low, high = (middle, high) if reached > allowed else (low, middle)
    return high


def _survivors(
    points: Float[np.ndarray, " points"],
    mass: Float[np.ndarray, " points"],
    step: float,
    bar: float,
    deviation: float,
) -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, " points"]]:
    """Returns points below the bar after the next step, and the probability that each stands for."""
    onward = np.linspace(-_DENSITY_REACH * deviation, bar, _DENSITY_POINTS)
    away = (onward[:, None] - points[None, :]) / step
    density = np.exp(-0.5 * away * away) @ mass / (step * math.sqrt(2.0 * math.pi))
    weights = np.full(_DENSITY_POINTS, 2.0)
    weights[1::2], weights[0], weights[-1] = 4.0, 1.0, 1.0
    return onward, density * weights * (onward[1] - onward[0]) / 3.0


# States less likely than that are left out, and the error that may be spent is smaller by more than all of them have.
_NEGLIGIBLE, _WALK_RESERVE = 1e-14, 1e-8

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
        skipped = (used[:, None] + tails > allowed - _WALK_RESERVE).sum(axis=1)
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


# Tested are multiples of a step, in millionths: how far from 0 and 1 a step is fine enough, and the step.
_WHOLE = 1_000_000
_STEPS = ((100_000, 500), (10_000, 100), (1_000, 10), (0, 1))
_TAIL_RESERVE, _ABOVE, _ROUNDING = 1e-8, 1e-9, 1e-6


@lru_cache(maxsize=4096)
def repeated_interval(successes: int, n: int, looks: tuple[int, ...], confidence: float) -> Interval:
    """Returns the interval that holds the share at all looks together with at least that confidence.

    Args:
        successes: Of the episodes so far.
        n: How many there were: one of the looks; none says nothing.
        looks: After how many episodes the batch is looked at, rising, the last being all of its episodes.
        confidence: Coverage, between 0 and 1.

    Raises:
        ValueError: The numbers are not such.
    """
    if n == 0:
        return Interval(lower=0.0, upper=1.0)
    if n not in looks or not 0 <= successes <= n:
        raise ValueError(f"{successes} successes of {n}: 0 <= successes <= n, and n one of the looks {looks}")
    seen = looks[: looks.index(n) + 1]
    spent = spent_error(looks, (1.0 - confidence) / 2.0)[: len(seen)]
    return Interval(
        lower=_share_bound(successes, seen, spent), upper=round(1.0 - _share_bound(n - successes, seen, spent), 9)
    )


def inner_interval(successes: int, n: int, looks: tuple[int, ...], confidence: float) -> Interval:
    """Returns an interval that the repeated one reaches beyond: where it is not clear of a bar, that is not either.

    It takes no walk, so that one can ask at each of many looks whether it is worth while to ask for the other. It is
    that of Clopper and Pearson 1934 (Biometrika 26:404), with all the error that may be spent until that look.
    """
    if n == 0:
        return Interval(lower=0.0, upper=1.0)
    return clopper_pearson(successes, n, spent_error(looks, (1.0 - confidence) / 2.0)[looks.index(n)])


def tested_shares(lowest: float, highest: float) -> Float[np.ndarray, " shares"]:
    """Returns the shares that are tested between two; each stands for those from the one before it on.

    Args:
        lowest: The first is at or below it.
        highest: The last is at or above it.
    """
    points = [_round_down(lowest)]
    while points[-1] < highest * _WHOLE - _ROUNDING:
        points.append(_next(points[-1]))
    return np.array([point for point in points if point]) / _WHOLE


def _share_bound(successes: int, looks: Sequence[int], spent: Sequence[float]) -> float:
    """Returns the lower bound: right above the highest share that is rejected, as that is not in the interval."""
    rejected = _highest_rejected_share(successes, looks, spent)
    return rejected / _WHOLE + _ABOVE if rejected else 0.0


def _highest_rejected_share(successes: int, looks: Sequence[int], spent: Sequence[float]) -> int:
    """Returns the highest share, in millionths, that the test rejects together with all lower ones.

    Where the ordinary tail is within what this look alone may spend, a share is rejected for certain; where it exceeds
    what all looks may have spent, it is not. Only what is between has to be walked through.
    """
    if successes == 0:
        return 0
    from scipy.special import betaincinv  # noqa: PLC0415 - most commands judge nothing

    n, before = looks[-1], spent[-2] if len(spent) > 1 else 0.0
    least = max(spent[-1] - before - _TAIL_RESERVE, 0.0)
    certain, possible = betaincinv(successes, n - successes + 1, [least, spent[-1]])
    start = _round_down(float(certain))
    points = _grid(start, math.floor(possible * _WHOLE))
    if not len(points):
        return start
    rejected = least_successes(looks, spent, points / _WHOLE)[:, -1] <= successes
    count = len(points) if rejected.all() else int(np.argmin(rejected))
    return int(points[count - 1]) if count else start


def _round_down(share: float) -> int:
    millionths = math.floor(share * _WHOLE)
    step = _step(millionths)
    return millionths // step * step


def _grid(above: int, highest: int) -> Int[np.ndarray, " points"]:
    """Returns the shares that are tested, above one and up to another, in millionths."""
    points, point = list[int](), above
    while (point := _next(point)) <= highest:
        points.append(point)
    return np.array(points, dtype=np.int64)


def _next(millionths: int) -> int:
    """Returns the next share that is tested; what is tested is the same wherever one begins."""
    step = _step(millionths + 1)
    return (millionths // step + 1) * step


def _step(millionths: int) -> int:
    edge = min(millionths, _WHOLE - millionths)
    return next(step for least, step in _STEPS if edge >= least)


_DIFFERENCE_HALVINGS = 40
_DIFFERENCE_DIGITS = 1e6


@lru_cache(maxsize=4096)
def paired_interval(gains: int, losses: int, n: int, looks: tuple[int, ...], confidence: float) -> Interval:
    """Returns the interval that holds the difference at all looks together with about that confidence.

    Args:
        gains: How many pairs so far succeeded with the first and not with the second.
        losses: How many succeeded with the second and not with the first.
        n: How many pairs there were, those that agree included: one of the looks; none says nothing.
        looks: After how many pairs the batch is looked at, rising, the last being all of its pairs.
        confidence: Coverage, between 0 and 1.

    Raises:
        ValueError: The numbers are not such.
    """
    if n == 0:
        return Interval(lower=-1.0, upper=1.0)
    if n not in looks or not (gains >= 0 <= losses and gains + losses <= n):
        raise ValueError(f"{gains} gains and {losses} losses of {n} pairs, {n} being one of the looks {looks}")
    level = _paired_levels(looks, confidence)[looks.index(n)]
    upper = -_highest_rejected_difference(losses, gains, n, level)
    return Interval(lower=_highest_rejected_difference(gains, losses, n, level), upper=upper)


def difference_tail(gains: int, losses: int, n: int, difference: float) -> float:
    """Returns how likely so many more gains than losses are, or still more, if the difference is the one given.

    Args:
        gains: Pairs that count for a higher difference.
        losses: Pairs that count against it.
        n: All pairs.
        difference: Between -1 and 1.
    """
    lost = max(float(likeliest_losses(gains, losses, n, difference)), 0.0, -difference)
    gained = max(0.0, lost + difference)
    size = 1 << (2 * n + 1).bit_length()
    turn = np.exp(-2j * np.pi * np.arange(size // 2 + 1) / size)
    # The generating function of one pair, to the power of n: the chances of each difference, modulo the size.
    chances = np.fft.irfft((lost / turn + max(0.0, 1.0 - gained - lost) + gained * turn) ** n, size)
    above = gains - losses
    tail = chances[above : n + 1].sum() if above >= 0 else chances[: n + 1].sum() + chances[above:].sum()
    return float(tail)


@lru_cache(maxsize=128)
def _paired_levels(looks: tuple[int, ...], confidence: float) -> tuple[float, ...]:
    return nominal_levels(looks, spent_error(looks, (1.0 - confidence) / 2.0))


def _highest_rejected_difference(gains: int, losses: int, n: int, level: float) -> float:
    """Returns the highest difference that the level rejects, rounded down to the same number on any machine."""
    low, high = -1.0, (gains - losses) / n
    if high == low:
        return low
    for _ in range(_DIFFERENCE_HALVINGS):
        middle = (low + high) / 2.0
        rejected = difference_tail(gains, losses, n, middle) <= level
        low, high = (middle, high) if rejected else (low, middle)
    return math.floor(low * _DIFFERENCE_DIGITS) / _DIFFERENCE_DIGITS


_BOUNDARY_DEVIATIONS = 2.0


class Chances(NamedTuple):
    """What becomes of a batch.

    Attributes:
        passes: The probability that it is found at or above the bar.
        fails: The probability that it is found below.
        episodes: How many it drives in the mean.
    """

    passes: float
    fails: float
    episodes: float


class Boundary(NamedTuple):
    """Where a batch ends.

    Attributes:
        passes: From how many successes on it passes, at each look; more than there are episodes where it cannot.
        fails: Up to how many it fails; below 0 where it cannot.
    """

    passes: tuple[int, ...]
    fails: tuple[int, ...]


def looks_of(episodes: int, chunk: int) -> tuple[int, ...]:
    """Returns after how many episodes a batch in chunks is looked at: after each chunk."""
    return (*range(chunk, episodes, chunk), episodes)


@lru_cache(maxsize=512)
def boundary(looks: tuple[int, ...], bar: float, confidence: float) -> Boundary:
    """Returns the numbers of successes at which a batch is certain.

    Args:
        looks: After how many episodes it is looked at, rising, the last being all of its episodes.
        bar: The share, above 0 and below 1.
        confidence: Coverage of the two-sided interval.
    """
    spent = spent_error(looks, (1.0 - confidence) / 2.0)
    above, below = (closed_boundary(looks, spent, share) for share in (bar, 1.0 - bar))
    return Boundary(above, tuple(look - failures for look, failures in zip(looks, below, strict=True)))


def closed_boundary(looks: Sequence[int], spent: Sequence[float], bar: float) -> tuple[int, ...]:
    """Returns from how many successes on a bar and the shares below it are rejected, at each look.

    Of shares further below than two standard deviations of the whole batch none asks for more.

    Args:
        looks: Episodes at each look, rising.
        spent: How much error may be used up after each look.
        bar: The share.
    """
    deviation = math.sqrt(bar * (1.0 - bar) / looks[-1])
    shares = tested_shares(max(bar - _BOUNDARY_DEVIATIONS * deviation, bar / 2.0), bar)
    return tuple(int(successes) for successes in least_successes(looks, spent, shares).max(axis=0))


def chances(looks: tuple[int, ...], bar: float, confidence: float, rate: float) -> Chances:
    """Returns what becomes of a batch whose true rate is known: its power where that is above the bar.

    Args:
        looks: After how many episodes it is looked at, rising, the last being all of its episodes.
        bar: The share, above 0 and below 1.
        confidence: Coverage of the two-sided interval.
        rate: The true share of successes, 0-1.
    """
    return chances_between(looks, boundary(looks, bar, confidence), rate)


def chances_between(looks: Sequence[int], ends: Boundary, rate: float) -> Chances:
    """Returns what becomes of a batch that ends at such numbers of successes."""
    walk, before, passed, failed, episodes = start_walk(1), 0, 0.0, 0.0, 0.0
    for look, above, below in zip(looks, ends.passes, ends.fails, strict=True):
        going = float(walk.chances.sum())
        episodes += going * (look - before)
        walk = step_walk(walk, np.array([rate]), look - before)
        counts = walk.first + np.arange(walk.chances.shape[1])
        passes, fails = counts >= above, (counts <= below) & (counts < above)
        passed, failed = passed + float(walk.chances[0, passes].sum()), failed + float(walk.chances[0, fails].sum())
        walk, before = Walk(walk.first, np.where(passes | fails, 0.0, walk.chances)), look
    return Chances(passed, failed, episodes)
