"""How often the interval of 8 of 48 real worlds holds the rate of all 48, for each batch and what it counts.

Worlds are drawn with replacement, so that they are independent draws of the 48; of each, some of its episodes without.

    python -m benchmarks.statistics.resampled_worlds
"""

import json

import numpy as np

from benchmarks.statistics.real_batches import COUNTS, Counts
from benchmarks.statistics.simulated_worlds import CONFIDENCE, shares_of
from benchmarks.statistics.table_file import Rows, keep, per_cent
from tasks.results.statistics.intervals import wilson_bounds
from tasks.results.statistics.over_worlds import rates_shown, world_spread

REPLICATES, WORLDS = 2_000, 8
_SEED = 18
_COUNTED = ("success", "collision")


def counts() -> dict[str, Counts]:
    """Returns the counts by world of each batch."""
    return json.loads(COUNTS.read_text())


def coverage() -> Rows:
    """Returns per batch and what is counted: its rate and ICC in 48 worlds, and coverage by 8 of them."""
    head = ["batch", "counted", "rate", "ICC", "all seeds", "half of them", "Wilson, all seeds"]
    rows = [head]
    for name, found in counts().items():
        for counted in _COUNTED:
            spread = world_spread(found[counted], found["episodes"])
            rate = sum(found[counted]) / sum(found["episodes"])
            icc = "-" if spread.icc is None else f"{spread.icc:.2f}"
            full, half = (covered(found, counted, part) for part in (1, 2))
            cells = [per_cent(full[0]), per_cent(half[0]), per_cent(full[1])]
            rows.append([name, counted, per_cent(rate), icc, *cells])
    return rows


def covered(found: Counts, counted: str, part: int, replicates: int = REPLICATES) -> tuple[float, float]:
    """Returns how often the intervals over worlds, and Wilson's, of 8 worlds hold the rate of all.

    Args:
        found: Counts by world, with as many episodes in each.
        counted: Which of them.
        part: Which part of a world's episodes is drawn: 2 is half of them.
        replicates: How often.
    """
    random = np.random.default_rng(_SEED)
    n, events = np.array(found["episodes"]), np.array(found[counted])
    rate = float(events.sum() / n.sum())
    drawn = random.integers(0, len(n), (replicates, WORLDS))
    each = int(n.min()) // part
    some = random.hypergeometric(events[drawn], (n - events)[drawn], each)
    above, below = shares_of(lambda data: rates_shown(data, np.full(WORLDS, each), rate, CONFIDENCE), some)
    lower, upper = wilson_bounds(
        some.sum(axis=1).astype(np.float64), np.full(replicates, float(WORLDS * each)), CONFIDENCE
    )
    return 1.0 - above - below, float(((lower <= rate) & (rate <= upper)).mean())


def main() -> None:
    """Prints and keeps the table."""
    keep("real batches", coverage())


if __name__ == "__main__":
    main()
