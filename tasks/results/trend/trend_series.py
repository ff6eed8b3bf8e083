"""A document's nights as series: all episodes, those in one world, those with one value of a variable.

A night is one batch of a document that ended; what is measured of each episode is whether it passed, whether it had no
collision, or a column's quantile. Each series is looked at for changes by itself. The false alarms that are allowed in
a year are shared: half of them are for all episodes together, the other half is shared equally by the other series. So
the mean number of false alarms of all series together is no larger than that of one series that has them all.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from jaxtyping import Bool, Float

from specs.base import Fault, Spec
from specs.data.episode import ApplicationLaunch
from specs.errors import DocumentError
from tasks.results.statistics.change_point import NIGHTS_A_YEAR, Change, NightCount, find_changes
from tasks.results.statistics.intervals import in_worlds, wilson_bounds
from tasks.results.tables.history_rows import COLLISION, SUCCESS, Cell, measure_column

_ALLOWED = "success, collision, or a column and a quantile, such as simulated_s:0.95 or metrics.waiting_s:0.5"


class Measure(Spec):
    """What is measured.

    Attributes:
        column: ``success``, ``collision``, a column, or ``metrics.<name>``.
        quantile: Of the column, or None for the first two, which are shares.
    """

    column: str = SUCCESS
    quantile: float | None = None

    def words(self, at_most: float | None = None) -> str:
        """Returns what the rate is the share of; ``at_most`` is the value that a quantile is compared with."""
        if self.quantile is None:
            return "Success rate" if self.column == SUCCESS else "Episodes without a collision"
        return f"Episodes with {self.column} at most {at_most:.4g}"


def parse_measure(text: str) -> Measure:
    """Returns the measure that a text names.

    Raises:
        DocumentError: It names none.
    """
    column, colon, quantile = text.rpartition(":")
    if not colon and text in {SUCCESS, COLLISION}:
        return Measure(column=text)
    try:
        value = float(quantile)
    except ValueError:
        value = 0.0
    if not (0.0 < value < 1.0) or column in {SUCCESS, COLLISION} or not measure_column(column):
        raise DocumentError.of("--measure", repr(text), _ALLOWED, source="simyard")
    return Measure(column=column, quantile=value)


def usual_value(nights: Sequence[Float[np.ndarray, " rows"]], quantile: float) -> float:
    """Returns what a quantile usually is: the median of the nights' own; NaN where nothing was measured.

    Args:
        nights: The values of each night's episodes; NaN where nothing was measured.
        quantile: Between 0 and 1.
    """
    measured = [values[~np.isnan(values)] for values in nights]
    own = [float(np.quantile(values, quantile)) for values in measured if len(values)]
    return float(np.median(own)) if own else float("nan")


def is_good(values: Float[np.ndarray, " rows"], at_most: float | None) -> Bool[np.ndarray, " rows"]:
    """Returns in which episodes all was well: it passed, had no collision, or stayed at the usual value or below."""
    return values > 0.5 if at_most is None else values <= at_most


class Night(Spec):
    """One batch of a document that ended.

    Attributes:
        run: Id of the document's run.
        request: Digest of all that decides what its batch drives: with the same one, the same episodes are driven.
        worlds_made: What decides the worlds that the run itself generates, as a digest.
        generation: The generation that these lie in; empty if the run makes none.
        batch: The batch's id; empty where the run has none.
        arn: Its ARN.
        begun_at_s: Seconds since 1970.
        robots: The robot applications that were tested, each once.
        variables: Names of the environment variables that have several values.
        cells: Its episodes; nothing if the night is left out.
        left_out: Why it does not count, or empty.
        authentic: Whether its results carry the seal of this machine's key.
        early: Whether it ended early, its gate being certain.
        more_generations: The others, where several jobs made them.
        page: Where its report lies, as seen from the trend's page; empty if there is none.
    """

    run: str
    request: str
    worlds_made: str
    generation: str
    batch: str
    arn: str
    begun_at_s: float
    robots: tuple[ApplicationLaunch, ...] = ()
    variables: tuple[str, ...] = ()
    cells: tuple[Cell, ...] = ()
    left_out: str = ""
    authentic: bool = False
    early: bool = False
    more_generations: tuple[str, ...] = ()
    page: str = ""

    def generations(self) -> tuple[str, ...]:
        """Returns the generations that the run's own worlds lie in."""
        return (self.generation, *self.more_generations)

    def bundle_names(self) -> str:
        """Returns the versions that were tested, with the beginning of each one's digest."""
        return ", ".join(f"{each.name} {each.version} ({each.digest[:12]})" for each in self.robots)

    def bundles(self) -> frozenset[str]:
        """Returns the digests of the robot applications that were tested."""
        return frozenset(each.digest for each in self.robots)


