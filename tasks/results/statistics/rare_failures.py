"""The probability of a rare failure, by as few episodes as it takes.

What varies is drawn from its own distribution; an episode's score is how far it was from failing, and below 0 it
failed. A pilot says about how rare failures are, and that says how they are counted:

- by plain draws, where those need fewest episodes;
- by thinned draws, of which those are simulated that may fail, after populations of multilevel splitting have taught
  which may;
- by populations alone where failures are too rare for that, or where nobody can tell which may, as seeds decide.

The algorithm is a generator: it yields what is to be simulated, and is sent scores. Its numbers follow from its seed
and the scores alone, so that whoever keeps the scores takes it up again wherever it was left.
"""

from collections.abc import Generator
from math import ceil, exp, sqrt
from typing import Literal, NamedTuple, TypeVar

import numpy as np
from jaxtyping import Float64

from specs.base import Spec
from tasks.results.statistics.intervals import Interval, clopper_pearson, weighted_count_interval
from tasks.results.statistics.particles import Particles, Scores, Space, plain_particles, side_by_side
from tasks.results.statistics.populations import (
    LENGTH,
    PASSED_KEPT,
    PILOT_SHARE,
    POPULATIONS,
    Aim,
    Pilot,
    Seen,
    joined,
    reach_of,
    seen_together,
    simulated_pilot,
    simulated_populations,
)
from tasks.results.statistics.thinned_draws import (
    Counted,
    Lot,
    Thinned,
    counted,
    draws_for,
    is_thinnable,
    most_simulated,
    thinned,
)

# Chains of each of the populations that teach where failures are: a fifth of what the budget gives, and of these:
_TAUGHT, _FEWEST_TEACHING, _MOST_TEACHING = 5, 6, 20
# The lot that says whether thinned draws are better: an eighth of what is left then, or so many at most.
_TRIAL, _MOST_OF_TRIAL = 8, 1_500
_FEWEST_OF_LOT = 500


class FailureProbability(Spec):
    """How probable a failure is.

    Attributes:
        estimate: The probability.
        interval: Covers it with the confidence that was asked for, if the measure or what varies tells of all failures;
            of plain draws, always.
        highest: An upper bound also if there are failures that nothing tells of.
        method: How it was found.
        why: Why so, as a sentence.
        episodes: How many were simulated in all, the pilot's among them.
        levels: Scores that populations went through, from far to near; empty for plain draws.
        ended: Whether the interval was narrow enough, or the budget was spent.
        against: The version that passes where an episode counts as a failure; None where each failure counts.
    """

    estimate: float
    interval: Interval
    highest: float
    method: Literal["thinned", "splitting", "draws"]
    why: str
    episodes: int
    levels: tuple[float, ...] = ()
    ended: Literal["narrow", "spent"] = "spent"
    against: str | None = None

    @property
    def sentence(self) -> str:
        """The probability, its interval, what it took, how it was found, and why it ended."""
        how = {"thinned": "thinned draws", "splitting": "multilevel splitting", "draws": "plain draws"}[self.method]
        ended = "; the interval is as narrow as asked for" if self.ended == "narrow" else ""
        within = f"({self.interval.lower:.3g} to {self.interval.upper:.3g})"
        where = f" where version {self.against} passes" if self.against else ""
        unannounced = (
            f"; at most {self.highest:.3g} if there are failures that nothing announces"
            if self.highest > self.interval.upper
            else ""
        )
        return (
            f"fails{where} with probability {self.estimate:.3g} {within}, by "
            f"{self.episodes:,} episodes of {how}: {self.why}{unannounced}{ended}"
        )


class Estimated(NamedTuple):
    """How probable a failure is, and the particles that say so."""

    probability: FailureProbability
    seen: Seen


Estimation = Generator[Particles, Scores, Estimated]


