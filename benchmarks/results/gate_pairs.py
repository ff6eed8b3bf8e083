"""How often a comparison of two versions errs that may end its batch early, and what it saves: computed, not drawn.

The numbers of gains and losses are a walk in two directions; its states are followed from look to look.
"""

import bisect
import math
from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from tasks.results.statistics.interim_analyses import difference_tail, looks_of, nominal_levels, spent_error
from tasks.results.statistics.intervals import paired_difference

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
