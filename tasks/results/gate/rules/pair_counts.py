"""Counts how two versions compare on the episodes that both were asked for, whatever is missing of either.

An episode that the other version was never asked for is no pair: its plan said so before anything ran. One that it was
asked for and did not end is one, and the table of missing data says what it counts as.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from specs.base import Spec
from tasks.results.gate.rules.missing import ASSUMED, gap_of
from tasks.results.statistics.pairs import Drive, Drives


class _Passed(NamedTuple):
    """Whether an episode passed, at the worst and at the best for the tested version."""

    worst: bool
    best: bool


class WorldPairs(Spec):
    """The pairs of one world, as a PASS and as a FAIL take them.

    Attributes:
        n: Pairs, those with an unknown end included.
        gains: How many the new version passed and the other did not, at the worst for the new one.
        losses: How many the other version passed and the new one did not, at the worst for the new one.
        gains_at_best: The first at the best for the new one.
        losses_at_best: The second.
    """

    n: int
    gains: int
    losses: int
    gains_at_best: int
    losses_at_best: int


class PairCounts(Spec):
    """What two versions came to on the same episodes.

    Attributes:
        n: Pairs whose ends are both known.
        gains: How many of them the new version passed and the other did not.
        losses: How many the other version passed and the new one did not.
        unpaired: Episodes of the new version that the other was not asked for.
        unknown: Pairs of which an end is not known.
        worlds: All pairs, by world.
    """

    n: int
    gains: int
    losses: int
    unpaired: int
    unknown: int = 0
    worlds: tuple[WorldPairs, ...] = ()

    def total(self) -> WorldPairs:
        """Returns all pairs as one."""
        if not self.worlds:
            return WorldPairs(
                n=self.n,
                gains=self.gains,
                losses=self.losses,
                gains_at_best=self.gains,
                losses_at_best=self.losses,
            )
        names = WorldPairs.model_fields
        return WorldPairs(**{name: sum(getattr(world, name) for world in self.worlds) for name in names})


def count_pairs(new: Drives, other: Drives) -> PairCounts:
    """Returns how the new version compares with another one on the episodes that both were asked for."""
    pairs = [(each, other[key]) for key, each in new.items() if key in other]
    ends = [(_ours(ours), _theirs(theirs)) for ours, theirs in pairs]
    known = [
        (ours.worst, theirs.worst) for ours, theirs in ends if ours.worst == ours.best and theirs.worst == theirs.best
    ]
    gains, losses = _disagreements(known)
    by_world: dict[str, list[tuple[Drive, Drive]]] = {}
    for ours, theirs in pairs:
        by_world.setdefault(ours.world, []).append((ours, theirs))
    return PairCounts(
        n=len(known),
        gains=gains,
        losses=losses,
        unpaired=len(new) - len(pairs),
        unknown=len(pairs) - len(known),
        worlds=tuple(_of_world(by_world[world]) for world in sorted(by_world)),
    )


def _of_world(pairs: Sequence[tuple[Drive, Drive]]) -> WorldPairs:
    ends = [(_ours(ours), _theirs(theirs)) for ours, theirs in pairs]
    gains, losses = _disagreements((ours.worst, theirs.worst) for ours, theirs in ends)
    at_best = _disagreements((ours.best, theirs.best) for ours, theirs in ends)
    return WorldPairs(n=len(pairs), gains=gains, losses=losses, gains_at_best=at_best[0], losses_at_best=at_best[1])


def _disagreements(ends: Iterable[tuple[bool, bool]]) -> tuple[int, int]:
    """Returns gains and losses of pairs, each of which says whether the new version passed and whether the other."""
    found = list(ends)
    return sum(ours and not theirs for ours, theirs in found), sum(theirs and not ours for ours, theirs in found)


def _ours(drive: Drive) -> _Passed:
    gap = gap_of(drive.status, drive.failure_code)
    if gap is None:
        return _Passed(worst=bool(drive.success), best=bool(drive.success))
    return _Passed(worst=False, best=ASSUMED["noWorseThan"][gap].blame == "best")


def _theirs(drive: Drive) -> _Passed:
    gap = gap_of(drive.status, drive.failure_code)
    if gap is None:
        return _Passed(worst=bool(drive.success), best=bool(drive.success))
    assumed = ASSUMED["other version"][gap]
    return _Passed(worst=assumed.proof == "worst", best=assumed.blame != "best")
