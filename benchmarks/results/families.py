"""How often all intervals of a report's groups hold together.

    .venv/bin/python -m benchmarks.results.families [--document FILE]

Independent groups: exactly, by all outcomes, at rates from 0.900 to 0.995. Groups that overlap (the worlds and the
values of one batch) in worlds that differ: simulated batches, with the rates of a group's own worlds and values as what
must be covered. Rows are made by the code that reports use.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float
from scipy.stats import binom

from benchmarks.harness import markdown, options, show
from tasks.results.statistics.intervals import IntervalFamily, wilson_bounds

RATES = np.arange(0.9, 0.9951, 0.005)
GROUPS, EPISODES = (8, 16, 48), (8, 24, 48)
BATCHES, WORLDS, VALUES, SEEDS = 4_000, 8, 6, 8
MIXED = ((0.9, 0.0), (0.9, 0.1), (0.9, 0.3), (0.98, 0.0), (0.98, 0.1), (0.98, 0.3))
_Bounds = tuple[Float[np.ndarray, " outcomes"], Float[np.ndarray, " outcomes"]]
_Method = Callable[[int, IntervalFamily], _Bounds]


def wilson_all(n: int, confidence: float) -> _Bounds:
    """Returns Wilson's bounds of 0 to n successes."""
    return wilson_bounds(np.arange(n + 1.0), np.full(n + 1, float(n)), confidence)


def exact_all(n: int, family: IntervalFamily) -> _Bounds:
    """Returns the bounds that reports show of 0 to n successes."""
    found = [family.interval(successes, n) for successes in range(n + 1)]
    return np.array([each.lower for each in found]), np.array([each.upper for each in found])


METHODS: tuple[_Method, ...] = (
    lambda n, family: wilson_all(n, family.confidence),
    lambda n, family: wilson_all(n, family.each),
    exact_all,
)


def together(n: int, family: IntervalFamily, method: _Method) -> Float[np.ndarray, " rates"]:
    """Returns how often the intervals of all groups hold, exactly, at each of the rates."""
    lower, upper = method(n, family)
    chances = binom.pmf(np.arange(n + 1)[:, None], n, RATES)
    held = (lower[:, None] <= RATES) & (upper[:, None] >= RATES)
    return (chances * held).sum(axis=0) ** family.size


def independent_table() -> str:
    """Returns the lowest and the mean coverage of families of independent groups."""
    rows: list[tuple[str, ...]] = [("groups x episodes", "Wilson, each 95 %", "Wilson, shared", "exact, shared")]
    for groups in GROUPS:
        for n in EPISODES:
            family = IntervalFamily(size=groups, confidence=0.95)
            found = [together(n, family, method) for method in METHODS]
            rows.append((f"{groups} x {n}", *(f"{100 * each.min():.1f}, {100 * each.mean():.1f} %" for each in found)))
    return markdown(rows)


def mixed_table(rng: np.random.Generator) -> str:
    """Returns the coverage of the worlds and values of a batch, in worlds that differ."""
    rows: list[tuple[str, ...]] = [("rate", "correlation", "Wilson, each 95 %", "Wilson, shared", "exact, shared")]
    for rate, icc in MIXED:
        held = np.mean([_batch_held(rng, rate, icc) for _ in range(BATCHES)], axis=0)
        rows.append((f"{100 * rate:g} %", f"{icc:g}", *(f"{100 * each:.1f} %" for each in held)))
    return markdown(rows)


def _batch_held(rng: np.random.Generator, rate: float, icc: float) -> Bool[np.ndarray, " methods"]:
    chance = np.full(WORLDS, rate)
    if icc:
        total = 1.0 / icc - 1.0
        chance = rng.beta(rate * total, (1.0 - rate) * total, WORLDS)
    passed = rng.binomial(SEEDS, chance[:, None], (WORLDS, VALUES))
    groups = [(passed.sum(axis=1), VALUES * SEEDS, chance), (passed.sum(axis=0), WORLDS * SEEDS, chance.mean())]
    family = IntervalFamily(size=WORLDS + VALUES, confidence=0.95)
    held = [all(_covers(_table(number, n, family), counts, true) for counts, n, true in groups) for number in range(3)]
    return np.array(held)


def _covers(bounds: _Bounds, counts: np.ndarray, true: np.ndarray) -> bool:
    # A rate of a world may be so near 1 that it is 1 in floating point.
    return bool(np.all((bounds[0][counts] <= true + 1e-12) & (true - 1e-12 <= bounds[1][counts])))


_CACHE: dict[tuple[int, int], _Bounds] = {}


def _table(number: int, n: int, family: IntervalFamily) -> _Bounds:
    if (number, n) not in _CACHE:
        _CACHE[number, n] = METHODS[number](n, family)
    return _CACHE[number, n]


def main() -> None:
    """Prints both tables, and puts them into a document if one is named."""
    document = options(__doc__).parse_args().document
    tables = {"families": independent_table(), "families in worlds": mixed_table(np.random.default_rng(18))}
    for name, table in tables.items():
        show(name, table, document)


if __name__ == "__main__":
    main()