def failure_probability(
    space: Space, *, budget: int, confidence: float, seed: int, relative_error: float | None = None
) -> Estimation:
    """Yields particles to be scored, is sent their scores, and returns how probable a score below 0 is.

    Weighted particles that failed stand for all failures without bias, as the estimate itself does.

    Args:
        space: What varies.
        budget: How many episodes may be simulated; at least 1,000.
        confidence: Of the interval, between 0 and 1.
        seed: Everything that is drawn follows from it.
        relative_error: How far the interval may reach for the search to end before its budget is spent, as a share of
            the probability; None spends the budget.

    Raises:
        ValueError: The budget is too small.
    """
    aim = Aim(confidence, relative_error)
    if budget < 20 * PILOT_SHARE:
        raise ValueError(f"budget: {budget}: at least {20 * PILOT_SHARE}")
    known = _Known(space, seed)
    pilot = yield from known.keeping(simulated_pilot(space, budget, seed))
    left = budget - pilot.episodes
    if pilot.why_draws(left):
        return (yield from _plain_draws(space, left, pilot, aim, seed))
    if not is_thinnable(pilot.about):
        rare = f"by a pilot about 1 in {1.0 / pilot.about:,.0f} fails"
        why = f"{rare}: too rare for plain draws, and for a choice among them"
        return (yield from _populations(known, pilot, left, aim, why))
    return (yield from _lots(known, pilot, left, aim))


_T = TypeVar("_T")


class _Known:
    """All that a search has simulated so far.

    Attributes:
        space: What varies.
        seed: The search's.
    """

    def __init__(self, space: Space, seed: int) -> None:
        self.space, self.seed = space, seed
        self._particles, self._scores = list[Particles](), list[Scores]()

    def keeping(self, going: Generator[Particles, Scores, _T]) -> Generator[Particles, Scores, _T]:
        """Yields what another generator does, keeps what it is sent, and returns what that returns."""
        particles = next(going)
        while True:
            scores = yield particles
            self._particles.append(particles)
            self._scores.append(scores)
            try:
                particles = going.send(scores)
            except StopIteration as end:
                return end.value

    @property
    def all(self) -> tuple[Particles, Scores]:
        """The particles and their scores."""
        return side_by_side(self._particles), np.concatenate(self._scores)


