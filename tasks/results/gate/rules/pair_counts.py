"""Counts how two versions compare on the episodes that both were asked for, whatever is missing of either.

An episode that the other version was never asked for is no pair: its plan said so before anything ran. One that it was
asked for and did not end is one, and the table of missing data says what it counts as.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from specs.base import Spec
from tasks.results.gate.missing_data import ASSUMED, gap_of
from tasks.results.statistics.pairs import Drive, Drives


class _Passed(NamedTuple):
    """Whether an episode passed, at the worst and at the best for the tested version."""

    worst: bool
    best: bool

    def is_known(self) -> bool:
        """Returns whether the two are the same."""
        return self.worst == self.best


class WorldPairs(Spec):
    """The pairs of one world, as a PASS and as a FAIL take them.

    Attributes:
        canceled: Pairs whose episode of the new version was canceled; in none of the other numbers.
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
    canceled: int = 0

    def unknown(self) -> int:
        """Returns how far the worst and the best are apart."""
        return self.gains_at_best - self.gains + self.losses - self.losses_at_best + 2 * self.canceled


class PairCounts(Spec):
    """What two versions came to on the same episodes.

    Attributes:
        n: Pairs whose ends are both known.
        gains: How many of them the new version passed and the other did not.
        losses: How many the other version passed and the new one did not.
        unpaired: Episodes of the new version that the other was not asked for.
        unknown: Pairs of which an end is not known; the new version's episode was not canceled.
        worlds: All pairs, by world.
    """

    n: int
    gains: int
    losses: int
    unpaired: int
    unknown: int = 0
    worlds: tuple[WorldPairs, ...] = ()

    def driven_worlds(self) -> int:
        """Returns in how many worlds there are pairs that came to an end."""
        return sum(world.n > 0 for world in self.worlds)

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
        return _sum(self.worlds)

    def plus(self, more: "PairCounts") -> "PairCounts":
        """Returns the pairs of both, as if they were of one world."""
        counts = {name: getattr(self, name) + getattr(more, name) for name in _COUNTS}
        return PairCounts(**counts, worlds=(_sum([self.total(), more.total()]),))


_COUNTS = ("n", "gains", "losses", "unpaired", "unknown")


def _sum(worlds: Iterable[WorldPairs]) -> WorldPairs:
    found = list(worlds)
    return WorldPairs(**{name: sum(getattr(each, name) for each in found) for name in WorldPairs.model_fields})


def count_pairs(new: Drives, other: Drives) -> PairCounts:
    """Returns how the new version compares with another one on the episodes that both were asked for."""
    asked = [(each, other[key]) for key, each in new.items() if key in other]
    pairs = [(_ours(ours), _theirs(theirs)) for ours, theirs in asked if ours.success is not None]
    known = [(ours.worst, theirs.worst) for ours, theirs in pairs if ours.is_known() and theirs.is_known()]
    gains, losses = _disagreements(known)
    by_world: dict[str, list[tuple[Drive, Drive]]] = {}
    for ours, theirs in asked:
        by_world.setdefault(ours.world, []).append((ours, theirs))
    return PairCounts(
        n=len(known),
        gains=gains,
        losses=losses,
        unpaired=sum(each.success is not None and key not in other for key, each in new.items()),
        unknown=len(pairs) - len(known),
        worlds=tuple(_of_world(by_world[world]) for world in sorted(by_world)),
    )


def _of_world(asked: Sequence[tuple[Drive, Drive]]) -> WorldPairs:
    ends = [(_ours(ours), _theirs(theirs)) for ours, theirs in asked if ours.success is not None]
    gains, losses = _disagreements((ours.worst, theirs.worst) for ours, theirs in ends)
    at_best = _disagreements((ours.best, theirs.best) for ours, theirs in ends)
    return WorldPairs(
        n=len(ends),
        gains=gains,
        losses=losses,
        gains_at_best=at_best[0],
        losses_at_best=at_best[1],
        canceled=len(asked) - len(ends),
    )


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
