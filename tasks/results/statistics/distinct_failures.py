"""Failures that are unlike each other, chosen among all that a search has found, and where others may be.

Two failures are as far apart as five parts say, each from 0 to 1: whether they fail for another reason, in another
world, with another seed, how far the places are where they ended, and how far the variables, each by the share of its
distribution that lies between. The first is the one that was met first, and each further one is the farthest from those
that are chosen (Gonzalez 1985, Theoretical Computer Science 38:293). The others are counted with the nearest that is
chosen: clusters, whose radius is at most twice the least that so many can have.
"""

from collections.abc import Sequence
from math import sqrt
from typing import NamedTuple

import numpy as np
from jaxtyping import Float64, Int

from tasks.results.statistics.particles import Particles

OTHER_PLACE_M = 1.0
"""From here on two places of a world are others: a robot's own length or two, as for ``simyard shrink``."""
OF_PLACE = 4
"""So many columns of a cell say where: reason, world, and metre (x, y)."""
GENERATION = 64
"""So many episodes are driven before those that failed among them are changed in their turn."""
_KEY = 2**31 + 1  # nothing of an estimate has this number
_NEAR, _ONE, _SOME, _OTHER = range(4)
_KINDS = np.array([_NEAR, _ONE, _SOME, _NEAR, _ONE, _SOME, _NEAR, _OTHER])  # what is changed, of each eight episodes
_STEPS = 0.5 ** np.arange(1, 6)
_LEAST_WEIGHT = 0.1


class FailureTraits(NamedTuple):
    """By what failures are told apart; each row is one.

    Attributes:
        reason: Why it failed, as a number that is the same for the same reason.
        world: Likewise.
        seed: Likewise.
        place_m: Where the robot was at the end (x, y).
        numbers: The share of its distribution that lies below each variable's value, 0 to 1.
        choices: Which of its values each variable has that has no numbers.
    """

    reason: Int[np.ndarray, "failures"]
    world: Int[np.ndarray, "failures"]
    seed: Int[np.ndarray, "failures"]
    place_m: Float64[np.ndarray, "failures 2"]
    numbers: Float64[np.ndarray, "failures numbers"]
    choices: Int[np.ndarray, "failures choices"]

    def cells(self) -> Int[np.ndarray, "failures parts"]:
        """Returns in which cell each is: its reason, world, metre of place (x, y), choices, and tenths of numbers."""
        # A robot whose state blew up may be farther away than a whole number says.
        places = np.clip(np.floor(self.place_m / OTHER_PLACE_M), -(2.0**53), 2.0**53).astype(np.int64)
        tenths = np.minimum(self.numbers * 10.0, 9.0).astype(np.int64)
        return np.column_stack([self.reason, self.world, places, self.choices, tenths])

    def apart(self, one: int) -> Float64[np.ndarray, "failures"]:
        """Returns how far each is from one of them, 0 to 5."""
        other_world = self.world != self.world[one]
        place = np.linalg.norm(self.place_m - self.place_m[one], axis=1) / OTHER_PLACE_M
        variables = [
            *np.abs(self.numbers - self.numbers[one]).T,
            *(self.choices != self.choices[one]).T.astype(np.float64),
        ]
        return (
            (self.reason != self.reason[one]).astype(np.float64)
            + other_world
            + (other_world | (self.seed != self.seed[one]))
            + np.where(other_world, 1.0, np.minimum(place, 1.0))
            + (np.mean(variables, axis=0) if variables else 0.0)
        )


def farthest_first(traits: FailureTraits, most: int) -> list[int]:
    """Returns the rows of failures in the order in which each is the farthest from those before it.

    Args:
        traits: Of all failures, in the order in which they were met.
        most: At most so many; fewer where there are no others that differ.
    """
    nearest = np.full(len(traits.reason), np.inf)
    chosen: list[int] = []
    while len(chosen) < most and nearest.any():  # of those that are chosen, it is 0
        far = int(nearest.argmax())
        chosen.append(far)
        nearest = np.minimum(nearest, traits.apart(far))
    return chosen


def counts_of_nearest(traits: FailureTraits, chosen: list[int]) -> list[int]:
    """Returns how many failures are nearest to each that is chosen, itself among them; ties go to the first."""
    if not chosen:
        return []
    nearest = np.argmin([traits.apart(each) for each in chosen], axis=0)
    return np.bincount(nearest, minlength=len(chosen)).tolist()


def near_failures(
    particles: Particles, traits: FailureTraits, options: Sequence[int], *, count: int, seed: int, generation: int
) -> Particles:
    """Returns episodes near failures that were met.

    Of each eight three have all numbers changed a little, two one number drawn anew, two some of them, and one another
    choice, world or seed. A number is drawn anew the less often the more it varies among failures at the same place: it
    does not decide whether the robot fails there, and would lead nowhere else.

    Args:
        particles: The failures, at least one, in the order in which they were met.
        traits: By what they are told apart.
        options: How many values each of the coordinates has that are no smooth ones: choices, worlds, seeds.
        count: How many episodes.
        seed: The search's.
        generation: Each draws numbers of its own.
    """
    random = np.random.Generator(np.random.Philox(np.random.SeedSequence(seed, spawn_key=(_KEY, generation))))
    cells = traits.cells()
    kept = np.sort(np.unique(cells, axis=0, return_index=True)[1])
    places = np.unique(cells[kept, :OF_PLACE], axis=0, return_inverse=True)[1].ravel()
    sizes = np.bincount(places)
    chosen = random.choice(len(kept), count, p=1.0 / (len(sizes) * sizes[places]))
    changed, weights = particles.take(kept[chosen]), _weights(traits.numbers[kept], places)[places[chosen]]
    smooth, drawn = changed.smooth, changed.drawn
    numbers, others = smooth.shape[1], np.flatnonzero(np.array(options) > 1)
    kind = _KINDS[np.arange(count) % len(_KINDS)] if numbers else np.full(count, _OTHER)
    fresh, steps = random.standard_normal(smooth.shape), random.choice(_STEPS, (count, 1))
    smooth[kind == _NEAR] = (np.sqrt(1.0 - steps**2) * smooth + steps * fresh)[kind == _NEAR]
    some = (kind == _SOME)[:, None] & (random.random(smooth.shape) < 0.5 * weights)
    smooth[some] = fresh[some]
    one, shares = np.flatnonzero(kind == _ONE), weights.cumsum(1)
    which = (random.random((count, 1)) * weights.sum(1, keepdims=True) > shares).sum(1)
    smooth[one, which[one]] = fresh[one, which[one]]
    # Another value than before: with the same one an episode would be simulated that is known to fail.
    other, which = np.flatnonzero(kind == _OTHER), random.choice(others, count)
    which, most = which[other], np.array(options)[which[other]]
    before, further = (drawn[other, which] * most).astype(np.int64), random.integers(1, most)
    drawn[other, which] = ((before + further) % most + 0.5) / most
    return changed


def _weights(
    numbers: Float64[np.ndarray, "failures numbers"], places: Int[np.ndarray, "failures"]
) -> Float64[np.ndarray, "places numbers"]:
    """Returns of each place how often each number is to be drawn anew: 1 where it is the same in all failures there.

    One that varies as much as plain draws do has the least weight.
    """
    spreads = [numbers[places == each].std(0) for each in range(places.max() + 1)]
    return np.clip(1.0 - sqrt(12.0) * np.array(spreads), _LEAST_WEIGHT, 1.0)