# More small pictures nobody compares, and each takes from the others' share of the false alarms.
MOST_SERIES = 24
CONFIDENCE = 0.95
WHOLE = "All episodes"
# Each with its world's identity: of worlds that are generated anew, the template's and not the generation's.
_Cells = Sequence[tuple[str, Cell]]


@dataclass(frozen=True)
class Choice:
    """Which episodes are looked at; all where nothing is said.

    Attributes:
        world: Name of a world, with or without its generation.
        version: Version of the robot application, or the beginning of its digest.
        variables: Values of environment variables.
    """

    world: str = ""
    version: str = ""
    variables: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Point:
    """A night of a series: its count, and the bounds of its rate in its own worlds; no episodes, no rate."""

    count: NightCount
    lower: float
    upper: float
    repeats: bool
    worlds: frozenset[str]

    @property
    def rate(self) -> float:
        """The rate."""
        return self.count.successes / self.count.n


@dataclass(frozen=True)
class Series:
    """One row of nights.

    Attributes:
        kind: What sets it apart: ``all``, ``world``, or a variable's name.
        label: What it is called.
        points: One a night; None where it has no episodes.
        changes: The changes that were seen.
        limit: How many nights without a change there are, in the mean, until a false alarm of this series alone.
    """

    kind: str
    label: str
    points: tuple[Point | None, ...]
    changes: tuple[Change, ...]
    limit: float


@dataclass(frozen=True)
class Trend:
    """All series of a document's nights.

    Attributes:
        nights: The nights, the oldest first, those that do not count among them.
        series: All episodes first.
        left_out: How many series are not looked at.
    """

    nights: tuple[Night, ...]
    series: tuple[Series, ...]
    left_out: int

    def alarms(self) -> list[tuple[Series, Change]]:
        """Returns all alarms, the newest first, and those of all episodes before those of some.

        Where all episodes changed, some of them do so, too: that is no alarm of its own unless it was seen before.
        """
        whole = self.series[0].changes
        found = [(self.series[0], change) for change in whole]
        for each in self.series[1:]:
            found += [(each, change) for change in each.changes if not any(_is_part(change, of) for of in whole)]
        return sorted(found, key=lambda alarm: -alarm[1].seen)


def make_trend(nights: Sequence[Night], choice: Choice, nights_a_false_alarm: float = NIGHTS_A_YEAR) -> Trend:
    """Returns the series of some nights.

    Args:
        nights: The oldest first.
        choice: Which episodes are looked at.
        nights_a_false_alarm: How many nights without a change there are, in the mean, until a false alarm.

    Raises:
        DocumentError: No episode was chosen, though there are nights.
    """
    cells = [_identified(night) for night in nights]
    if choice != Choice():
        pairs = zip(nights, cells, strict=True)
        cells = [[pair for pair in some if _is_chosen(night, pair[1], choice)] for night, some in pairs]
    if any(night.cells for night in nights) and not any(cells):
        raise _none_chosen(nights, choice)
    repeats = _repeats(nights)
    groups = _groups(nights, cells)
    kept, rest = list(groups)[:MOST_SERIES], list(groups)[MOST_SERIES:]
    share = 2.0 if kept else 1.0
    series = [_series(("all", WHOLE), cells, repeats, nights_a_false_alarm * share)]
    for key in kept:
        limit = nights_a_false_alarm * share * len(kept)
        series.append(_series(key, groups[key], repeats, limit))
    return Trend(tuple(nights), tuple(series), len(rest))


