"""How often the interval of a paired difference over worlds covers and says NO WORSE wrongly: simulated.

python -m benchmarks.statistics.differences
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Int

from benchmarks.statistics.simulated_worlds import CONFIDENCE, DESIGNS, ICCS
from benchmarks.statistics.table_file import Rows, keep, per_cent
from tasks.results.statistics.over_worlds import differences_shown

REPLICATES = 4_000
# Shares of gains and of losses: five points worse, which a margin of five points just forbids; as good.
_WORSE, _AS_GOOD = (0.02, 0.07), (0.05, 0.05)
_SEED, _AT_ONCE = 18, 200
_LEAST = 1e-12
Counts = Int[np.ndarray, "sets worlds"]
Draw = Callable[[np.random.Generator, tuple[float, float], float, tuple[int, int], int], tuple[Counts, Counts]]


def together(
    random: np.random.Generator, shares: tuple[float, float], icc: float, design: tuple[int, int], replicates: int
) -> tuple[Counts, Counts]:
    """Returns gains and losses of worlds whose chances of gain, loss and tie are Dirichlet distributed."""
    mean = np.array([*shares, 1.0 - sum(shares)])
    shape = (replicates, design[0], 3)
    if icc == 0.0:
        chances = np.broadcast_to(mean, shape)
    else:
        parts = random.gamma(np.broadcast_to(mean * (1.0 / icc - 1.0), shape)) + np.finfo(np.float64).tiny
        chances = parts / parts.sum(axis=2, keepdims=True)
    counts = random.multinomial(design[1], chances)
    return counts[..., 0], counts[..., 1]


def apart(
    random: np.random.Generator, shares: tuple[float, float], icc: float, design: tuple[int, int], replicates: int
) -> tuple[Counts, Counts]:
    """Returns gains and losses of worlds in which losses are beta distributed, and so are gains among the rest."""
    gain, loss = shares[0] / (1.0 - shares[1]), shares[1]
    if icc == 0.0:
        return together(random, shares, icc, design, replicates)
    total, shape = 1.0 / icc - 1.0, (replicates, design[0])
    losses = random.binomial(design[1], random.beta(loss * total, (1.0 - loss) * total, shape))
    gains = random.binomial(design[1] - losses, random.beta(gain * total, (1.0 - gain) * total, shape))
    return gains, losses


def coverage() -> Rows:
    """Returns per design and shares, for each correlation: coverage, false NO WORSE; by either way to draw worlds."""
    rows = [["worlds x pairs", "gains, losses", "worlds", *(f"ICC {icc:g}" for icc in ICCS)]]
    for design in DESIGNS[:3]:
        for shares, draw in ((_WORSE, together), (_WORSE, apart), (_AS_GOOD, together)):
            cells = [cell(draw, shares, icc, design) for icc in ICCS]
            rows.append([f"{design[0]} x {design[1]}", _named(shares), draw.__name__, *cells])
    return rows


def cell(
    draw: Draw, shares: tuple[float, float], icc: float, design: tuple[int, int], replicates: int = REPLICATES
) -> str:
    """Returns one cell: coverage, and how often the difference is shown to be above the true one."""
    gains, losses = draw(np.random.default_rng(_SEED), shares, icc, design, replicates)
    n, true = np.full(design[0], design[1]), shares[0] - shares[1]
    found = [
        differences_shown(gains[first : first + _AT_ONCE], losses[first : first + _AT_ONCE], n, true, CONFIDENCE)
        for first in range(0, replicates, _AT_ONCE)
    ]
    above, below = (float(np.concatenate([each[side] for each in found]).mean()) for side in (0, 1))
    return per_cent(1.0 - above - below, above)


def main() -> None:
    """Prints and keeps the table."""
    keep("differences", coverage())


def _named(shares: tuple[float, float]) -> str:
    return f"{100 * shares[0]:g} %, {100 * shares[1]:g} %"


if __name__ == "__main__":
    main()
