"""How much of the worlds a batch's episodes were in: rooms entered, rooms out of reach, and goals that can be reached.

A success rate says nothing about rooms in which no robot was: a batch may pass in the one room that shut doors leave.
"""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np
from jaxtyping import Int

from specs.base import Spec
from specs.data.episode import success
from specs.data.episode_columns import Cells, EpisodeColumns, RequestColumns, distinct_cells

if TYPE_CHECKING:
    import pyarrow as pa  # a run's report reads figures, and must not wait for Arrow

ROOM_COLUMNS = (
    "world",
    "success",
    "rooms_total",
    "rooms_entered",
    "rooms_unreachable",
    "goals_total",
    "goals_reachable",
)
"""The columns of ``results.parquet`` that `table_coverage` needs."""
MOST_WORLDS = 24
_ROOMS_NAMED, _WORLDS_NAMED = 6, 3


class RoomRow(NamedTuple):
    """What an episode says of rooms, as the columns of the results do."""

    world: str
    success: bool | None
    rooms_total: int
    rooms_entered: Iterable[str]
    rooms_unreachable: Iterable[str]
    goals_total: int
    goals_reachable: int | None


class WorldCoverage(Spec):
    """The rooms of one world.

    Attributes:
        rooms: How many it has.
        entered: Those that a robot was in.
        unreachable: Those that no robot was in, and that one could not get to.
    """

    world: str
    rooms: int
    entered: tuple[str, ...]
    unreachable: tuple[str, ...]


class RoomCoverage(Spec):
    """The rooms of all worlds of a batch, and its goals.

    Attributes:
        worlds: How many worlds there are.
        rooms: How many rooms they have.
        entered: How many of these a robot was in.
        unreachable: How many no robot was in because none could get to them, as doors stand.
        passed: Episodes that passed.
        passed_in_one_room: Those of them whose robot was in one room alone, of a world that has several.
        goals: How many goals episodes had that are destinations.
        goals_reachable: How many of these a robot could get to.
        lacking: Worlds with rooms that no robot was in, those that lack most first, at most 24.
    """

    worlds: int
    rooms: int
    entered: int
    unreachable: int
    passed: int
    passed_in_one_room: int
    goals: int
    goals_reachable: int
    lacking: tuple[WorldCoverage, ...] = ()


class RoomTally:
    """Counts rooms as episodes come; what it holds grows with worlds and not with episodes."""

    def __init__(self) -> None:
        """Begins to count."""
        self._rooms: dict[str, int] = {}
        self._entered: dict[str, set[str]] = {}
        self._unreachable: dict[str, set[str]] = {}
        self._passed = self._in_one_room = self._goals = self._goals_reachable = 0

    def add(self, row: RoomRow) -> None:
        """Counts an episode; one that did not start, or was stopped, says nothing."""
        if not row.rooms_total:
            return
        entered = set(row.rooms_entered)
        self._rooms[row.world] = row.rooms_total
        self._entered.setdefault(row.world, set()).update(entered)
        self._unreachable.setdefault(row.world, set()).update(row.rooms_unreachable)
        if row.success:
            self._passed += 1
            self._in_one_room += row.rooms_total > 1 and len(entered) < 2
        if row.goals_reachable is not None:
            self._goals += row.goals_total
            self._goals_reachable += row.goals_reachable

    def add_columns(self, asked: RequestColumns, answered: EpisodeColumns) -> None:
        """Counts episodes that come as columns, request and result of each in the same row."""
        rows = np.flatnonzero(answered.numbers("rooms_total"))
        worlds, totals = asked.worlds.take(rows), answered.numbers("rooms_total")[rows]
        codes = cast("np.ndarray", worlds.codes)
        for row in distinct_cells([codes, totals.astype(np.int64)])[0] if len(rows) else ():
            self._rooms.setdefault(str(worlds.labels[codes[row]]), int(totals[row]))
        entered = _room_names(self._entered, worlds, answered.cells["rooms_entered"].take(rows))
        _room_names(self._unreachable, worlds, answered.cells["rooms_unreachable"].take(rows))
        ways, ways_of = answered.endings
        passed = np.array([success(way) is True for way in ways], np.bool_)[ways_of[rows]]
        self._passed += int(passed.sum())
        self._in_one_room += int((passed & (totals > 1) & (entered < 2)).sum())
        goals = answered.cells["goals_reachable"].take(rows)
        known = np.ones(len(rows), np.bool_) if goals.there is None else goals.there
        self._goals += int(answered.numbers("goals_total")[rows][known].sum())
        self._goals_reachable += int(cast("np.ndarray", goals.numbers)[known].sum())

    def coverage(self) -> RoomCoverage | None:
        """Returns what was counted; None if no episode said anything of rooms."""
        if not self._rooms:
            return None
        worlds = [self._world(name) for name in self._rooms]
        lacking = sorted((each for each in worlds if len(each.entered) < each.rooms), key=_missing, reverse=True)
        return RoomCoverage(
            worlds=len(worlds),
            rooms=sum(each.rooms for each in worlds),
            entered=sum(len(each.entered) for each in worlds),
            unreachable=sum(len(each.unreachable) for each in worlds),
            passed=self._passed,
            passed_in_one_room=self._in_one_room,
            goals=self._goals,
            goals_reachable=self._goals_reachable,
            lacking=tuple(lacking[:MOST_WORLDS]),
        )

    def _world(self, name: str) -> WorldCoverage:
        entered = self._entered[name]
        return WorldCoverage(
            world=name,
            rooms=self._rooms[name],
            entered=tuple(sorted(entered)),
            unreachable=tuple(sorted(self._unreachable[name] - entered)),
        )