def raised_alarms(trend: Trend, choice: Choice, run: str) -> list[tuple[Series, Change]]:
    """Returns the alarms that a run's night has raised.

    Those are the ones that are seen at its end; and those that are seen at a night that began later, though it ended
    before, if nobody could see them then.

    Args:
        trend: With the night.
        choice: Which episodes the trend looks at.
        run: Id of the run.
    """
    at = next((at for at, night in enumerate(trend.nights) if night.run == run), len(trend.nights))
    raised = [alarm for alarm in trend.alarms() if alarm[1].seen >= at]
    if all(change.seen == at for _, change in raised):
        return raised
    others = [night.model_copy(update={"cells": ()}) if night.run == run else night for night in trend.nights]
    known = make_trend(others, choice).alarms()
    return [
        (each, change)
        for each, change in raised
        if change.seen == at
        or not any((of.kind, of.label) == (each.kind, each.label) and _is_part(change, told) for of, told in known)
    ]


def world_name(night: Night, world: str) -> str:
    """Returns what a world is called on all nights: without the generation, where the run itself made it."""
    generation, _, name = world.partition("/")
    return name if generation in night.generations() else world


def _is_part(change: Change, whole: Change) -> bool:
    overlap = change.earliest <= whole.latest and whole.earliest <= change.latest
    return overlap and change.fell == whole.fell and change.seen >= whole.seen


def _repeats(nights: Sequence[Night]) -> list[bool]:
    """Returns which nights drove what an earlier one drove: the same bits come of it, so that they say nothing new."""
    seen: set[str] = set()
    found: list[bool] = []
    for night in nights:
        counts = not night.left_out
        found.append(counts and night.request in seen)
        seen |= {night.request} if counts else set()
    return found


def _identified(night: Night) -> _Cells:
    found: list[tuple[str, Cell]] = []
    for cell in night.cells:
        generation, _, name = cell.world.partition("/")
        found.append((f"{night.worlds_made}/{name}" if generation in night.generations() else cell.world, cell))
    return found


def _is_chosen(night: Night, cell: Cell, choice: Choice) -> bool:
    values = dict(zip(night.variables, cell.variables, strict=True))
    versions = {each.version for each in night.robots if each.digest == cell.bundle}
    return (
        (not choice.world or choice.world in {cell.world, world_name(night, cell.world)})
        and (not choice.version or choice.version in versions or cell.bundle.startswith(choice.version))
        and all(values.get(name) == value for name, value in choice.variables)
    )


def _groups(nights: Sequence[Night], cells: Sequence[_Cells]) -> dict[tuple[str, str], list[_Cells]]:
    """Returns the episodes of each world that comes on several nights, and of each value, by kind and label."""
    found: dict[tuple[str, str], dict[int, list[tuple[str, Cell]]]] = {}
    labels: dict[str, str] = {}
    for at, (night, some) in enumerate(zip(nights, cells, strict=True)):
        for pair in some:
            identity, cell = pair
            labels[identity] = world_name(night, cell.world)
            for key in (("", identity), *zip(night.variables, cell.variables, strict=True)):
                found.setdefault(key, {}).setdefault(at, []).append(pair)
    several = [key for key, row in found.items() if not key[0] and len(row) > 1]
    named = _named([labels[identity] for _, identity in several])
    keys = [(("world", name), key) for name, key in zip(named, several, strict=True)]
    keys = keys if len(keys) > 1 else []  # a single world is all episodes
    keys += [(key, key) for key in sorted(found) if key[0]]
    return {key: [found[of].get(at, ()) for at in range(len(nights))] for key, of in keys}


def _named(labels: Iterable[str]) -> list[str]:
    """Returns names, of which no two are the same: worlds of other templates may have the same one."""
    seen: Counter[str] = Counter()
    found: list[str] = []
    for label in labels:
        seen[label] += 1
        found.append(label if seen[label] == 1 else f"{label} ({seen[label]})")
    return found


def _series(key: tuple[str, str], cells: Sequence[_Cells], repeats: Sequence[bool], limit: float) -> Series:
    counts = _counts(cells)
    fresh = [NightCount(0, 0) if repeat else count for count, repeat in zip(counts, repeats, strict=True)]
    return Series(*key, _points(counts, repeats, cells), tuple(find_changes(fresh, limit)), limit)


