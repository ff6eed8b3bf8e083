"""How many episodes, pairs or worlds give a rule a certain power: exactly, and in worlds like these by simulation.

The power is the chance that the rule passes. A rule about a share tolerates so many bad episodes of n; where it
tolerates one more, the power jumps up, and between two jumps it falls (Chernick and Liu 2002, The American Statistician
56:149). So the fewest episodes are those from which on it never falls below what is asked for.

Of n pairs of two versions a binomial number disagrees, and of these half are gains; the rule passes by Tango's score
test (Tango 1998, Statistics in Medicine 17:891). The power is the sum over all numbers that disagree; no normal
approximation is used.

Worlds are drawn as ``tasks.results.statistics.over_worlds`` believes them to be: each with a chance of its own, beta
distributed, so that its good episodes are beta-binomial (Williams 1975, Biometrics 31:949), and two of one world are
correlated by 1 / (a + b + 1), the ICC. The interval's condition is asked of a grid of rates and spreads, which is the
same for all draws, so that many draws cost a product of two matrices. Seeds are fixed: the same question, the same
answer. The power is smooth in the square root of the number of worlds on the probit scale, so that a line through a few
simulated points gives the number; by it and by the draws it is known within about a tenth.
"""

import math
from collections.abc import Callable
from functools import cache
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from tasks.results.statistics.dirichlet_multinomial import likelihood_drop
from tasks.results.statistics.intervals import likeliest_losses
from tasks.results.statistics.over_worlds import why_refused

_MOST_BAD = 1 << 22
_NEGLIGIBLE = 1e-17
_RAGGED = 64


class PowerNeeds(NamedTuple):
    """What a rule needs, and what it has.

    Attributes:
        for_80: Episodes, pairs or worlds from which on the rule passes with a probability of 0.8 at least.
        for_90: Those for 0.9.
        power: The probability, 0-1, with as many as there are or more: the least of it, so that it never falls.
    """

    for_80: int
    for_90: int
    power: float


def share_needs(at_least: float, confidence: float, rate: float, there: int) -> PowerNeeds | None:
    """Returns what a rule needs whose lower Wilson bound must reach a bar; None where no number is enough.

    The bound reaches the bar exactly when the score test does: share - bar >= z sqrt(bar (1 - bar) / n).

    Args:
        at_least: The bar, 0-1.
        confidence: Coverage of the two-sided interval.
        rate: The share of good episodes that one expects, 0-1.
        there: How many episodes there are.
    """
    if at_least == 0.0:
        return PowerNeeds(1, 1, 1.0 if there else 0.0)
    if rate <= at_least:
        return None
    return _needs(_by_wilson(at_least, confidence), 1.0 - rate, there)


def quantile_needs(tail: float, confidence: float, beyond: float, there: int) -> PowerNeeds | None:
    """Returns what a rule needs that bounds a quantile by order statistics; None where no number is enough.

    Args:
        tail: The share of episodes that may be beyond the bar: of a bar from below the quantile, else 1 less it.
        confidence: Coverage of the two-sided interval.
        beyond: The share of episodes beyond the bar that one expects.
        there: How many episodes there are.
    """
    if beyond >= tail:
        return None
    return _needs(_by_rank(tail, confidence), beyond, there)


def effective_episodes(worlds: int, per_world: int, icc: float) -> float:
    """Returns how many independent episodes tell as much of the mean rate of worlds like these.

    Kish 1965, Survey Sampling, section 8.2: the design effect of clusters of equal size is 1 + (size - 1) icc.

    Args:
        worlds: How many there are.
        per_world: Episodes of each.
        icc: How alike the episodes of one world are, 0-1.
    """
    return worlds * per_world / (1.0 + (per_world - 1) * max(0.0, icc))


