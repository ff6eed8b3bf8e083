"""Delta debugging: finds a small part of a world that still makes an episode fail.

Zeller and Hildebrandt 2002 (IEEE Transactions on Software Engineering 28:183), algorithm ddmin: parts, then what is
left without each part, in ever smaller parts, until nothing can be left out any more. There a test is run after the
other; here the tests of a round are the lanes of one batch, and the smallest that fails is taken.

What comes out is 1-minimal, as there in section 3.2: without any single one of what is left the failure is gone.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

Names = tuple[str, ...]
# Says of several selections whether the failure is still there with each, all simulated together; of fewer than it was
# asked, from the first one on, where no more may be tried.
StillFails = Callable[[Sequence[Names]], Sequence[bool]]


class MinimalSelection(NamedTuple):
    """What is left of a selection that fails.

    Attributes:
        names: What is left, in the order that it had.
        minimal: Whether each was left out by itself, and the failure was then gone; not where no more might be tried.
    """

    names: Names
    minimal: bool


def minimize_selection(names: Names, still_fails: StillFails) -> MinimalSelection:
    """Returns a selection that still fails and of which, unless the trials end before, no single one can be left out.

    Args:
        names: All of it; known to fail.
        still_fails: Tries selections; that it is asked again of one costs nothing.
    """
    left, parts = names, 1
    while parts <= len(left):
        alone, without = _round(left, parts)
        asked = list(dict.fromkeys([*alone, *without]))
        answers = still_fails(asked)
        failing = [selection for selection, fails in zip(asked, answers, strict=False) if fails]
        if failing:
            left = sorted(failing, key=len)[0]  # of equally small ones the first
            parts = 2 if left in alone else max(parts - 1, 2)
        elif parts == len(left) or len(answers) < len(asked):
            break
        else:
            parts = min(2 * parts, len(left))
    return leave_out_singles(left, still_fails)


def leave_out_singles(names: Names, still_fails: StillFails) -> MinimalSelection:
    """Returns what is left when single ones are left out until, unless the trials end before, none can be.

    A pass tries the selection without each one, all together. Those that can be left out by themselves are then left
    out together, as many as go, from the first one on; and another pass begins.

    Args:
        names: A selection that is known to fail.
        still_fails: Tries selections.
    """
    left = names
    while left:
        answers = still_fails([_without(left, (name,)) for name in left])
        loose = tuple(name for name, fails in zip(left, answers, strict=False) if fails)
        if not loose:
            return MinimalSelection(left, minimal=len(answers) == len(left))
        more = [_without(left, loose[:count]) for count in range(2, len(loose) + 1)]
        failing = [selection for selection, fails in zip(more, still_fails(more), strict=False) if fails]
        left = failing[-1] if failing else _without(left, loose[:1])
    return MinimalSelection((), minimal=True)


def _round(left: Names, parts: int) -> tuple[list[Names], list[Names]]:
    """Returns what is tried in a round: each part, and all but each part; at first nothing at all."""
    if parts == 1:
        return [()], []
    ends = [len(left) * number // parts for number in range(parts + 1)]
    alone = [left[begin:end] for begin, end in pairwise(ends)]
    return alone, [left[:begin] + left[end:] for begin, end in pairwise(ends)]


def _without(names: Names, out: Names) -> Names:
    return tuple(name for name in names if name not in out)
