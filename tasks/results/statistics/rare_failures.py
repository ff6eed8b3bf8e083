"""The probability of a rare failure, by multilevel splitting, or by plain draws where those need fewer episodes.

What varies is drawn from its own distribution; an episode's score is how far it was from failing, and below 0 it
failed. Failures of one in ten thousand are reached in steps: of a population of plain draws the nearest tenth is kept,
Markov chains that stay within that level make a population of it again, of which the nearest tenth is kept, and so on:
subset simulation (Au and Beck 2001, Probabilistic Engineering Mechanics 16:263). The probability is the product of the
shares.

Levels that a population chooses for itself bias its estimate, and ties in scores more so (Brehier et al. 2016, Annals
of Applied Probability 26:3559). So a pilot chooses them, and how far its chains step, and counts for nothing else. Then
a number of populations, each independent of the others, goes through the same levels. With levels that are fixed and
chains that keep the law of what lies within one, each one's estimate has no bias, however slowly chains mix, and
whatever atoms and jumps scores have (Del Moral 2004, Feynman-Kac Formulae, theorem 7.4.2). What they scatter by gives
the interval.

The algorithm is a generator: it yields what is to be simulated, and is sent scores. Its numbers follow from its seed
and the scores alone, so that whoever keeps the scores takes it up again wherever it was left.
"""

from collections.abc import Generator
from math import ceil, exp, inf, sqrt
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int

from specs.base import Spec
from tasks.results.statistics.intervals import Interval, clopper_pearson

FAILED = -1.0
"""A score of an episode that failed."""
_FAILING = float(np.nextafter(0.0, FAILED))  # the last level: what lies within it failed

POPULATIONS = 12
"""So many are independent of each other."""
_PASSED_KEPT = 3_000  # of plain draws that passed, about so many are kept for whoever asks what failures have in common
_LENGTH = 10  # states of a chain: of a level a tenth is kept
_FEWEST_CHAINS = 10  # of a population: fewer die out
_PILOT_SHARE = 50  # of the budget, for each of the pilot's levels
_PILOT_MOST = 4  # of the budget, for the pilot in all
# How much more a chain's states scatter than as many draws: what Au and Beck 2001 find at most.
_CORRELATION = 4.0
# Of proposals along smooth coordinates (Papaioannou et al. 2015, Probabilistic Engineering Mechanics 41:89).
_ACCEPTED = 0.44
_NARROWEST = 1e-4


class Space(NamedTuple):
    """What varies.

    Attributes:
        smooth: How many coordinates are normal numbers, along which chains go in small steps.
        drawn: How many are uniform numbers that are drawn anew or kept, such as a world and a seed; at least 1.
    """

    smooth: int
    drawn: int


class Particles(NamedTuple):
    """Points of the space, each an episode.

    Attributes:
        smooth: Standard normal numbers.
        drawn: Uniform numbers, 0 to 1.
    """

    smooth: Float64[np.ndarray, "particles smooth"]
    drawn: Float64[np.ndarray, "particles drawn"]

    def take(self, which: Int[np.ndarray, "chosen"]) -> "Particles":
        """Returns some of them."""
        return Particles(self.smooth[which], self.drawn[which])

    def where(self, first: Bool[np.ndarray, "particles"], other: "Particles") -> "Particles":
        """Returns each of these where ``first`` says so, else the other's."""
        pick = first[:, None]
        return Particles(np.where(pick, self.smooth, other.smooth), np.where(pick, self.drawn, other.drawn))


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
    method: Literal["splitting", "draws"]
    why: str
    episodes: int
    levels: tuple[float, ...] = ()
    ended: Literal["narrow", "spent"] = "spent"
    against: str | None = None

    @property
    def sentence(self) -> str:
        """The probability, its interval, what it took, how it was found, and why it ended."""
        how = "multilevel splitting" if self.method == "splitting" else "plain draws"
        ended = "; the interval is as narrow as asked for" if self.ended == "narrow" else ""
        within = f"({self.interval.lower:.3g} to {self.interval.upper:.3g})"
        where = f" where version {self.against} passes" if self.against else ""
        return (
            f"fails{where} with probability {self.estimate:.3g} {within}, by "
            f"{self.episodes:,} episodes of {how}: {self.why}{ended}"
        )