def _by_wilson(at_least: float, confidence: float) -> Callable[[int], int]:
    """Returns the fewest episodes of which so many may be bad, as a function of these."""
    z = NormalDist().inv_cdf((1.0 + confidence) / 2.0)
    spread = z * math.sqrt(at_least * (1.0 - at_least))

    def fewest(bad: int) -> int:
        # (1 - bar) n - spread sqrt(n) - bad >= 0 is a quadratic inequality of sqrt(n).
        root = (spread + math.sqrt(spread * spread + 4.0 * (1.0 - at_least) * bad)) / (2.0 * (1.0 - at_least))
        n = max(1, math.ceil(root * root) - 1)
        while (1.0 - at_least) * n - bad < spread * math.sqrt(n):
            n += 1
        return n

    return fewest


def _by_rank(tail: float, confidence: float) -> Callable[[int], int]:
    """Returns the fewest episodes of which so many may be beyond, as a function of these."""
    chance = (1.0 - confidence) / 2.0

    def fewest(bad: int) -> int:
        known, enough = bad, max(1, 2 * bad)
        while at_most(bad, enough, tail) >= chance:
            known, enough = enough, 2 * enough
        while enough - known > 1:
            middle = (known + enough) // 2
            known, enough = (known, middle) if at_most(bad, middle, tail) < chance else (middle, enough)
        return enough

    return fewest


def _needs(fewest: Callable[[int], int], bad_rate: float, there: int) -> PowerNeeds | None:
    fewest = cache(fewest)
    needed = [_fewest_for(fewest, bad_rate, power) for power in (0.8, 0.9)]
    if None in needed:
        return None
    tolerated = _last(lambda bad: fewest(bad) <= there)
    if tolerated is None:
        return PowerNeeds(needed[0] or 0, needed[1] or 0, 0.0)
    lows = [_low(fewest, bad, bad_rate) for bad in range(tolerated, tolerated + _RAGGED)]
    return PowerNeeds(needed[0] or 0, needed[1] or 0, min(at_most(tolerated, there, bad_rate), *lows))


def _low(fewest: Callable[[int], int], bad: int, bad_rate: float) -> float:
    """Returns the power right before one more bad episode is tolerated."""
    return at_most(bad, fewest(bad + 1) - 1, bad_rate)


def _fewest_for(fewest: Callable[[int], int], bad_rate: float, power: float) -> int | None:
    """Returns from how many episodes on the power is never below; the lowest is right before the next jump."""

    def short(bad: int) -> bool:
        return _low(fewest, bad, bad_rate) < power

    last = _last(short)
    if last == _MOST_BAD:
        return None
    # The lows rise, but as n is whole, not each above the one before it.
    last = max((bad for bad in range(last or 0, (last or 0) + _RAGGED) if short(bad)), default=None)
    return fewest(0 if last is None else last + 1)


def _last(holds: Callable[[int], bool]) -> int | None:
    """Returns the last number for which something holds that later does not; None if it does not hold for 0."""
    if not holds(0):
        return None
    known, other = 0, 1
    while holds(other):
        known, other = other, 2 * other
        if other > _MOST_BAD:
            return _MOST_BAD
    while other - known > 1:
        middle = (known + other) // 2
        known, other = (middle, other) if holds(middle) else (known, middle)
    return known


def at_most(count: int, n: int, chance: float) -> float:
    """Returns the probability that a binomial number is at most so large; scipy would take a second to import.

    Args:
        count: At least 0.
        n: How many tries there are.
        chance: Of each, 0-1.
    """
    if count >= n or chance <= 0.0:
        return 1.0
    if chance >= 1.0:
        return 0.0
    if count + 1 > n * chance:  # the shorter sum is that above
        return 1.0 - _tail_sum(count + 1, 1, n, chance)
    return _tail_sum(count, -1, n, chance)


