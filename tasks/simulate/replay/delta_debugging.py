"""Delta debugging: finds a small part of a world that still makes an episode fail.

Zeller and Hildebrandt 2002 (IEEE Transactions on Software Engineering 28:183), algorithm ddmin: parts, then what is
left without each part, in ever smaller parts, until nothing can be left out any more. There a test is run after the
other; here the tests of a round are the lanes of one batch, and the smallest that fails is taken.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

Names = tuple[str, ...]
# Says of each of several selections whether the failure is still there with it, all simulated together.
StillFails = Callable[[Sequence[Names]], Sequence[bool]]


class MinimalSelection(NamedTuple):
    """What is left of a selection that fails.

    Attributes:
        names: What is left, in the order that it had.
        tried: How many selections were tried.
        minimal: Whether it is known that no single one can be left out; not where the budget ended before.
    """

    names: Names
    tried: int
    minimal: bool


def minimize_selection(names: Names, still_fails: StillFails, budget: int) -> MinimalSelection:
    """Returns a selection that still fails and, if the budget allows, of which none can be left out.

    Args:
        names: All of it; known to fail.
        still_fails: Tries selections.
        budget: How many selections may be tried.
    """
    left: Names = names
    parts, tried = 1, 0
    while parts <= len(left) and tried < budget:
        alone, without = _round(left, parts)
        round_ = list(dict.fromkeys([*alone, *without]))
        now = round_[: budget - tried]
        tried += len(now)
        failing = [selection for selection, fails in zip(now, still_fails(now), strict=True) if fails]
        if failing:
            left = sorted(failing, key=len)[0]  # of equally small ones the first
            parts = 2 if left in alone else max(parts - 1, 2)
        elif len(now) == len(round_) and parts == len(left):
            return MinimalSelection(left, tried, minimal=True)
        else:
            parts = min(2 * parts, len(left))
    # Of a single one that is left, it was the first thing to be tried that nothing at all does not fail.
    return MinimalSelection(left, tried, minimal=not left or (len(left) == 1 and tried > 0))


def _round(left: Names, parts: int) -> tuple[list[Names], list[Names]]:
    """Returns what is tried in a round: each part, and all but each part; at first nothing at all."""
    if parts == 1:
        return [()], []
    ends = [len(left) * number // parts for number in range(parts + 1)]
    alone = [left[begin:end] for begin, end in pairwise(ends)]
    return alone, [left[:begin] + left[end:] for begin, end in pairwise(ends)]