class Seen(NamedTuple):
    """Plain draws that passed, and particles that stand for all failures, each of a population.

    Attributes:
        failed: Particles that failed.
        weights: Of each, the probability that it stands for in its population: they add up to its estimate.
        failed_of: The population of each, from 0.
        passed: Some of the plain draws that passed.
        passed_of: The population of each.
        populations: How many there are, those without a failure among them.
    """

    failed: Particles
    weights: Float64[np.ndarray, "failed"]
    failed_of: Int[np.ndarray, "failed"]
    passed: Particles
    passed_of: Int[np.ndarray, "passed"]
    populations: int


class Estimated(NamedTuple):
    """How probable a failure is, and the particles that say so."""

    probability: FailureProbability
    seen: Seen


class Aim(NamedTuple):
    """How sharp an estimate has to be.

    Attributes:
        confidence: Of the interval, between 0 and 1.
        relative_error: How far the interval may reach, as a share of the probability; None takes what the budget gives.
    """

    confidence: float
    relative_error: float | None = None

    def reached(self, estimate: float, interval: Interval) -> bool:
        """Returns whether an interval is narrow enough."""
        return self.relative_error is not None and 0.0 < _reach(estimate, interval) <= self.relative_error


def _reach(estimate: float, interval: Interval) -> float:
    """Returns how far an interval reaches, as a share of the estimate; infinite of none."""
    return (interval.upper - interval.lower) / (2.0 * estimate) if estimate > 0.0 else inf


Scores = Float64[np.ndarray, "particles"]
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
    if budget < 20 * _PILOT_SHARE:
        raise ValueError(f"budget: {budget}: at least {20 * _PILOT_SHARE}")
    pilot = yield from _pilot(space, budget, seed)
    left = budget - pilot.episodes
    if pilot.why_draws(left):
        return (yield from _plain_draws(space, left, pilot, aim, seed))
    return (yield from _populations(space, pilot, left, aim, seed))


class _Pilot(NamedTuple):
    """What a pilot found.

    Attributes:
        levels: Scores, from far to near; the last one is a failure, unless it came to none.
        shares: How much of a population lay within each.
        spreads: How far chains step within each but the last.
        episodes: How many it took.
        stuck: Why it came to no failure; empty if it did.
    """

    levels: tuple[float, ...]
    shares: tuple[float, ...]
    spreads: tuple[float, ...]
    episodes: int
    stuck: str = ""

    @property
    def episodes_of_chain(self) -> int:
        """How many episodes a population takes for each of its chains."""
        return _LENGTH + (len(self.levels) - 1) * (_LENGTH - 1)

    def chains(self, left: int) -> int:
        """Returns how many chains each population may have for some episodes."""
        return left // (POPULATIONS * self.episodes_of_chain)

    def variance(self, size: int) -> float:
        """Returns about the variance of what so many plain draws, and as many states at each level, say of 1."""
        scatter = [1.0 + _CORRELATION * (at > 0) for at in range(len(self.shares))]
        return sum((1.0 - share) / (share * size) * more for share, more in zip(self.shares, scatter, strict=True))

    def chains_for(self, aim: Aim, left: int) -> int:
        """Returns how many chains the first populations need for an interval that is as narrow as asked for."""
        from scipy.special import stdtrit  # noqa: PLC0415 - it takes long to load

        most = self.chains(left)
        if aim.relative_error is None:
            return most
        reach = float(stdtrit(POPULATIONS - 1, (1.0 + aim.confidence) / 2.0))
        wanted = ceil(self.variance(POPULATIONS * _LENGTH) * (reach / aim.relative_error) ** 2)
        return min(max(wanted, _FEWEST_CHAINS), most)

    def why_draws(self, left: int) -> str:
        """Returns why plain draws are better for some episodes, as a sentence; empty if they are not."""
        if self.stuck:
            return self.stuck
        about = float(np.prod(self.shares))
        drawn = (1.0 - about) / (about * left)
        each = POPULATIONS * _LENGTH * self.chains(left)
        if self.chains(left) < _FEWEST_CHAINS:
            return (
                f"{left:,} episodes are too few for {POPULATIONS} populations through {len(self.levels)} levels; about "
                f"1 in {1.0 / about:,.0f} fails"
            )
        split = self.variance(each)
        if drawn > split:
            return ""
        return (
            f"about 1 in {1.0 / about:,.0f} fails, so that plain draws come within {100 * sqrt(drawn):.0f} %, and "
            f"splitting within {100 * sqrt(split):.0f} %"
        )