def _tail_sum(start: int, step: int, n: int, chance: float) -> float:
    """Returns the sum of probabilities from one count on, away from the mean."""
    odds = chance / (1.0 - chance)
    log = math.lgamma(n + 1) - math.lgamma(start + 1) - math.lgamma(n - start + 1)
    term = math.exp(log + start * math.log(chance) + (n - start) * math.log1p(-chance))
    total, count = term, start
    while 0 <= count + step <= n and term > _NEGLIGIBLE * total:
        term *= odds * (n - count) / (count + 1) if step > 0 else count / (odds * (n - count + 1))
        count += step
        total += term
    return total


_MOST_PAIRS = 1 << 17
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
    needed = [_fewest_pairs(margin, z, disagreeing, power) for power in (0.8, 0.9)]
    if None in needed:
        return None
    tooth = math.ceil(_TEETH / margin) if there <= _SMOOTH else 0
    power = float(pair_power(np.arange(there, there + tooth + 1), margin, z, disagreeing).min()) if there else 0.0
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


def _fewest_pairs(margin: float, z: float, disagreeing: float, power: float) -> int | None:
    """Returns from how many pairs on the power is never below, or None."""

    def enough(n: int) -> bool:
        return bool(pair_power(np.array([n]), margin, z, disagreeing)[0] >= power)

    known, other = 0, 1
    while not enough(other):
        if other >= _MOST_PAIRS:
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
    variance = n * (2.0 * likeliest_losses(gains, losses, n, -margin) - margin * (1.0 + margin))
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


_DRAWS = 400
_SEED = 18
_MOST_WORLDS = 1 << 14
_LINE_POINTS = 5
_ROUNDS = 3
_RATE_STEP = 0.14
_TOTALS = np.geomspace(1e-2, 1e5, 21)
_NORMAL = NormalDist()


def world_needs(
    at_least: float, confidence: float, rate: float, *, icc: float, per_world: int, there: int
) -> PowerNeeds | None:
    """Returns how many worlds a rate needs to be shown in worlds like these; None where no number is enough.

    Args:
        at_least: The bar, 0-1.
        confidence: Coverage of the two-sided interval.
        rate: The mean share of good episodes that one expects, 0-1.
        icc: How alike the episodes of one world are, 0 to below 1.
        per_world: Episodes of each world.
        there: How many worlds there are.
    """
    if rate <= at_least:
        return None
    if at_least == 0.0:
        return PowerNeeds(_fewest_worlds(), _fewest_worlds(), float(there >= _fewest_worlds()))
    if rate >= 1.0:
        fewest = next(
            (worlds for worlds in range(_fewest_worlds(), _MOST_WORLDS) if _all_good(at_least, confidence, worlds)),
            None,
        )
        return PowerNeeds(fewest, fewest, float(there >= fewest)) if fewest else None
    question = (at_least, confidence, rate, icc, per_world)
    independent = share_needs(at_least, confidence, rate, 0)
    guess = independent.for_80 / effective_episodes(1, per_world, icc) if independent else _MOST_WORLDS
    if guess > _MOST_WORLDS:
        return None
    needed = [max(_fewest_worlds(), each) for each in _crossings(question, max(4, round(guess)))]
    power = _power(*question, there) if there >= _fewest_worlds() else 0.0
    # The draws may say otherwise than the line through others, which the numbers come from.
    low, high = (0.0, 0.799) if there < needed[0] else (0.8, 0.899) if there < needed[1] else (0.9, 1.0)
    return PowerNeeds(needed[0], needed[1], min(max(power, low), high))


def _fewest_worlds() -> int:
    """Returns from how many worlds on the interval says anything."""
    return next(worlds for worlds in range(2, _MOST_WORLDS) if not why_refused("rate", worlds))


