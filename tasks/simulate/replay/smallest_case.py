"""The smallest case that still fails: a selection of furniture and a seed, neither of which can be made less."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from tasks.simulate.replay.delta_debugging import Names, leave_out_singles, minimize_selection

# Seeds that are looked at below the first; simulated together.
_SEEDS_AT_MOST = 64


class Case(NamedTuple):
    """What to try: the furniture that stays, and a seed."""

    names: Names
    seed: int


# Says of several cases whether the failure is still there, as ``StillFails`` does of selections.
StillFailsCase = Callable[[Sequence[Case]], Sequence[bool]]


def smallest_case(first: Case, still_fails: StillFailsCase) -> tuple[Case, bool]:
    """Returns a case that still fails, and whether it is known that it does not without any single piece.

    Another seed may need fewer pieces, and with fewer pieces another seed may fail. So both are made less in turn until
    neither can be: at its seed no single piece can be left out, and with its pieces no lower seed that was tried fails.

    Args:
        first: Known to fail.
        still_fails: Tries cases; that it is asked again of one costs nothing.
    """

    def at(seed: int) -> Callable[[Sequence[Names]], Sequence[bool]]:
        return lambda selections: still_fails([Case(names, seed) for names in selections])

    seed, found = first.seed, minimize_selection(first.names, at(first.seed))
    while (lower := _lowest_seed(found.names, seed, still_fails)) < seed:
        seed, found = lower, leave_out_singles(found.names, at(lower))
    return Case(found.names, seed), found.minimal


def _lowest_seed(names: Names, seed: int, still_fails: StillFailsCase) -> int:
    """Returns the lowest seed that still fails, of those below one that may be tried; that one at worst."""
    seeds = range(min(seed, _SEEDS_AT_MOST))
    answers = still_fails([Case(names, lower) for lower in seeds])
    return next((lower for lower, fails in zip(seeds, answers, strict=False) if fails), seed)
