"""A probability by plain draws of which few are simulated: those that may fail.

Of very many plain draws each is simulated with a probability of its own, and each that fails counts for the inverse of
that (Horvitz and Thompson 1952, Journal of the American Statistical Association 47:663): the sum has no bias, whatever
these probabilities are, as long as they were fixed before and none is 0. It scatters least where they go with the root
of how probable a failure is there. A surrogate says that, which has learned from all that was simulated before; so it
may be wrong, and the estimate is only less sharp then.

Draws are taken in their order by systematic sampling (Madow 1949, Annals of Mathematical Statistics 20:333), so that as
many are simulated as were asked for.
"""

from collections.abc import Generator, Sequence
from math import inf
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int

from tasks.results.statistics.intervals import Interval, weighted_count_interval
from tasks.results.statistics.particles import Particles, Scores, Space, plain_particles, side_by_side, uniforms
from tasks.results.statistics.surrogate import Features, logistic, logistic_weights, points_of

_MOST_DRAWS = 1_000_000  # of a lot
_FAILURES_DRAWN = 400  # so many are among a lot's draws, or fewer if those would be too many; but not fewer than:
_FEWEST_DRAWN = 20
_FEWER_THAN_SIMULATED = 12  # times
_FEWEST_AT_MOST = 2_500
_KEY = 2**31  # of the seeds' keys: nothing else begins with it
_PART = 16_384  # draws at once
_SIMULATED_AT_ONCE = 4_096
_MOST_LEARNT = 50_000  # of what is known, each with some hundred features
_PLAIN_SHARE = 0.25  # of those that are simulated: whatever the surrogate says
_WIDTH, _RIDGE = 2.0, 0.01


class Thinned(NamedTuple):
    """Draws that were simulated.

    Attributes:
        particles: They.
        scores: Theirs.
        weights: For how much of all draws each stands.
        places: Where among all draws each is, from 0 to 1.
        designs: How much each design would have wanted each of them, as a share of its mean over all draws.
    """

    particles: Particles
    scores: Scores
    weights: Float64[np.ndarray, "particles"]
    places: Float64[np.ndarray, "particles"]
    designs: Float64[np.ndarray, "designs particles"]

    @property
    def failing(self) -> Bool[np.ndarray, "particles"]:
        """Which of them failed."""
        return self.scores < 0.0

    def scatter(self, size: int) -> float:
        """Returns about the variance of what a lot says of 1 of which so many are simulated."""
        of_failing = self.weights[self.failing]
        if not len(of_failing):
            return inf
        return float((of_failing**2).sum() / of_failing.sum() ** 2) * len(self.scores) / max(size, 1)

    @property
    def best_design(self) -> int:
        """The design with which the estimate would have scattered least; the last one where nothing failed."""
        if not self.failing.any():
            return len(self.designs) - 1
        shares = _PLAIN_SHARE + (1.0 - _PLAIN_SHARE) * self.designs[:, self.failing]
        return int(np.argmin((self.weights[self.failing] / shares).sum(1)))