def _crossings(question: tuple[float, float, float, float, int], guess: int) -> tuple[int, int]:
    """Returns from how many worlds on the power is 0.8 and 0.9, by a line through points that come nearer to them."""
    points = {guess, math.ceil(1.4 * guess)}
    crossings = (guess, guess)
    for _ in range(_ROUNDS):
        powers = {each: min(max(_power(*question, each), 0.5 / _DRAWS), 1.0 - 0.5 / _DRAWS) for each in points}
        near = sorted(points, key=lambda each: abs(powers[each] - 0.85))[:_LINE_POINTS]
        slope, start = np.polyfit(np.sqrt(near), [_NORMAL.inv_cdf(powers[each]) for each in near], 1)
        slope = max(float(slope), 0.05)
        roots = [(_NORMAL.inv_cdf(wanted) - float(start)) / slope for wanted in (0.8, 0.9)]
        found = [max(2, math.ceil(max(0.0, root) ** 2)) for root in roots]
        crossings = (min(found[0], 4 * max(points)), min(found[1], 4 * max(points)))
        points |= set(crossings)
    return crossings


@cache
def _power(at_least: float, confidence: float, rate: float, icc: float, per_world: int, worlds: int) -> float:  # noqa: PLR0917 - as above
    chances = np.exp(_log_chances(per_world, np.array([rate]), _total(icc))[:, 0, 0])
    drawn = np.random.default_rng(_SEED).multinomial(worlds, chances / chances.sum(), size=_DRAWS)
    seen = np.flatnonzero(drawn.any(axis=0))
    likelihood, counts = _grid(at_least, per_world)[seen], drawn[:, seen].astype(np.float64)
    fit = (counts @ likelihood.reshape(len(seen), -1)).reshape(_DRAWS, *likelihood.shape[1:])
    by_rate = fit.max(axis=1)  # the spread between worlds at its best; the first rate is the bar
    bad_worlds = worlds - drawn[:, -1]
    highest = np.where(bad_worlds == 0, 0.0, by_rate.max(axis=1))
    near = likelihood_drop(np.arange(float(bad_worlds.max()) + 1.0), worlds, confidence)
    share = drawn @ np.arange(per_world + 1) / (worlds * per_world)
    score = (share - at_least) * math.sqrt(worlds * per_world / (at_least * (1.0 - at_least)))
    shown = (highest - by_rate[:, 0] > near[bad_worlds]) & (score > _NORMAL.inv_cdf((1.0 + confidence) / 2.0))
    return float(np.mean(shown))


def _total(icc: float) -> Float[np.ndarray, " 1"]:
    return np.array([1.0 / max(icc, 1e-9) - 1.0])


@cache
def _grid(at_least: float, per_world: int) -> Float[np.ndarray, "V T R"]:
    """Returns the log likelihood of each number of good episodes of a world, by spread, and by rate from the bar on."""
    logit = math.log(at_least / (1.0 - at_least))
    rates = 1.0 / (1.0 + np.exp(-np.arange(logit, max(logit + 2.0, 9.0), _RATE_STEP)))
    rates[0] = at_least
    return _log_chances(per_world, rates, _TOTALS)


def _log_chances(n: int, rates: Float[np.ndarray, " R"], totals: Float[np.ndarray, " T"]) -> Float[np.ndarray, "V T R"]:
    """Returns the log of the beta-binomial probability of 0 to n good ones; the products of gammas as sums of logs."""
    steps = np.arange(n)[:, None, None]

    def rising(start: Float[np.ndarray, "1 T R"]) -> Float[np.ndarray, "V T R"]:
        logs = np.log(start + steps)
        return np.concatenate([np.zeros_like(logs[:1]), np.cumsum(logs, axis=0)])

    total = totals[None, :, None]
    good, bad = rising(rates * total), rising((1.0 - rates) * total)
    return _log_choices(n)[:, None, None] + good + bad[::-1] - rising(total)[-1]


def _log_choices(n: int) -> Float[np.ndarray, " V"]:
    logs = np.concatenate([[0.0], np.cumsum(np.log(np.arange(1, n + 1)))])
    return logs[-1] - logs - logs[::-1]


def _all_good(at_least: float, confidence: float, worlds: int) -> bool:
    """Returns whether worlds without a bad episode are enough; each might be good or bad as a whole."""
    return -worlds * math.log(at_least) >= likelihood_drop(np.zeros(1), worlds, confidence)[0]
