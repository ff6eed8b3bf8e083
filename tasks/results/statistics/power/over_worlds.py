"""How many worlds give a rule about a rate in worlds like these a certain power, by simulation.

Worlds are drawn as ``tasks.results.statistics.worlds.rate_over_worlds`` believes them to be: each with a chance of its
own, beta distributed, so that its good episodes are beta-binomial (Williams 1975, Biometrics 31:949), and two of one
world are correlated by 1 / (a + b + 1), the ICC. The interval's condition is asked of a grid of rates and spreads,
which is the same for all draws, so that many draws cost a product of two matrices. Seeds are fixed: the same question,
the same answer. The power is smooth in the square root of the number of worlds on the probit scale, so that a line
through a few simulated points gives the number; by it and by the draws it is known within about a tenth.
"""

import math
from functools import cache
from statistics import NormalDist

import numpy as np
from jaxtyping import Float

from tasks.results.statistics.power.shares import PowerNeeds, effective_episodes, share_needs
from tasks.results.statistics.worlds.refusal import why_refused

_DRAWS = 400
_SEED = 18
_MOST = 1 << 14
_POINTS = 5
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
        return PowerNeeds(_fewest(), _fewest(), float(there >= _fewest()))
    if rate >= 1.0:
        fewest = next((worlds for worlds in range(_fewest(), _MOST) if _all_good(at_least, confidence, worlds)), None)
        return PowerNeeds(fewest, fewest, float(there >= fewest)) if fewest else None
    question = (at_least, confidence, rate, icc, per_world)
    independent = share_needs(at_least, confidence, rate, 0)
    guess = independent.for_80 / effective_episodes(1, per_world, icc) if independent else _MOST
    if guess > _MOST:
        return None
    needed = [max(_fewest(), each) for each in _crossings(question, max(4, round(guess)))]
    return PowerNeeds(needed[0], needed[1], _power(*question, there) if there >= _fewest() else 0.0)


def _fewest() -> int:
    """Returns from how many worlds on the interval says anything."""
    return next(worlds for worlds in range(2, _MOST) if not why_refused("rate", worlds))


def _crossings(question: tuple[float, float, float, float, int], guess: int) -> tuple[int, int]:
    """Returns from how many worlds on the power is 0.8 and 0.9, by a line through points that come nearer to them."""
    points = {guess, math.ceil(1.4 * guess)}
    crossings = (guess, guess)
    for _ in range(_ROUNDS):
        powers = {each: min(max(_power(*question, each), 0.5 / _DRAWS), 1.0 - 0.5 / _DRAWS) for each in points}
        near = sorted(points, key=lambda each: abs(powers[each] - 0.85))[:_POINTS]
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
    near = np.array([needed_nearness(confidence, worlds, int(bad)) for bad in range(int(bad_worlds.max()) + 1)])
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
    return -worlds * math.log(at_least) >= needed_nearness(confidence, worlds, 0)


def needed_nearness(confidence: float, worlds: int, bad: int) -> float:
    """Returns what ``tasks.results.statistics.worlds.nearness`` does for so many worlds with a bad episode."""
    sure = (1.0 + confidence) / 2.0
    bound = _poisson_bound(bad, 1.0 - sure)
    few_events = bound - bad - (bad * math.log(bound / bad) if bad else 0.0)
    return max(student_quantile(sure, worlds - 1) ** 2 / 2.0, few_events)


@cache
def _poisson_bound(count: int, chance: float) -> float:
    """Returns the mean at which a Poisson number is at most so large with that chance (Garwood 1936)."""
    low, high = float(count), 3.0 * count + 40.0
    for _ in range(60):
        mean = (low + high) / 2.0
        logs = (each * math.log(mean) - mean - math.lgamma(each + 1) for each in range(count + 1))
        low, high = (mean, high) if sum(map(math.exp, logs)) > chance else (low, mean)
    return high


@cache
def student_quantile(probability: float, freedom: int) -> float:
    """Returns a quantile of Student's t distribution; scipy, which has it, takes a second to import.

    With t = sqrt(freedom) tan(angle), the density of the angle is proportional to cos(angle)^(freedom - 1) (Student
    1908, Biometrika 6:1).

    Args:
        probability: 0.5 or above, and below 1.
        freedom: Degrees of freedom, at least 1.
    """
    widest = math.pi / 2.0 if freedom < 200 else 12.0 / math.sqrt(freedom)
    angles: Float[np.ndarray, " A"] = np.linspace(0.0, widest, 20_001)
    density = np.cos(angles) ** (freedom - 1)
    area = np.concatenate([[0.0], np.cumsum((density[1:] + density[:-1]) / 2.0)])
    angle = np.interp(2.0 * probability - 1.0, area / area[-1], angles)
    return math.sqrt(freedom) * math.tan(float(angle))