class Lot(NamedTuple):
    """Plain draws, of which some are to be simulated.

    Attributes:
        space: What varies.
        seed: The search's.
        number: This one's among the search's, from 1.
        draws: How many there are.
        size: How many are simulated.
    """

    space: Space
    seed: int
    number: int
    draws: int
    size: int

    def part(self, first: int) -> Particles:
        """Returns the draws from some place on, as many as are drawn at once."""
        count = min(_PART, self.draws - first)
        return plain_particles(self.space, count, self.seed, (_KEY, self.number, 1 + first // _PART))

    def take(self, which: Int[np.ndarray, "chosen"]) -> Particles:
        """Returns some of the draws, whose places are in order."""
        parts: list[Particles] = []
        for first in range(0, self.draws, _PART):
            low, high = np.searchsorted(which, [first, first + _PART])
            if high > low:
                parts.append(self.part(first).take(which[low:high] - first))
        return side_by_side(parts)


def is_thinnable(about: float) -> bool:
    """Returns whether enough of a lot's draws fail where about such a share does."""
    return about * _MOST_DRAWS >= _FEWEST_DRAWN


def most_simulated(about: float) -> int:
    """Returns how many of a lot may be simulated: of more, what scatters would be which draws the lot has.

    Args:
        about: About how probable a failure is.
    """
    return max(int(_FEWER_THAN_SIMULATED * about * _MOST_DRAWS), _FEWEST_AT_MOST)


def draws_for(about: float, size: int) -> int:
    """Returns how many draws a lot has.

    Args:
        about: About how probable a failure is.
        size: How many are simulated.
    """
    wanted = max(_FAILURES_DRAWN, size // _FEWER_THAN_SIMULATED)
    return max(int(min(wanted / about, _MOST_DRAWS)), 2 * size)


def thinned(
    lot: Lot, known: tuple[Particles, Scores], near: float, before: Thinned | None
) -> Generator[Particles, Scores, Thinned]:
    """Yields draws to be simulated, is sent their scores, and returns both.

    Args:
        lot: The draws.
        known: What was simulated before, failures and passes among it.
        near: The score that is next to a failure, among the levels of splitting.
        before: The lot before, if there is one: it says which design is best.
    """
    designs = _designs(lot, *known, near)
    chances = _chances(designs[before.best_design if before else -1], lot.size)
    # One number decides: the next draw is taken whenever the sum of all chances so far has grown by 1.
    taken = np.floor(np.cumsum(chances) + uniforms(lot.seed, (_KEY, lot.number, 0), 1, 1)[0, 0])
    chosen = np.flatnonzero(np.diff(taken, prepend=0.0))
    particles = lot.take(chosen)
    scores = np.zeros(len(chosen))
    for first in range(0, len(chosen), _SIMULATED_AT_ONCE):  # a search that is killed loses no more than these
        some = np.arange(first, min(first + _SIMULATED_AT_ONCE, len(chosen)))
        scores[some] = yield particles.take(some)
    weights = 1.0 / (lot.draws * chances[chosen])
    return Thinned(particles, scores, weights, chosen / lot.draws, designs[:, chosen])


def _designs(lot: Lot, particles: Particles, scores: Scores, near: float) -> Float64[np.ndarray, "designs draws"]:
    """Returns how much each draw is wanted, as a share of the mean: by what fails, by what is near, and by both.

    The last one is for where it is not known which is better: failures are fewer than what is near, and where hardly
    one in twenty of those fails, they say little yet.
    """
    some = np.arange(0, len(scores), 1 + len(scores) // _MOST_LEARNT)
    particles, scores = particles.take(some), scores[some]
    points, failed = points_of(particles, lot.space.values), scores < 0.0
    kinds = np.stack([failed, scores <= max(near, 0.0)], axis=1)
    share = kinds[:, 0].sum() / kinds[:, 1].sum()
    features = Features(points.take(failed), points.take(~failed), _WIDTH)
    of_points, penalty = features.of(points), features.penalty(_RIDGE)
    counts, weights = np.ones(len(scores)), np.zeros(len(penalty))
    evidence = np.stack(
        [logistic_weights(of_points, kind, counts, penalty, weights) for kind in kinds.T.astype(np.float64)], axis=1
    )
    wanted = np.empty((3, lot.draws))
    for first in range(0, lot.draws, _PART):
        likely = logistic(features.evidence(points_of(lot.part(first), lot.space.values), evidence))
        failing, close = likely.T
        wanted[:, first : first + _PART] = np.sqrt([failing, close, 0.5 * (failing + share * close)])
    return wanted / wanted.mean(1, keepdims=True)


def _chances(wanted: Float64[np.ndarray, "draws"], size: int) -> Float64[np.ndarray, "draws"]:
    """Returns with which probability each draw is simulated: at most 1, and a little less than ``size`` together."""
    plain = _PLAIN_SHARE * size / len(wanted)
    low, high = 0.0, 1.0
    while np.minimum(plain + high * wanted, 1.0).sum() < size - 0.5 and high < 1e9:
        low, high = high, 2.0 * high
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if np.minimum(plain + middle * wanted, 1.0).sum() < size - 0.5 else (low, middle)
    # Machines differ in the last bits of what a surrogate says, and their draws and weights must not: 20 bits are kept.
    parts, powers = np.frexp(np.minimum(plain + low * wanted, 1.0))
    return np.ldexp(np.rint(parts * 2.0**20), powers - 20)


class Counted(NamedTuple):
    """What lots say together.

    Attributes:
        estimate: The probability.
        interval: Covers it if what was simulated before tells of all ways to fail.
        highest: An upper bound also if it does not.
    """

    estimate: float
    interval: Interval
    highest: float


def counted(lots: Sequence[Thinned], confidence: float) -> Counted:
    """Returns the probability of a failure by lots, each of which counts by how many of it were simulated.

    Which draws a lot has varies, and which of them are simulated: failures are a sum of Poisson counts with weights.
    Above, the interval allows for one more with the largest weight of those that failed. Failures of which nothing
    tells have the weight of a draw that only the plain share chooses, and may all have been missed: the upper bound
    that allows for one more of these is near that of so many plain draws as that share is.

    Args:
        lots: They.
        confidence: Of the interval.
    """
    whole, tail = sum(len(each.scores) for each in lots), (1.0 - confidence) / 2.0
    weights = np.concatenate([each.weights[each.failing] * (len(each.scores) / whole) for each in lots])
    estimate, variance = float(weights.sum()), float((weights**2).sum())
    highest = weighted_count_interval(estimate, variance, 1.0 / (_PLAIN_SHARE * whole), tail).upper
    if not len(weights):
        return Counted(0.0, Interval(lower=0.0, upper=highest), highest)
    interval = weighted_count_interval(estimate, variance, float(weights.max()), tail)
    return Counted(estimate, interval, max(highest, interval.upper))