def _pilot(space: Space, budget: int, seed: int) -> Generator[Particles, Scores, _Pilot]:
    """Yields the particles of one population, which chooses levels for those that count; returns what it found."""
    chains = max(budget // (_PILOT_SHARE * _LENGTH), 2)
    levels, shares, spreads = list[float](), list[float](), list[float]()
    particles = _plain(space, chains * _LENGTH, seed, (0, 0))
    scores = yield particles
    episodes, spread = len(scores), 0.5
    while True:
        level = _next_level(scores, chains)
        if level is None:
            stuck = f"the measure does not lead to a failure: all that come nearest have {float(scores.min()):g}"
            return _Pilot((*levels,), (*shares,), (*spreads,), episodes, stuck)
        levels.append(level)
        shares.append(float(np.mean(scores <= level)))
        if level < 0.0:
            return _Pilot((*levels,), (*shares,), (*spreads,), episodes)
        if episodes + chains * (_LENGTH - 1) > budget // _PILOT_MOST:
            stuck = f"no failure came in sight within {episodes:,} episodes; the nearest had {float(scores.min()):g}"
            return _Pilot((*levels,), (*shares,), (*spreads,), episodes, stuck)
        chosen = _survivors(scores <= level, chains, seed, (0, len(levels), 0))
        states = [(particles.take(chosen), scores[chosen])]
        for step in range(1, _LENGTH):
            draws = _uniforms(seed, (0, len(levels), step), chains, _columns(space))
            before, known = states[-1]
            proposed = _proposed(before, spread, draws)
            answered = yield proposed
            episodes += chains
            within = answered <= level
            states.append((proposed.where(within, before), np.where(within, answered, known)))
            if space.smooth and (stepped := draws[:, 0] < _SMOOTH_ALONE).any():
                spread *= exp((float(within[stepped].mean()) - _ACCEPTED) / sqrt(step))
                spread = min(max(spread, _NARROWEST), 1.0)
        spreads.append(spread)
        particles, scores = _joined(states)


def _next_level(scores: Scores, wanted: int) -> float | None:
    """Returns the score that about so many lie within; None if there is no step from here towards failure.

    Where a value is shared by more than half of the population, the next one below it is taken.
    """
    ordered = np.sort(scores)
    level = float(ordered[wanted - 1])
    if level < 0.0:
        return _FAILING
    if 2 * np.count_nonzero(scores <= level) <= len(scores):
        return level
    below = ordered[ordered < level]
    if not len(below):
        return None
    return float(below[-1]) if below[-1] >= 0.0 else _FAILING


def _populations(space: Space, pilot: _Pilot, left: int, aim: Aim, seed: int) -> Estimation:
    """Yields the particles of independent populations; returns what they say together.

    Where an interval is wider than asked for, more populations of the same size are added, as many as their scatter
    says, and as the budget gives (Stein 1945, Annals of Mathematical Statistics 16:243).
    """
    chains = pilot.chains_for(aim, left)
    cost = chains * pilot.episodes_of_chain
    count, estimates, plain_failures, episodes = POPULATIONS, np.zeros(0), 0, 0
    seen: list[Seen] = []
    while True:
        found = yield from _side_by_side_populations(
            space, pilot, chains, range(len(estimates), len(estimates) + count), seed
        )
        estimates = np.concatenate([estimates, found.estimates])
        seen.append(found.seen)
        plain_failures, episodes = plain_failures + found.plain_failures, episodes + found.episodes
        plain = clopper_pearson(plain_failures, len(estimates) * chains * _LENGTH, (1.0 - aim.confidence) / 2.0)
        estimate, interval = float(estimates.mean()), scatter_interval(estimates, aim.confidence, plain)
        count = (left - episodes) // cost
        if aim.relative_error is None or aim.reached(estimate, interval) or count < 1:
            break
        reach = _reach(estimate, interval) / aim.relative_error
        count = min(count, max(ceil(len(estimates) * (min(reach, 1e3) ** 2 - 1.0)), POPULATIONS // 4))
    probability = FailureProbability(
        estimate=estimate,
        interval=interval,
        method="splitting",
        why=f"about 1 in {1.0 / float(np.prod(pilot.shares)):,.0f} fails: too rare for plain draws",
        episodes=pilot.episodes + episodes,
        levels=(*pilot.levels[:-1], 0.0),
        ended="narrow" if aim.reached(estimate, interval) else "spent",
    )
    return Estimated(probability, _seen_together(seen))


class _Populations(NamedTuple):
    """What populations found.

    Attributes:
        estimates: Of each.
        plain_failures: How many of their plain draws failed.
        episodes: How many they took.
        seen: Their plain draws that passed, and their last particles, those that failed; numbered from 0.
    """

    estimates: Float64[np.ndarray, "populations"]
    plain_failures: int
    episodes: int
    seen: Seen


def _side_by_side_populations(
    space: Space, pilot: _Pilot, chains: int, which: range, seed: int
) -> Generator[Particles, Scores, _Populations]:
    """Yields the particles of some populations, all of them at once; returns what each found.

    Args:
        space: What varies.
        pilot: Has the levels.
        chains: Of each population.
        which: Their numbers, of all that there are.
        seed: The search's.
    """
    size = chains * _LENGTH
    numbers = np.arange(which.start, which.stop) + 1
    particles = _side_by_side([_plain(space, size, seed, (each, 0)) for each in numbers.tolist()])
    scores = yield particles
    plain_failures, episodes = int(np.count_nonzero(scores < 0.0)), len(scores)
    shares = np.ones((len(pilot.levels), len(numbers)))
    alive = np.arange(len(numbers))
    plain, passing = particles, scores >= 0.0
    for number, level in enumerate(pilot.levels):
        within = scores.reshape(len(alive), size) <= level
        shares[number] = 0.0
        shares[number, alive] = within.mean(1)
        kept = within.any(1)
        if number + 1 == len(pilot.levels) or not kept.any():
            break
        # Each population's chains begin at those of its own that lie within the level.
        starts = [
            size * row + _survivors(within[row], chains, seed, (int(numbers[alive[row]]), number + 1, 0))
            for row in np.flatnonzero(kept)
        ]
        alive, begin = alive[kept], np.concatenate(starts)
        states = [(particles.take(begin), scores[begin])]
        for step in range(1, _LENGTH):
            keys = [(each, number + 1, step) for each in numbers[alive].tolist()]
            draws = np.concatenate([_uniforms(seed, key, chains, _columns(space)) for key in keys])
            before, known = states[-1]
            proposed = _proposed(before, pilot.spreads[number], draws)
            answered = yield proposed
            episodes += len(answered)
            inside = answered <= level
            states.append((proposed.where(inside, before), np.where(inside, answered, known)))
        # A population's particles stand together again: chains of one are in a row, and so are their states.
        parts = [
            _joined([(state.take(rows), known[rows]) for state, known in states]) for rows in _rows_of(alive, chains)
        ]
        particles = _side_by_side([part for part, _ in parts])
        scores = np.concatenate([part for _, part in parts])
    estimates, failing = np.prod(shares, axis=0), scores < 0.0
    populations = np.repeat(alive, size)[failing]
    counts = np.bincount(populations, minlength=len(numbers))
    some = np.flatnonzero(passing)[:: 1 + int(passing.sum()) // _PASSED_KEPT]
    seen = Seen(
        failed=particles.take(np.flatnonzero(failing)),
        weights=(estimates / np.maximum(counts, 1))[populations],
        failed_of=populations,
        passed=plain.take(some),
        passed_of=some // size,
        populations=len(numbers),
    )
    return _Populations(estimates, plain_failures, episodes, seen)


def _seen_together(parts: list[Seen]) -> Seen:
    """Returns what parts of populations have seen, numbered on."""
    first = np.cumsum([0, *(each.populations for each in parts)]).tolist()
    return Seen(
        failed=_side_by_side([each.failed for each in parts]),
        weights=np.concatenate([each.weights for each in parts]),
        failed_of=np.concatenate([each.failed_of + at for each, at in zip(parts, first, strict=False)]),
        passed=_side_by_side([each.passed for each in parts]),
        passed_of=np.concatenate([each.passed_of + at for each, at in zip(parts, first, strict=False)]),
        populations=first[-1],
    )


def _rows_of(alive: Int[np.ndarray, "alive"], chains: int) -> list[Int[np.ndarray, "chains"]]:
    return [np.arange(chains * row, chains * (row + 1)) for row in range(len(alive))]


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


def _plain_draws(space: Space, left: int, pilot: _Pilot, aim: Aim, seed: int) -> Estimation:
    """Yields plain draws, as many as are left or needed, and returns the share that failed with its exact interval."""
    failed = drawn = 0
    interval = Interval(lower=0.0, upper=1.0)
    parts: list[tuple[Particles, Scores]] = []
    for part, first in enumerate(range(0, left, _DRAWN_AT_ONCE)):
        particles = _plain(space, min(_DRAWN_AT_ONCE, left - first), seed, (1, part))
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
    return Estimated(probability, _seen_of_draws(*_joined(parts)))


def _seen_of_draws(particles: Particles, scores: Scores) -> Seen:
    """Returns what plain draws have seen, cut into as many populations as splitting has."""
    population = np.arange(len(scores)) * POPULATIONS // len(scores)
    failing = np.flatnonzero(scores < 0.0)
    passing = np.flatnonzero(scores >= 0.0)
    passing = passing[:: 1 + len(passing) // _PASSED_KEPT]
    return Seen(
        failed=particles.take(failing),
        weights=1.0 / np.bincount(population, minlength=POPULATIONS)[population[failing]],
        failed_of=population[failing],
        passed=particles.take(passing),
        passed_of=population[passing],
        populations=POPULATIONS,
    )


# Of proposals, so many step along smooth coordinates alone, and so many draw one of the others alone; the rest do both.
_SMOOTH_ALONE, _DRAWN_ALONE = 0.5, 0.25


def _columns(space: Space) -> int:
    return 3 + space.smooth


def _proposed(particles: Particles, spread: float, uniforms: Float64[np.ndarray, "particles columns"]) -> Particles:
    """Returns where chains would go.

    Each proposal keeps the law of plain draws (Cotter et al. 2013, Statistical Science 28:424), so that a chain that
    goes there whenever it stays within a level keeps the law within it.

    Args:
        particles: Where chains are.
        spread: How far smooth coordinates go; at 1 they are drawn anew.
        uniforms: Which kind of proposal, which coordinate is drawn anew, its value, and a number for each smooth one.
    """
    from scipy.special import ndtri  # noqa: PLC0415 - it takes long to load

    kind, which, value, steps = uniforms[:, 0], uniforms[:, 1], uniforms[:, 2], uniforms[:, 3:]
    if not particles.smooth.shape[1]:
        kind = np.full_like(kind, _SMOOTH_ALONE)
    smooth = sqrt(1.0 - spread * spread) * particles.smooth + spread * ndtri(steps)
    stays = (kind >= _SMOOTH_ALONE) & (kind < _SMOOTH_ALONE + _DRAWN_ALONE)
    drawn = particles.drawn.copy()
    anew = np.flatnonzero(kind >= _SMOOTH_ALONE)
    drawn[anew, (which[anew] * drawn.shape[1]).astype(np.intp)] = value[anew]
    return Particles(np.where(stays[:, None], particles.smooth, smooth), drawn)


def _survivors(
    within: Bool[np.ndarray, "particles"], chains: int, seed: int, key: tuple[int, ...]
) -> Int[np.ndarray, "chains"]:
    """Returns where chains begin: among those within a level, each as often as any other in the mean.

    They are taken in turn in a drawn order, so that none is taken twice while another is left out.

    Args:
        within: Which particles lie within the level.
        chains: How many begin.
        seed: The search's.
        key: Of the draw.
    """
    inside = np.flatnonzero(within)
    drawn = _uniforms(seed, key, len(inside), 1)[:, 0]
    return np.resize(inside[np.argsort(drawn, kind="stable")], chains)


def _plain(space: Space, count: int, seed: int, key: tuple[int, ...]) -> Particles:
    """Returns plain draws."""
    from scipy.special import ndtri  # noqa: PLC0415 - it takes long to load

    drawn = _uniforms(seed, (*key, 0), count, space.smooth + space.drawn)
    return Particles(ndtri(drawn[:, : space.smooth]), drawn[:, space.smooth :])


def _uniforms(seed: int, key: tuple[int, ...], rows: int, columns: int) -> Float64[np.ndarray, "rows columns"]:
    """Returns numbers between 0 and 1, neither of which they are; each key has its own."""
    generator = np.random.Generator(np.random.Philox(np.random.SeedSequence(seed, spawn_key=key)))
    return generator.random((rows, columns)) * (1.0 - 2.0**-52) + 2.0**-53


def _side_by_side(parts: list[Particles]) -> Particles:
    return Particles(np.concatenate([each.smooth for each in parts]), np.concatenate([each.drawn for each in parts]))


def _joined(states: list[tuple[Particles, Scores]]) -> tuple[Particles, Scores]:
    return _side_by_side([state for state, _ in states]), np.concatenate([scores for _, scores in states])