def _counts(cells: Sequence[_Cells]) -> list[NightCount]:
    found: list[NightCount] = []
    before: frozenset[str] = frozenset()
    for some in cells:
        worlds: dict[str, list[int]] = {}
        for identity, cell in some:
            tally = worlds.setdefault(identity, [0, 0])
            tally[0] += cell.successes
            tally[1] += cell.n
        found.append(_night_count(worlds, before))
        before = frozenset(worlds) or before
    return found


def _night_count(worlds: Mapping[str, Sequence[int]], before: frozenset[str]) -> NightCount:
    successes, n = (sum(tally[at] for tally in worlds.values()) for at in (0, 1))
    new = [tally for world, tally in worlds.items() if world not in before and tally[1]]
    if len(new) < 2:
        return NightCount(successes, n)
    rate = sum(tally[0] for tally in new) / sum(tally[1] for tally in new)
    scatter = sum((tally[0] - tally[1] * rate) ** 2 / tally[1] for tally in new)
    return NightCount(successes, n, scatter, len(new) - 1)


def _points(counts: Sequence[NightCount], repeats: Sequence[bool], cells: Sequence[_Cells]) -> tuple[Point | None, ...]:
    successes, n = (np.array([count[at] for count in counts], np.float64) for at in (0, 1))
    lower, upper = wilson_bounds(successes, np.maximum(n, 1.0), CONFIDENCE)
    worlds = [frozenset(identity for identity, cell in some if cell.n) for some in cells]
    return tuple(
        Point(count, float(lower[at]), float(upper[at]), repeats[at], worlds[at]) if count.n else None
        for at, count in enumerate(counts)
    )


def _none_chosen(nights: Sequence[Night], choice: Choice) -> DocumentError:
    cells = [(night, cell) for night in nights for cell in night.cells]
    known = {
        "--world": {world_name(night, cell.world) for night, cell in cells},
        "--version": {robot.version for night in nights for robot in night.robots},
        "--variable": {
            f"{name}={value}"
            for night, cell in cells
            for name, value in zip(night.variables, cell.variables, strict=True)
        },
    }
    asked = [("--world", choice.world), ("--version", choice.version)]
    asked += [("--variable", f"{name}={value}") for name, value in choice.variables]
    faults = [
        Fault(path=option, value=repr(value), allowed=f"one of {', '.join(sorted(known[option])[:20]) or '(none)'}")
        for option, value in asked
        if value and value not in known[option]
    ]
    together = "a world, a version and values that some episode had together"
    return DocumentError(faults or [Fault(path="trend", value="no episode", allowed=together)], source="simyard")


def day(seconds: float) -> str:
    """Returns the day of a time, in UTC."""
    return datetime.fromtimestamp(seconds, tz=UTC).strftime("%Y-%m-%d")


def night_times(nights: Sequence[Night]) -> dict[float, str]:
    """Returns what each night is called, by its begin: its day, with hour and minute if that day has several."""
    days = [day(night.begun_at_s) for night in nights]
    several = {each for each, count in Counter(days).items() if count > 1}
    return {
        night.begun_at_s: f"{each} {_clock(night.begun_at_s)}" if each in several else each
        for night, each in zip(nights, days, strict=True)
    }


def _clock(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, tz=UTC).strftime("%H:%M")


def night_text(night: Night, point: Point | None) -> str:
    """Returns a night in one line."""
    if point is None:
        return f"{day(night.begun_at_s)}: {night.left_out or 'no episode'}"
    where = in_worlds(len(point.worlds))
    rate = f"{100 * point.rate:.1f} % ({100 * point.lower:.1f} to {100 * point.upper:.1f}) {where}"
    said = (("drove the same as before", point.repeats), ("ended early", night.early))
    notes = [note for note, there in said if there]
    counts = f"{point.count.successes:,} of {point.count.n:,}"
    return "; ".join([f"{day(night.begun_at_s)}: {rate}, {counts}", night.bundle_names(), *notes])
