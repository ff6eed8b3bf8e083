"""What a gate saves that may end its batch early, and how often it errs: computed state by state, nothing is drawn.

For several true success rates: how many episodes a batch of 384 drives in the mean until the gate is certain, looked at
after every chunk, and what it answers; beside it what the test of before answered, which knew of no end (a bet on all
alternatives), and what the batch would that is driven to its end. Then other ways to share the error among looks, and
batches whose worlds differ; and comparisons of two versions, whose gains and losses are a walk in two directions.

    python -m benchmarks.results.gate
"""

import bisect
import math
from collections.abc import Callable, Sequence
from functools import cache
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from benchmarks.harness import markdown
from tasks.results.statistics.interim_analyses import (
    Boundary,
    Chances,
    boundary,
    chances_between,
    closed_boundary,
    difference_tail,
    looks_of,
    nominal_levels,
    spent_error,
)
from tasks.results.statistics.intervals import paired_difference, wilson

PAIRS, CHUNK, CONFIDENCE = 384, 32, 0.95
MARGINS, DISAGREEING = (0.02, 0.03, 0.05), (0.01, 0.02, 0.03, 0.05, 0.1)
SIZES = ((96, 16), (192, 32), (384, 32))
_NEGLIGIBLE = 1e-13
States = Float[np.ndarray, "gains losses"]


class Ended(NamedTuple):
    """What becomes of a comparison: the chances of NO WORSE and WORSE, and the pairs that it drives in the mean."""

    passes: float
    fails: float
    pairs: float


def compared(pairs: int, chunk: int, margin: float, gained: float, lost: float, *, early: bool = True) -> Ended:
    """Returns what becomes of a batch in which so many pairs are gains and losses.

    Args:
        pairs: How many there are.
        chunk: After how many one looks.
        margin: How much worse the tested version may be.
        gained: The share of pairs that it alone passes.
        lost: The share that the other version alone passes.
        early: Whether one looks before the end; else Tango's interval is asked there.
    """
    looks = looks_of(pairs, chunk) if early else (pairs,)
    chances, before, passed, failed, driven = np.ones((1, 1)), 0, 0.0, 0.0, 0.0
    for number, look in enumerate(looks):
        driven += float(chances.sum()) * (look - before)
        chances = _onward(chances, look - before, gained, lost)
        passes, fails = _ends(looks if early else (), number, look, margin, chances.shape)
        passed, failed = passed + float(chances[passes].sum()), failed + float(chances[fails & ~passes].sum())
        chances, before = np.where(passes | fails, 0.0, chances), look
    return Ended(passed, failed, driven)


def pairs_table(margins: tuple[float, ...] = MARGINS) -> list[tuple[str, ...]]:
    """Returns a head, and a row a margin and a share of pairs that disagree.

    Args:
        margins: How much worse the tested version may be.
    """
    sizes = ", ".join(str(size) for size, _ in SIZES)
    rows: list[tuple[str, ...]] = [
        (
            "margin",
            "pairs that disagree",
            f"worse by the margin, {sizes} pairs: NO WORSE",
            "WORSE",
            f"equal, {PAIRS} pairs: NO WORSE, driven",
            "to its end: NO WORSE",
        )
    ]
    for margin in margins:
        for disagreeing in DISAGREEING:
            better, worse = (disagreeing - margin) / 2.0, (disagreeing + margin) / 2.0
            found = [compared(*size, margin, better, worse) for size in SIZES] if better >= 0.0 else []
            equal, half = compared(PAIRS, CHUNK, margin, disagreeing / 2.0, disagreeing / 2.0), disagreeing / 2.0
            end = compared(PAIRS, CHUNK, margin, half, half, early=False)
            rows.append(
                (
                    f"{100 * margin:g} points",
                    f"{100 * disagreeing:g} %",
                    ", ".join(_percent(each.passes) for each in found) or "cannot be",
                    ", ".join(_percent(each.fails) for each in found) or "cannot be",
                    f"{_percent(equal.passes)}, {equal.pairs:.0f}",
                    _percent(end.passes),
                )
            )
    return rows


def _onward(chances: States, more: int, gained: float, lost: float) -> States:
    """Returns the states after more pairs, without those that are next to impossible."""
    found = np.zeros((chances.shape[0] + more, chances.shape[1] + more))
    for up in range(more + 1):
        for down in range(more + 1 - up):
            chance = _multinomial(up, down, more, gained, lost)
            if chance > _NEGLIGIBLE:
                found[up : up + chances.shape[0], down : down + chances.shape[1]] += chance * chances
    likely = [np.flatnonzero(found.max(axis=axis) > _NEGLIGIBLE) for axis in (1, 0)]
    rows, columns = (int(each[-1]) + 1 if len(each) else 1 for each in likely)
    return found[:rows, :columns]


def _multinomial(up: int, down: int, n: int, gained: float, lost: float) -> float:
    agreed = max(0.0, 1.0 - gained - lost)
    return math.comb(n, up) * math.comb(n - up, down) * gained**up * lost**down * agreed ** (n - up - down)


def _ends(
    looks: tuple[int, ...], number: int, n: int, margin: float, shape: tuple[int, ...]
) -> tuple[Bool[np.ndarray, "gains losses"], Bool[np.ndarray, "gains losses"]]:
    """Returns in which states the comparison ends with NO WORSE, and in which with WORSE."""
    gains = np.arange(shape[0])[:, None]
    passes = np.array([_passes_from(looks, number, n, margin, losses) for losses in range(shape[1])])
    fails = np.array([_fails_to(looks, number, n, margin, losses) for losses in range(shape[1])])
    return gains >= passes[None, :], gains <= fails[None, :]


@cache
def _passes_from(looks: tuple[int, ...], number: int, n: int, margin: float, losses: int) -> int:
    """Returns from how many gains on it is NO WORSE."""
    counts = range(n - losses + 1)

    def shown(gains: int) -> bool:
        if not looks:
            return paired_difference(gains, losses, n, CONFIDENCE).lower >= -margin
        return (gains - losses) / n > -margin and difference_tail(gains, losses, n, -margin) <= _level(looks, number)

    return bisect.bisect_left(counts, x=True, key=shown)


@cache
def _fails_to(looks: tuple[int, ...], number: int, n: int, margin: float, losses: int) -> int:
    """Returns up to how many gains it is WORSE; below 0 if it is not."""
    counts = range(n - losses + 1)

    def open_still(gains: int) -> bool:
        if not looks:
            return paired_difference(gains, losses, n, CONFIDENCE).upper >= -margin
        return (gains - losses) / n >= -margin or difference_tail(losses, gains, n, margin) > _level(looks, number)

    return bisect.bisect_left(counts, x=True, key=open_still) - 1


def _level(looks: tuple[int, ...], number: int) -> float:
    return _levels(looks)[number]


@cache
def _levels(looks: tuple[int, ...]) -> tuple[float, ...]:
    return nominal_levels(looks, spent_error(looks, (1.0 - CONFIDENCE) / 2.0))


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"


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


if __name__ == "__main__":
    main()
