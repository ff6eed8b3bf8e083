"""Multilevel splitting: a pilot that chooses levels, and populations that go through them.

Failures of one in ten thousand are reached in steps: of a population of plain draws the nearest tenth is kept, Markov
chains that stay within that level make a population of it again, of which the nearest tenth is kept, and so on: subset
simulation (Au and Beck 2001, Probabilistic Engineering Mechanics 16:263). The probability is the product of the shares.

Levels that a population chooses for itself bias its estimate, and ties in scores more so (Brehier et al. 2016, Annals
of Applied Probability 26:3559). So a pilot chooses them, and how far its chains step, and counts for nothing else. Then
a number of populations, each independent of the others, goes through the same levels. With levels that are fixed and
chains that keep the law of what lies within one, each one's estimate has no bias, however slowly chains mix, and
whatever atoms and jumps scores have (Del Moral 2004, Feynman-Kac Formulae, theorem 7.4.2).
"""

from collections.abc import Generator
from math import ceil, exp, inf, sqrt
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int

from tasks.results.statistics.intervals import Interval
from tasks.results.statistics.particles import Particles, Scores, Space, plain_particles, side_by_side, uniforms

FAILED = -1.0
"""A score of an episode that failed."""
_FAILING = float(np.nextafter(0.0, FAILED))  # the last level: what lies within it failed

POPULATIONS = 12
"""So many are independent of each other."""
PASSED_KEPT = 3_000  # of plain draws that passed, about so many are kept for whoever asks what failures have in common
LENGTH = 10  # states of a chain: of a level a tenth is kept
FEWEST_CHAINS = 10  # of a population: fewer die out
PILOT_SHARE = 50  # of the budget, for each of the pilot's levels
_PILOT_MOST = 4  # of the budget, for the pilot in all
# How much more a chain's states scatter than as many draws: what Au and Beck 2001 find at most.
_CORRELATION = 4.0
# Of proposals along smooth coordinates (Papaioannou et al. 2015, Probabilistic Engineering Mechanics 41:89).
_ACCEPTED = 0.44
_NARROWEST = 1e-4


class Seen(NamedTuple):
    """Particles that passed, and particles that stand for all failures, each of a population.

    Attributes:
        failed: Particles that failed.
        weights: Of each, the probability that it stands for in its population: they add up to its estimate.
        failed_of: The population of each, from 0.
        passed: Some that passed.
        passed_of: The population of each.
        populations: How many there are, those without a failure among them.
        passed_weights: How many draws each that passed stands for, up to a factor; None for plain draws, all alike.
            Those who have weights were chosen by what varies alone, whether they failed or not, as failures were.
    """

    failed: Particles
    weights: Float64[np.ndarray, "failed"]
    failed_of: Int[np.ndarray, "failed"]
    passed: Particles
    passed_of: Int[np.ndarray, "passed"]
    populations: int
    passed_weights: Float64[np.ndarray, "passed"] | None = None


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
        return self.relative_error is not None and 0.0 < reach_of(estimate, interval) <= self.relative_error


def reach_of(estimate: float, interval: Interval) -> float:
    """Returns how far an interval reaches, as a share of the estimate; infinite of none."""
    return (interval.upper - interval.lower) / (2.0 * estimate) if estimate > 0.0 else inf


class Pilot(NamedTuple):
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
    def about(self) -> float:
        """About how probable a failure is."""
        return float(np.prod(self.shares))

    @property
    def near(self) -> float:
        """The level before failures; 0 where there is none."""
        return self.levels[-2] if len(self.levels) > 1 else 0.0

    @property
    def episodes_of_chain(self) -> int:
        """How many episodes a population takes for each of its chains."""
        return LENGTH + (len(self.levels) - 1) * (LENGTH - 1)

    def chains(self, left: int) -> int:
        """Returns how many chains each population may have for some episodes."""
        return left // (POPULATIONS * self.episodes_of_chain)

    def variance(self, size: int) -> float:
        """Returns about the variance of what so many plain draws, and as many states at each level, say of 1."""
        scatter = [1.0 + _CORRELATION * (at > 0) for at in range(len(self.shares))]
        return sum((1.0 - share) / (share * size) * more for share, more in zip(self.shares, scatter, strict=True))

    def scatter(self, left: int) -> float:
        """Returns about the variance of what populations of so many episodes say of 1; infinite if they are too few."""
        chains = self.chains(left)
        return self.variance(POPULATIONS * LENGTH * chains) if chains >= FEWEST_CHAINS else inf

    def chains_for(self, aim: Aim, left: int) -> int:
        """Returns how many chains the first populations need for an interval that is as narrow as asked for."""
        from scipy.special import stdtrit  # noqa: PLC0415 - it takes long to load

        most = self.chains(left)
        if aim.relative_error is None:
            return most
        reach = float(stdtrit(POPULATIONS - 1, (1.0 + aim.confidence) / 2.0))
        wanted = ceil(self.variance(POPULATIONS * LENGTH) * (reach / aim.relative_error) ** 2)
        return min(max(wanted, FEWEST_CHAINS), most)

    def why_draws(self, left: int) -> str:
        """Returns why plain draws are better for some episodes, as a sentence; empty if they are not."""
        if self.stuck:
            return self.stuck
        about = self.about
        drawn = (1.0 - about) / (about * left)
        each = POPULATIONS * LENGTH * self.chains(left)
        if self.chains(left) < FEWEST_CHAINS:
            return (
                f"{left:,} episodes are too few for {POPULATIONS} populations through {len(self.levels)} levels; by a "
                f"pilot about 1 in {1.0 / about:,.0f} fails"
            )
        split = self.variance(each)
        if drawn > split:
            return ""
        return (
            f"by a pilot about 1 in {1.0 / about:,.0f} fails, so that plain draws come within {100 * sqrt(drawn):.0f} "
            f"%, and splitting within {100 * sqrt(split):.0f} %"
        )