def _populations(known: _Known, pilot: Pilot, left: int, aim: Aim, why: str, *, first: int = 0) -> Estimation:
    """Yields the particles of independent populations; returns what they say together.

    Where an interval is wider than asked for, more populations of the same size are added, as many as their scatter
    says, and as the budget gives (Stein 1945, Annals of Mathematical Statistics 16:243).

    Args:
        known: What was simulated before.
        pilot: Has the levels.
        left: How many episodes may be simulated.
        aim: How sharp the estimate has to be.
        why: Why populations, as a sentence.
        first: The number of the first population, from 0.
    """
    chains = pilot.chains_for(aim, left)
    cost = chains * pilot.episodes_of_chain
    count, estimates, plain_failures, episodes = POPULATIONS, np.zeros(0), 0, 0
    seen: list[Seen] = []
    while True:
        found = yield from simulated_populations(
            known.space, pilot, chains, range(first + len(estimates), first + len(estimates) + count), known.seed
        )
        estimates = np.concatenate([estimates, found.estimates])
        seen.append(found.seen)
        plain_failures, episodes = plain_failures + found.plain_failures, episodes + found.episodes
        plain_draws, tail = len(estimates) * chains * LENGTH, (1.0 - aim.confidence) / 2.0
        plain = clopper_pearson(plain_failures, plain_draws, tail)
        estimate, interval = float(estimates.mean()), scatter_interval(estimates, aim.confidence, plain)
        count = (left - episodes) // cost
        if aim.relative_error is None or aim.reached(estimate, interval) or count < 1:
            break
        reach = reach_of(estimate, interval) / aim.relative_error
        count = min(count, max(ceil(len(estimates) * (min(reach, 1e3) ** 2 - 1.0)), POPULATIONS // 4))
    scatter = float(estimates.var(ddof=1)) / len(estimates)
    highest = weighted_count_interval(estimate, scatter, 1.0 / plain_draws, tail).upper
    probability = FailureProbability(
        estimate=estimate,
        interval=interval,
        highest=max(highest, interval.upper),
        method="splitting",
        why=why,
        episodes=pilot.episodes + episodes,
        levels=(*pilot.levels[:-1], 0.0),
        ended="narrow" if aim.reached(estimate, interval) else "spent",
    )
    return Estimated(probability, seen_together(seen))


def _lots(known: _Known, pilot: Pilot, left: int, aim: Aim) -> Estimation:
    """Yields populations, which teach where failures are, and then lots of thinned draws; returns what these say.

    A first lot says whether they scatter less than further populations would, which take the rest if not: seeds may
    decide, which nobody can learn. So it counts no more than the populations that taught, or it would be kept where it
    met too few failures.
    """
    space, seed = known.space, known.seed
    chains = min(max(pilot.chains(left) // _TAUGHT, _FEWEST_TEACHING), _MOST_TEACHING)
    taught = yield from known.keeping(simulated_populations(space, pilot, chains, range(POPULATIONS), seed))
    left -= taught.episodes
    size = min(left // _TRIAL, _MOST_OF_TRIAL)
    lot = Lot(space, seed, 1, draws_for(pilot.about, size), size)
    trial = yield from known.keeping(thinned(lot, known.all, pilot.near, None))
    spent, left = pilot.episodes + taught.episodes + len(trial.scores), left - len(trial.scores)
    if pilot.scatter(left) < trial.scatter(left):
        why = f"by a pilot about 1 in {1.0 / pilot.about:,.0f} fails, and it can hardly be told which of many draws may"
        return (yield from _populations(known, pilot._replace(episodes=spent), left, aim, why, first=POPULATIONS))
    lots, found = list[Thinned](), counted([trial], aim.confidence)
    drawn, about = len(trial.scores), found.estimate or pilot.about
    while not lots or (left >= _FEWEST_OF_LOT and not aim.reached(found.estimate, found.interval)):
        size = _size_of_next(found, drawn, aim, left, most_simulated(about))
        lot = Lot(space, seed, len(lots) + 2, draws_for(about, size), size)
        lots.append((yield from known.keeping(thinned(lot, known.all, pilot.near, lots[-1] if lots else trial))))
        found, left = counted(lots, aim.confidence), left - len(lots[-1].scores)
        spent, drawn = spent + len(lots[-1].scores), sum(len(each.scores) for each in lots)
        about = found.estimate or about
    probability = FailureProbability(
        estimate=found.estimate,
        interval=found.interval,
        highest=found.highest,
        method="thinned",
        why=f"by a pilot about 1 in {1.0 / pilot.about:,.0f} fails, and it can be told which of many draws may",
        episodes=spent,
        levels=(*pilot.levels[:-1], 0.0),
        ended="narrow" if aim.reached(found.estimate, found.interval) else "spent",
    )
    return Estimated(probability, _seen_of_lots(lots))


def _size_of_next(found: Counted, drawn: int, aim: Aim, left: int, most: int) -> int:
    """Returns how many of the next lot are simulated: the rest, in lots that are as large, or as many as it takes.

    Args:
        found: What the lots so far say.
        drawn: How many of them were simulated.
        aim: How sharp the estimate has to be.
        left: How many episodes may be simulated.
        most: How many of a lot may be.
    """
    size = left
    if aim.relative_error is not None:
        reach = min(reach_of(found.estimate, found.interval) / aim.relative_error, 1e3)
        size = max(ceil(drawn * reach**2) - drawn, _FEWEST_OF_LOT)
        if left - size < _FEWEST_OF_LOT:
            size = left
    return ceil(size / ceil(size / most))


def _seen_of_lots(lots: list[Thinned]) -> Seen:
    """Returns what lots have seen, cut into as many populations as splitting has.

    A population has a part of all draws, one after the other: how many of them fail varies as that of plain draws does.
    """
    whole = sum(len(each.scores) for each in lots)
    particles, failing = (
        side_by_side([each.particles for each in lots]),
        np.concatenate([each.failing for each in lots]),
    )
    weights = np.concatenate([each.weights * (len(each.scores) / whole) for each in lots])
    population = np.concatenate([(POPULATIONS * each.places).astype(np.int64) for each in lots])
    return Seen(
        failed=particles.take(np.flatnonzero(failing)),
        weights=POPULATIONS * weights[failing],
        failed_of=population[failing],
        passed=particles.take(np.flatnonzero(~failing)),
        passed_of=population[~failing],
        populations=POPULATIONS,
        passed_weights=weights[~failing],
    )


def scatter_interval(estimates: Float64[np.ndarray, "populations"], confidence: float, plain: Interval) -> Interval:
    """Returns the interval of the mean of estimates, which are never below 0 and skewed, on the scale of logarithms.

    Few skewed numbers often scatter less than their distribution, and so the wider of two is taken: that of the mean,
    and that of a log-normal distribution's mean (Cox's, in Zhou and Gao 1997, Statistics in Medicine 16:783).

    Args:
        estimates: Independent, of one distribution.
        confidence: Of the interval.
        plain: Of the same probability, by the plain draws that populations began with: where all died out.
    """
    from scipy.special import stdtrit  # noqa: PLC0415 - it takes long to load

    mean = float(estimates.mean())
    if mean == 0.0:
        return plain
    count = len(estimates)
    deviation = float(estimates.std(ddof=1)) / (mean * sqrt(count))
    if estimates.min() > 0.0:
        variance = float(np.log(estimates).var(ddof=1))
        deviation = max(deviation, sqrt(variance / count + variance**2 / (2 * (count - 1))))
    reach = float(stdtrit(count - 1, (1.0 + confidence) / 2.0)) * deviation
    return Interval(lower=mean * exp(-reach), upper=min(mean * exp(reach), 1.0))


_DRAWN_AT_ONCE = 4096


def _plain_draws(space: Space, left: int, pilot: Pilot, aim: Aim, seed: int) -> Estimation:
    """Yields plain draws, as many as are left or needed, and returns the share that failed with its exact interval."""
    failed = drawn = 0
    interval = Interval(lower=0.0, upper=1.0)
    parts: list[tuple[Particles, Scores]] = []
    for part, first in enumerate(range(0, left, _DRAWN_AT_ONCE)):
        particles = plain_particles(space, min(_DRAWN_AT_ONCE, left - first), seed, (1, part))
        scores = yield particles
        parts.append((particles, scores))
        failed, drawn = failed + int(np.count_nonzero(scores < 0.0)), drawn + len(scores)
        interval = clopper_pearson(failed, drawn, (1.0 - aim.confidence) / 2.0)
        if aim.reached(failed / drawn, interval):
            break
    probability = FailureProbability(
        estimate=failed / drawn,
        interval=interval,
        highest=interval.upper,
        method="draws",
        why=pilot.why_draws(left),
        episodes=pilot.episodes + drawn,
        ended="narrow" if aim.reached(failed / drawn, interval) else "spent",
    )
    return Estimated(probability, _seen_of_draws(*joined(parts)))


def _seen_of_draws(particles: Particles, scores: Scores) -> Seen:
    """Returns what plain draws have seen, cut into as many populations as splitting has."""
    population = np.arange(len(scores)) * POPULATIONS // len(scores)
    failing = np.flatnonzero(scores < 0.0)
    passing = np.flatnonzero(scores >= 0.0)
    passing = passing[:: 1 + len(passing) // PASSED_KEPT]
    return Seen(
        failed=particles.take(failing),
        weights=1.0 / np.bincount(population, minlength=POPULATIONS)[population[failing]],
        failed_of=population[failing],
        passed=particles.take(passing),
        passed_of=population[passing],
        populations=POPULATIONS,
    )
