"""What a gate saves that may end its batch early, and how often it errs: simulated batches, no simulator.

For several true success rates: how many episodes a batch of 384 drives until the gate is certain, looked at after every
chunk, and what it answers; beside it what the batch that is driven to its end would have answered.

    python -m benchmarks.results.gate [--json FILE]
"""

import argparse
import json
import math
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Int

from benchmarks.tables import markdown
from tasks.results.statistics.intervals import wilson
from tasks.results.statistics.looks.anytime import log_capital_above, log_capital_below

BATCHES, EPISODES, BAR, ALPHA = 2_000, 384, 0.9, 0.05
RATES = (0.7, 0.8, 0.85, 0.9, 0.95, 0.98, 0.99, 1.0)
CHUNKS = (16, 32, 96)
_ENOUGH = math.log(2 / ALPHA)


def saving(rate: float, chunk: int) -> tuple[float, float, float]:
    """Returns the mean share of episodes that is not driven, and the shares of batches that PASS and that FAIL."""
    passes = np.random.default_rng(7).random((BATCHES, EPISODES)) < rate
    running = np.cumsum(passes, axis=1, dtype=np.int64)
    looks = np.arange(chunk, EPISODES + 1, chunk)
    above = np.stack([_reached(running[:, n - 1], int(n), above=True) for n in looks], axis=1)
    below = np.stack([_reached(running[:, n - 1], int(n), above=False) for n in looks], axis=1)
    ended = above | below
    first = np.where(ended.any(axis=1), ended.argmax(axis=1), len(looks) - 1)
    passed = above[np.arange(BATCHES), first].mean()
    failed = below[np.arange(BATCHES), first].mean()
    return float(1.0 - looks[first].mean() / EPISODES), float(passed), float(failed)


def to_the_end(rate: float) -> tuple[float, float]:
    """Returns the shares of batches that PASS and that FAIL when all episodes are driven."""
    counts = np.random.default_rng(8).binomial(EPISODES, rate, BATCHES)
    bounds = {int(count): wilson(int(count), EPISODES, 1 - ALPHA) for count in np.unique(counts)}
    passed = np.mean([bounds[int(count)].lower >= BAR for count in counts])
    return float(passed), float(np.mean([bounds[int(count)].upper < BAR for count in counts]))


def table() -> list[tuple[str, ...]]:
    """Returns a head, and a row a true rate."""
    rows: list[tuple[str, ...]] = [
        ("true rate", *(f"saved, chunks of {chunk}" for chunk in CHUNKS), "PASS, FAIL", "to its end: PASS, FAIL")
    ]
    for rate in RATES:
        found = [saving(rate, chunk) for chunk in CHUNKS]
        answers = [_pair(*found[0][1:]), _pair(*to_the_end(rate))]
        rows.append((f"{100 * rate:g} %", *(f"{100 * saved:.0f} %" for saved, _, _ in found), *answers))
    return rows


def main() -> None:
    """Prints a row a true rate."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    rows = table()
    print(markdown(rows))
    if options.json:
        options.json.write_text(json.dumps([dict(zip(rows[0], row, strict=True)) for row in rows[1:]], indent=2))


def _pair(passed: float, failed: float) -> str:
    return f"{100 * passed:.1f} %, {100 * failed:.1f} %"


def _reached(counts: Int[np.ndarray, " batches"], n: int, *, above: bool) -> Bool[np.ndarray, " batches"]:
    capital = log_capital_above if above else log_capital_below
    found = {int(count): capital(int(count), n, BAR) >= _ENOUGH for count in np.unique(counts)}
    return np.array([found[int(count)] for count in counts])


if __name__ == "__main__":
    main()