def simulated_pilot(space: Space, budget: int, seed: int) -> Generator[Particles, Scores, Pilot]:
    """Yields the particles of one population, which chooses levels for those that count; returns what it found."""
    chains = max(budget // (PILOT_SHARE * LENGTH), 2)
    levels, shares, spreads = list[float](), list[float](), list[float]()
    particles = plain_particles(space, chains * LENGTH, seed, (0, 0))
    scores = yield particles
    episodes, spread = len(scores), 0.5
    while True:
        level = next_level(scores, chains)
        if level is None:
            stuck = f"the measure does not lead to a failure: all that come nearest have {float(scores.min()):g}"
            return Pilot((*levels,), (*shares,), (*spreads,), episodes, stuck)
        levels.append(level)
        shares.append(float(np.mean(scores <= level)))
        if level < 0.0:
            return Pilot((*levels,), (*shares,), (*spreads,), episodes)
        if episodes + chains * (LENGTH - 1) > budget // _PILOT_MOST:
            stuck = f"no failure came in sight within {episodes:,} episodes; the nearest had {float(scores.min()):g}"
            return Pilot((*levels,), (*shares,), (*spreads,), episodes, stuck)
        chosen = _survivors(scores <= level, chains, seed, (0, len(levels), 0))
        states = [(particles.take(chosen), scores[chosen])]
        for step in range(1, LENGTH):
            draws = uniforms(seed, (0, len(levels), step), chains, _columns(space))
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
        particles, scores = joined(states)


def next_level(scores: Scores, wanted: int) -> float | None:
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


class Populations(NamedTuple):
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


def simulated_populations(
    space: Space, pilot: Pilot, chains: int, which: range, seed: int
) -> Generator[Particles, Scores, Populations]:
    """Yields the particles of some populations, all of them at once; returns what each found.

    Args:
        space: What varies.
        pilot: Has the levels.
        chains: Of each population.
        which: Their numbers, of all that there are.
        seed: The search's.
    """
    size = chains * LENGTH
    numbers = np.arange(which.start, which.stop) + 1
    particles = side_by_side([plain_particles(space, size, seed, (each, 0)) for each in numbers.tolist()])
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
        for step in range(1, LENGTH):
            keys = [(each, number + 1, step) for each in numbers[alive].tolist()]
            draws = np.concatenate([uniforms(seed, key, chains, _columns(space)) for key in keys])
            before, known = states[-1]
            proposed = _proposed(before, pilot.spreads[number], draws)
            answered = yield proposed
            episodes += len(answered)
            inside = answered <= level
            states.append((proposed.where(inside, before), np.where(inside, answered, known)))
        # A population's particles stand together again: chains of one are in a row, and so are their states.
        parts = [
            joined([(state.take(rows), known[rows]) for state, known in states]) for rows in _rows_of(alive, chains)
        ]
        particles = side_by_side([part for part, _ in parts])
        scores = np.concatenate([part for _, part in parts])
    estimates, failing = np.prod(shares, axis=0), scores < 0.0
    populations = np.repeat(alive, size)[failing]
    counts = np.bincount(populations, minlength=len(numbers))
    some = np.flatnonzero(passing)[:: 1 + int(passing.sum()) // PASSED_KEPT]
    seen = Seen(
        failed=particles.take(np.flatnonzero(failing)),
        weights=(estimates / np.maximum(counts, 1))[populations],
        failed_of=populations,
        passed=plain.take(some),
        passed_of=some // size,
        populations=len(numbers),
    )
    return Populations(estimates, plain_failures, episodes, seen)


def seen_together(parts: list[Seen]) -> Seen:
    """Returns what parts of populations have seen, numbered on."""
    first = np.cumsum([0, *(each.populations for each in parts)]).tolist()
    return Seen(
        failed=side_by_side([each.failed for each in parts]),
        weights=np.concatenate([each.weights for each in parts]),
        failed_of=np.concatenate([each.failed_of + at for each, at in zip(parts, first, strict=False)]),
        passed=side_by_side([each.passed for each in parts]),
        passed_of=np.concatenate([each.passed_of + at for each, at in zip(parts, first, strict=False)]),
        populations=first[-1],
    )


def _rows_of(alive: Int[np.ndarray, "alive"], chains: int) -> list[Int[np.ndarray, "chains"]]:
    return [np.arange(chains * row, chains * (row + 1)) for row in range(len(alive))]


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
    drawn = uniforms(seed, key, len(inside), 1)[:, 0]
    return np.resize(inside[np.argsort(drawn, kind="stable")], chains)


def joined(states: list[tuple[Particles, Scores]]) -> tuple[Particles, Scores]:
    """Returns the particles of all states and their scores, one state after the other."""
    return side_by_side([state for state, _ in states]), np.concatenate([scores for _, scores in states])
