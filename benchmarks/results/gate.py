"""What a gate saves that may end its batch early, and how often it errs: computed state by state, nothing is drawn.

For several true success rates: how many episodes a batch of 384 drives in the mean until the gate is certain, looked at
after every chunk, and what it answers; beside it what the batch would that is driven to its end. Then other ways to
share the error among looks, and batches whose worlds differ.

    python -m benchmarks.results.gate
"""

import bisect
import math
from collections.abc import Callable, Sequence
from statistics import NormalDist

import numpy as np

from benchmarks.harness import markdown
from benchmarks.results.gate_pairs import pairs_table
from tasks.results.statistics.interim_analyses import (
    Boundary,
    Chances,
    boundary,
    chances_between,
    closed_boundary,
    looks_of,
)
from tasks.results.statistics.intervals import wilson

EPISODES, BAR, ALPHA = 384, 0.9, 0.05
RATES = (0.8, 0.85, 0.88, 0.9, 0.92, 0.95, 0.97, 0.98, 0.99, 1.0)
CHUNKS = (16, 32, 96)
BATCHES = 20_000
# A bar, episodes, a chunk, and true rates: what ways to spend the error are compared on.
CASES = (
    (0.9, 384, 16, (0.95, 0.97, 0.99, 1.0)),
    (0.9, 384, 32, (0.95, 0.97, 0.99, 1.0)),
    (0.9, 384, 96, (0.95, 0.97, 0.99, 1.0)),
    (0.95, 384, 32, (0.98, 0.99, 1.0)),
    (0.8, 192, 16, (0.9, 0.95, 1.0)),
    (0.98, 1000, 50, (0.99, 0.995, 1.0)),
)
Spend = Callable[[float], float]


def at_looks(rate: float, chunk: int) -> Chances:
    """Returns what becomes of a batch that is looked at after every chunk, with its end in sight."""
    looks = looks_of(EPISODES, chunk)
    return chances_between(looks, boundary(looks, BAR, 1.0 - ALPHA), rate)


def to_the_end(rate: float) -> Chances:
    """Returns what becomes of a batch that is driven to its end and judged by Wilson's interval."""
    counts, confidence = range(EPISODES + 1), 1.0 - ALPHA
    passes = bisect.bisect_left(counts, BAR, key=lambda count: wilson(count, EPISODES, confidence).lower)
    fails = bisect.bisect_left(counts, BAR, key=lambda count: wilson(count, EPISODES, confidence).upper) - 1
    return chances_between((EPISODES,), Boundary((passes,), (fails,)), rate)


def table() -> list[tuple[str, ...]]:
    """Returns a head, and a row a true rate."""
    chunks = ", ".join(map(str, CHUNKS))
    rows: list[tuple[str, ...]] = [
        (
            "true rate",
            f"episodes driven, chunks of {chunks}",
            f"PASS, chunks of {chunks}",
            f"FAIL, chunks of {chunks}",
            "to its end: PASS, FAIL",
        )
    ]
    for rate in RATES:
        found, end = [at_looks(rate, chunk) for chunk in CHUNKS], to_the_end(rate)
        rows.append(
            (
                f"{100 * rate:g} %",
                ", ".join(f"{each.episodes:.0f}" for each in found),
                ", ".join(_percent(each.passes) for each in found),
                ", ".join(_percent(each.fails) for each in found),
                f"{_percent(end.passes)}, {_percent(end.fails)}",
            )
        )
    return rows


def ways_to_spend() -> dict[str, Spend]:
    """Returns functions of the share of episodes that are in: how much of alpha / 2 may be used up."""
    normal, alpha = NormalDist(), ALPHA / 2.0

    def o_brien_fleming(time: float) -> float:
        return 2.0 - 2.0 * normal.cdf(normal.inv_cdf(1.0 - alpha / 2.0) / math.sqrt(time))

    return {
        "O'Brien and Fleming": o_brien_fleming,
        **{f"power {power:g}": lambda time, power=power: alpha * time**power for power in (3.0, 2.0, 1.5, 1.0)},
        **{
            f"Hwang, Shih and DeCani {gamma}": lambda time, gamma=gamma: (
                alpha * math.expm1(-gamma * time) / math.expm1(-gamma)
            )
            for gamma in (-8, -4, -3, -2, -1)
        },
        "a fifth equal parts, else O'Brien and Fleming": lambda time: 0.2 * alpha * time + 0.8 * o_brien_fleming(time),
    }


def spending_table() -> list[tuple[str, ...]]:
    """Returns a head, and a row a way to spend: the mean over all cases, and the figures of two."""
    rows: list[tuple[str, ...]] = [
        (
            "spending",
            "power, mean",
            "share driven, mean",
            *(f"bar 90 %, rate {rate}: power, driven" for rate in ("95 %", "100 %")),
        )
    ]
    for name, spend in ways_to_spend().items():
        found = [_spent(spend, *case[:3], rate) for case in CASES for rate in case[3]]
        driven = [each.episodes / case[1] for case, each in zip(_each_case(), found, strict=True)]
        shown = [_spent(spend, 0.9, EPISODES, 32, rate) for rate in (0.95, 1.0)]
        means = (_percent(float(np.mean([each.passes for each in found]))), _percent(float(np.mean(driven))))
        rows.append((name, *means, *(f"{_percent(each.passes)}, {each.episodes:.0f}" for each in shown)))
    return rows


def worlds_table() -> list[tuple[str, ...]]:
    """Returns a head, and a row a spread of worlds: how often batches at the bar are ever found above, and below."""
    rows: list[tuple[str, ...]] = [
        ("8 worlds at rates of", "shuffled: above, below", "one world after the other: above")
    ]
    looks, generator = looks_of(EPISODES, 32), np.random.default_rng(11)
    ends = boundary(looks, BAR, 1.0 - ALPHA)
    for low, high in ((0.9, 0.9), (0.85, 0.95), (0.8, 1.0)):
        chance = np.repeat([high] * 4 + [low] * 4, EPISODES // 8)
        drawn = generator.random((BATCHES, EPISODES)) < chance
        above, below = _ever(generator.permuted(drawn, axis=1), looks, ends)
        ordered, _ = _ever(drawn, looks, ends)
        worlds = "90 %" if low == high else f"{100 * low:g} % and {100 * high:g} %, four each"
        rows.append((worlds, f"{_percent(above)}, {_percent(below)}", _percent(ordered)))
    return rows


def main() -> None:
    """Prints the tables."""
    for rows in (table(), spending_table(), worlds_table(), pairs_table()):
        print(markdown(rows), end="\n\n")


def _spent(spend: Spend, bar: float, episodes: int, chunk: int, rate: float) -> Chances:
    looks = looks_of(episodes, chunk)
    spent = [spend(look / episodes) for look in looks]
    above, below = (closed_boundary(looks, spent, share) for share in (bar, 1.0 - bar))
    fails = tuple(look - failures for look, failures in zip(looks, below, strict=True))
    return chances_between(looks, Boundary(above, fails), rate)


def _each_case() -> list[tuple[float, int]]:
    return [(bar, episodes) for bar, episodes, _, rates in CASES for _ in rates]


def _ever(passes: "np.ndarray", looks: Sequence[int], ends: Boundary) -> tuple[float, float]:
    counts = np.cumsum(passes, axis=1, dtype=np.int64)[:, np.array(looks) - 1]
    above, below = counts >= np.array(ends.passes), counts <= np.array(ends.fails)
    return float(above.any(axis=1).mean()), float(below.any(axis=1).mean())


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"


if __name__ == "__main__":
    main()
