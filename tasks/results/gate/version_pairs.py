"""Tells which episodes of two versions are the same, and how the versions compare on them.

An episode that the other version was never asked for is no pair: its plan said so before anything ran. One that it was
asked for and did not end is one, and the table of missing data says what it counts as.
"""

from collections import Counter
from collections.abc import Hashable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

from specs.base import Spec
from tasks.results.gate.missing_data import ASSUMED, gap_of

if TYPE_CHECKING:
    import pyarrow as pa

_SAME_DRIVE = ("simulation_digest", "simulation_package", "simulation_launch_file", "duration_s")
_ASKED = ("world", "seed", "environment")
_ENDED = ("status", "failure_code", "success")
PAIRED_COLUMNS = (*_ASKED, *_SAME_DRIVE, "robot_digest", *_ENDED)


class Drive(NamedTuple):
    """What an episode came to.

    Attributes:
        world: What tells its world apart.
        success: Whether it passed; None for one that was canceled.
        status: RoboMaker's job status.
        failure_code: RoboMaker's failure code, or empty.
    """

    world: str
    success: bool | None
    status: str
    failure_code: str


Drives = Mapping[Hashable, Drive]


def episode_keys(table: "pa.Table", worlds: Mapping[str, str], columns: Sequence[str]) -> list[Hashable]:
    """Returns what makes each row the same episode as a row of another table: world, seed, variables, and columns.

    Equal requests of one table are told apart by their turn.

    Args:
        table: Rows in the order of their indices.
        worlds: What tells worlds apart, by ``<generation>/<world>``; those that it does not have go by their names.
        columns: What else makes an episode the same.
    """
    turns, keys = Counter[Hashable](), list[Hashable]()
    for row in table.select([*_ASKED, *columns]).to_pylist():
        world = worlds.get(row["world"], row["world"])
        asked = (world, row["seed"], tuple(sorted(row["environment"])), *(row[name] for name in columns))
        turns[asked] += 1
        keys.append((asked, turns[asked]))
    return keys


def drives(table: "pa.Table", worlds: Mapping[str, str], digests: Iterable[str]) -> dict[Hashable, Drive]:
    """Returns what episodes came to, by what was asked of them but for the robot application.

    World, seed, scenario, variables and duration make the same episode; a world by what is in it, not by its name, so
    that worlds that were generated again are the same ones.

    Args:
        table: Rows with the columns ``PAIRED_COLUMNS``, in the order of their indices.
        worlds: What tells worlds apart, by ``<generation>/<world>``.
        digests: Robot applications whose episodes are meant.
    """
    import pyarrow.compute as pc  # noqa: PLC0415 - `simyard plan` counts pairs without Arrow

    meant = table.filter(pc.field("robot_digest").isin(list(digests)))
    names, ended = meant.column("world").to_pylist(), meant.select(_ENDED).to_pylist()
    keys = episode_keys(meant, worlds, _SAME_DRIVE)
    return {
        key: Drive(worlds.get(name, name), row["success"], row["status"], row["failure_code"])
        for key, name, row in zip(keys, names, ended, strict=True)
    }


def both_ended(new: Drives, other: Drives) -> bool:
    """Returns whether there is an episode that both versions drove to an end."""
    return any(key in other and None not in {each.success, other[key].success} for key, each in new.items())


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
