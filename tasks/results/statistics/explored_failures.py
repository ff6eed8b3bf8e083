"""Where failures may be that nobody has met: near those that were, in cells of reason, place and variables.

MAP-Elites (Mouret and Clune 2015, arXiv 1504.04909) with failing as all that counts: one failure of each cell is kept,
and the next episodes are those that are kept, changed. A place has more cells the more often it was tried; so a place
is chosen first, each as often as any other, and then one of its cells. Episodes are drawn near failures, so that no
probability follows from them.
"""

from collections.abc import Sequence
from math import sqrt

import numpy as np

from tasks.results.statistics.distinct_failures import OF_PLACE, FailureTraits
from tasks.results.statistics.particles import Particles

GENERATION = 128
"""So many episodes are driven before those that failed among them are changed in their turn."""
_KEY = 2**31 + 1  # nothing of an estimate has this number
_NEAR, _ONE, _OTHER, _ALL = range(4)  # what is changed, each in a quarter of the episodes
_STEP = 0.5


def near_failures(
    particles: Particles, traits: FailureTraits, options: Sequence[int], *, count: int, seed: int, generation: int
) -> Particles:
    """Returns episodes near failures that were met.

    A quarter of them have all numbers changed a little, a quarter one number drawn anew, a quarter another choice,
    world or seed, and a quarter all numbers.

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
    changed = particles.take(random.choice(kept, count, p=1.0 / (len(sizes) * sizes[places])))
    smooth, drawn = changed.smooth, changed.drawn
    numbers, others = smooth.shape[1], np.flatnonzero(np.array(options) > 1)
    kind = np.arange(count) % 4 if numbers else np.full(count, _OTHER)
    fresh = random.standard_normal(smooth.shape)
    smooth[kind == _NEAR] = (sqrt(1.0 - _STEP**2) * smooth + _STEP * fresh)[kind == _NEAR]
    smooth[kind == _ALL] = fresh[kind == _ALL]
    one, which = np.flatnonzero(kind == _ONE), random.integers(0, max(numbers, 1), count)
    smooth[one, which[one]] = fresh[one, which[one]]
    # Another value than before: with the same one an episode would be simulated that is known to fail.
    other, which = np.flatnonzero(kind == _OTHER), random.choice(others, count)
    which, most = which[other], np.array(options)[which[other]]
    before, further = (drawn[other, which] * most).astype(np.int64), random.integers(1, most)
    drawn[other, which] = ((before + further) % most + 0.5) / most
    return changed
