"""How often bounds of a quantile over worlds hold: simulated.

A value is normally distributed about its world's, which is normally distributed: the correlation is that of two values.

    python -m benchmarks.statistics.quantiles
"""

import math

import numpy as np
from jaxtyping import Float

from benchmarks.statistics.simulated_worlds import CONFIDENCE, DESIGNS
from benchmarks.statistics.table_file import Rows, keep, per_cent
from tasks.results.statistics.over_worlds import rates_shown, why_refused

REPLICATES = 4_000
CORRELATIONS, QUANTILES = (0.0, 0.1, 0.3, 0.6), (0.05, 0.5, 0.95)
_SEED, _EXACT = 18, 1e-9
# Of the cuts at which a bound would be wrong, so many are tried, and the quantile itself.
_TRIED = 6


def misses() -> Rows:
    """Returns per design and quantile, for each correlation: how often the lower bound is above it."""
    rows = [["worlds x values", "quantile", *(f"correlation {each:g}" for each in CORRELATIONS)]]
    for design in DESIGNS[:3]:
        for quantile in QUANTILES:
            refused = why_refused("quantile", design[0], tail=quantile)
            cells = ["refused" if refused else per_cent(missed(design, quantile, each)) for each in CORRELATIONS]
            rows.append([f"{design[0]} x {design[1]}", f"{quantile:g}", *cells])
    return rows


def missed(design: tuple[int, int], quantile: float, correlation: float, replicates: int = REPLICATES) -> float:
    """Returns how often `quantile_over_worlds` has a lower bound above the quantile.

    That is where the share of values up to a cut, from the quantile to that of all values, is shown to be less than it
    is. An upper bound is the lower one of the values turned over.
    """
    from scipy.stats import norm  # noqa: PLC0415 - as in the code that is measured

    random, true = np.random.default_rng(_SEED), float(norm.ppf(quantile))
    counts, owner = [], []
    for replicate in range(replicates):
        of_worlds = np.sqrt(correlation) * random.normal(size=(design[0], 1))
        values = of_worlds + np.sqrt(1.0 - correlation) * random.normal(size=design)
        for cut in _cuts(values, true, quantile):
            counts.append((values <= cut).sum(axis=1))
            owner.append(replicate)
    if not counts:
        return 0.0
    n, sorted_counts = np.full(*design), np.sort(np.stack(counts), axis=1)
    some, turn = np.unique(sorted_counts, axis=0, return_inverse=True)
    below = np.concatenate(
        [rates_shown(some[first : first + 200], n, quantile, CONFIDENCE)[1] for first in range(0, len(some), 200)]
    )
    return len(set(np.array(owner)[below[turn.ravel()]].tolist())) / replicates


def _cuts(values: Float[np.ndarray, "worlds n"], true: float, quantile: float) -> list[float]:
    """Returns the quantile, and the values above it at which a bound would be wrong."""
    together = np.sort(values, axis=None)
    middle = together[math.ceil(quantile * len(together) - _EXACT) - 1]
    above = together[(together > true) & (together < middle)]
    if middle <= true:
        return []
    return [true, *above[np.linspace(0, len(above) - 1, min(_TRIED, len(above))).astype(np.int64)]]


def main() -> None:
    """Prints and keeps the table."""
    keep("quantiles", misses())


if __name__ == "__main__":
    main()