def _room_names(found: dict[str, set[str]], worlds: Cells, rooms: Cells) -> Int[np.ndarray, " rows"]:
    """Adds the rooms that episodes name to those of their worlds; returns how many each episode names."""
    world_of, codes = cast("np.ndarray", worlds.codes), cast("np.ndarray", rooms.codes)
    for world in np.unique(world_of).tolist():
        found.setdefault(str(worlds.labels[world]), set())
    rows = np.repeat(np.arange(len(world_of)), cast("np.ndarray", rooms.lengths))
    of_world, of_row = (distinct_cells([each, codes])[0] for each in (world_of[rows], rows))
    for entry in of_world:
        found[str(worlds.labels[world_of[rows[entry]]])].add(str(rooms.labels[codes[entry]]))
    return np.bincount(rows[of_row], minlength=len(world_of))


def table_coverage(rows: "pa.Table") -> RoomCoverage | None:
    """Returns the coverage of the rows of ``results.parquet``; None if no episode started."""
    tally = RoomTally()
    for values in zip(*(rows.column(name).to_pylist() for name in ROOM_COLUMNS), strict=True):
        tally.add(RoomRow(*values))
    return tally.coverage()


def coverage_line(found: RoomCoverage) -> str:
    """Returns how many rooms a robot was in, and how many goals it could get to, in a line."""
    worlds = "" if found.worlds == 1 else f" in {found.worlds:,} worlds"
    line = f"rooms entered: {found.entered:,} of {found.rooms:,}{worlds}"
    if not found.goals:
        return line
    return f"{line}; goals within reach: {found.goals_reachable:,} of {found.goals:,} ({goals_share(found)})"


def goals_share(found: RoomCoverage) -> str:
    """Returns the share of goals that a robot could get to; only all of them are 100 %."""
    if found.goals_reachable == found.goals:
        return "100 %"
    return f"{min(99.9, 100 * found.goals_reachable / found.goals):.1f} %"


def coverage_warnings(found: RoomCoverage) -> list[str]:
    """Returns what keeps a verdict from being about the whole of its worlds, a sentence each."""
    warnings: list[str] = []
    if found.unreachable:
        where = _unreachable_text([each for each in found.lacking if each.unreachable])
        warnings.append(
            f"The robot cannot get to {found.unreachable:,} of {found.rooms:,} rooms, with doors as they are set and "
            f"its hull's radius: {where}. No episode says anything about them: open their doors in the template, or "
            "take a narrower robot."
        )
    if found.passed and found.passed_in_one_room == found.passed:
        warnings.append(
            f"All {found.passed:,} episodes that passed stayed in one room: nothing says that the robot gets through a "
            "door."
        )
    if found.goals_reachable < found.goals:
        away = found.goals - found.goals_reachable
        warnings.append(
            f"The robot cannot get to {away:,} of {found.goals:,} goals that the scenario drew: no controller can pass "
            "these episodes."
        )
    return warnings


def _missing(world: WorldCoverage) -> tuple[int, int]:
    return len(world.unreachable), world.rooms - len(world.entered)


def _unreachable_text(worlds: Sequence[WorldCoverage]) -> str:
    """Returns which rooms are out of reach, in the first worlds."""
    named = [f"{_first(each.unreachable, _ROOMS_NAMED)} in {each.world}" for each in worlds]
    return _first(named, _WORLDS_NAMED, between="; ")


def _first(names: Sequence[str], most: int, between: str = ", ") -> str:
    more = f"{between}and more" if len(names) > most else ""
    return between.join(names[:most]) + more
