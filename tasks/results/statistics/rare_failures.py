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
from tasks.results.statistics.intervals import Interval, clopper_pearson
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
from tasks.results.statistics.thinned_draws import Lot, Thinned, counted, draws_for, thinned

# Chains of each of the populations that teach where failures are: a fifth of what the budget gives, and of these:
_TAUGHT, _FEWEST_TEACHING, _MOST_TEACHING = 5, 6, 20
# The first lot of thinned draws: a third of what is left then, or so many where they end when they are sharp enough.
_FIRST_LOT, _FIRST_OF_AIM = 3, 3_000


class FailureProbability(Spec):
    """How probable a failure is.

    Attributes:
        estimate: The probability.
        interval: Covers it with the confidence that was asked for.
        method: How it was found.
        why: Why so, as a sentence.
        episodes: How many were simulated in all, the pilot's among them.
        levels: Scores that populations went through, from far to near; empty for plain draws.
        ended: Whether the interval was narrow enough, or the budget was spent.
        against: The version that passes where an episode counts as a failure; None where each failure counts.
    """

    estimate: float
    interval: Interval
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
        return (
            f"fails{where} with probability {self.estimate:.3g} {within}, by "
            f"{self.episodes:,} episodes of {how}: {self.why}{ended}"
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
    if not draws_for(pilot.about):
        return (yield from _populations(known, pilot, left, aim))
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


def _populations(known: _Known, pilot: Pilot, left: int, aim: Aim, first: int = 0) -> Estimation:
    """Yields the particles of independent populations; returns what they say together.

    Where an interval is wider than asked for, more populations of the same size are added, as many as their scatter
    says, and as the budget gives (Stein 1945, Annals of Mathematical Statistics 16:243).

    Args:
        known: What was simulated before.
        pilot: Has the levels.
        left: How many episodes may be simulated.
        aim: How sharp the estimate has to be.
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
        plain = clopper_pearson(plain_failures, len(estimates) * chains * LENGTH, (1.0 - aim.confidence) / 2.0)
        estimate, interval = float(estimates.mean()), scatter_interval(estimates, aim.confidence, plain)
        count = (left - episodes) // cost
        if aim.relative_error is None or aim.reached(estimate, interval) or count < 1:
            break
        reach = reach_of(estimate, interval) / aim.relative_error
        count = min(count, max(ceil(len(estimates) * (min(reach, 1e3) ** 2 - 1.0)), POPULATIONS // 4))
    probability = FailureProbability(
        estimate=estimate,
        interval=interval,
        method="splitting",
        why=f"about 1 in {1.0 / pilot.about:,.0f} fails: too rare for plain draws",
        episodes=pilot.episodes + episodes,
        levels=(*pilot.levels[:-1], 0.0),
        ended="narrow" if aim.reached(estimate, interval) else "spent",
    )
    return Estimated(probability, seen_together(seen))


def _lots(known: _Known, pilot: Pilot, left: int, aim: Aim) -> Estimation:
    """Yields populations, which teach where failures are, and then thinned draws; returns what these say.

    The populations count for nothing else: few are simulated, and what is drawn after them scatters less. Where it does
    not, since seeds decide much and nobody can learn them, further populations take the rest.
    """
    space, seed = known.space, known.seed
    chains = min(max(pilot.chains(left) // _TAUGHT, _FEWEST_TEACHING), _MOST_TEACHING)
    taught = yield from known.keeping(simulated_populations(space, pilot, chains, range(POPULATIONS), seed))
    spent, lots, before = taught.episodes, list[Thinned](), None
    first = (left - spent) // _FIRST_LOT
    if aim.relative_error is not None:
        first = min(first, _FIRST_OF_AIM)
    size = first
    while True:
        lot = Lot(space, seed, len(lots) + 1, draws_for(pilot.about, size), size)
        before = yield from known.keeping(thinned(lot, known.all, pilot.near, before))
        lots.append(before)
        spent += len(before.scores)
        found = counted(lots, aim.confidence)
        if len(lots) == 1 and pilot.scatter(left - spent) < before.scatter(left - spent):
            so_far = pilot._replace(episodes=pilot.episodes + spent)
            return (yield from _populations(known, so_far, left - spent, aim, POPULATIONS))
        size = left - spent
        if aim.reached(found.estimate, found.interval) or size < first:
            break
        if aim.relative_error is not None:
            reach = min(reach_of(found.estimate, found.interval) / aim.relative_error, 1e3)
            wanted = max(ceil((spent - taught.episodes) * (reach**2 - 1.0)), first)
            size = wanted if size - wanted >= first else size  # what is left then has to be a lot
    probability = FailureProbability(
        estimate=found.estimate,
        interval=found.interval,
        method="thinned",
        why=f"about 1 in {1.0 / pilot.about:,.0f} fails, and it can be told which of many draws may",
        episodes=pilot.episodes + spent,
        levels=(*pilot.levels[:-1], 0.0),
        ended="narrow" if aim.reached(found.estimate, found.interval) else "spent",
    )
    return Estimated(probability, _seen_of_lots(lots, taught.seen))


def _seen_of_lots(lots: list[Thinned], taught: Seen) -> Seen:
    """Returns what lots have seen, cut into as many populations as taught, whose plain draws that passed they share.

    A population has a part of all draws, one after the other: how many of them fail varies as that of plain draws does.
    """
    whole = sum(len(each.scores) for each in lots)
    failed = side_by_side([each.particles.take(np.flatnonzero(each.failing)) for each in lots])
    weights = [each.weights[each.failing] * (len(each.scores) / whole) for each in lots]
    return taught._replace(
        failed=failed,
        weights=POPULATIONS * np.concatenate(weights),
        failed_of=np.concatenate([(POPULATIONS * each.places[each.failing]).astype(np.int64) for each in lots]),
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
