"""Counts how a batch's episodes ended: in all, by world and by swept value, and why they did not pass.

It is the one place for the tables, the gate, the report and what is printed.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple, Self, cast

import numpy as np

from specs.base import Spec
from specs.data.episode import EpisodeRequest, EpisodeResult, reason, success
from specs.data.episode_columns import EpisodeColumns, RequestColumns, distinct_cells, pair_columns
from tasks.results.statistics.intervals import Interval, IntervalFamily, in_worlds, percent, percent_range, share_alone
from tasks.results.statistics.room_coverage import RoomCoverage, RoomTally


class EpisodeCounts(Spec):
    """How many of a batch's episodes came to what.

    Attributes:
        episodes: How many were counted; canceled ones are not.
        successes: How many of them passed.
        failed_jobs: How many of them have a failure code instead of an outcome to rely on.
        canceled: How many were canceled.
    """

    episodes: int
    successes: int
    failed_jobs: int
    canceled: int


class Ending(NamedTuple):
    """How an episode ended, as far as it is counted.

    Attributes:
        success: Whether it passed; None for one that was canceled.
        failed_job: Whether the job itself failed.
        reason: Why it did not pass, or empty.
    """

    success: bool | None
    failed_job: bool
    reason: str = ""


def ending_of(result: EpisodeResult) -> Ending:
    """Returns how an episode ended."""
    return Ending(success(result), result.status == "Failed", reason(result))


def count_endings(endings: Mapping[Ending, int]) -> EpisodeCounts:
    """Returns what episodes come to; each ending has the number of episodes that ended so."""
    canceled = sum(count for each, count in endings.items() if each.success is None)
    return EpisodeCounts(
        episodes=sum(endings.values()) - canceled,
        successes=sum(count for each, count in endings.items() if each.success),
        failed_jobs=sum(count for each, count in endings.items() if each.failed_job),
        canceled=canceled,
    )


_NOT_SET = "(not set)"
_Counts = Counter[Ending]


class EpisodeGroup(Spec):
    """Some of a batch's episodes.

    Attributes:
        label: What they have in common.
        episodes: How many there are, canceled ones apart.
        successes: How many of them passed.
        canceled: How many more were canceled.
        interval: The interval of their success rate by itself (`share_alone`).
        reasons: Why the others did not pass, most frequent first, with counts.
    """

    label: str
    episodes: int
    successes: int
    canceled: int
    interval: Interval
    reasons: tuple[tuple[str, int], ...]

    @classmethod
    def of_counts(
        cls,
        label: str,
        counts: EpisodeCounts,
        confidence: float,
        reasons: Sequence[tuple[str, int]] = (),
        *,
        looks: int = 0,
    ) -> Self:
        """Returns a group of episodes that were counted.

        Args:
            label: What they have in common.
            counts: What they came to.
            confidence: Coverage of the interval.
            reasons: Why those that did not pass did not.
            looks: At how many looks the batch might have been ended; 0 of one that was driven to its end.
        """
        return cls(
            label=label,
            episodes=counts.episodes,
            successes=counts.successes,
            canceled=counts.canceled,
            interval=share_alone(counts.successes, counts.episodes, confidence, looks),
            reasons=tuple(reasons),
        )

    @property
    def rate(self) -> float | None:
        """Returns the share that passed, or None of no episodes."""
        return self.successes / self.episodes if self.episodes else None


class BatchSummary(Spec):
    """A batch in groups.

    Attributes:
        total: All episodes.
        by_world: By world, in the order in which the batch comes to them.
        by_variable: For each environment variable with more than one value: its name and a group a value, in that
            order too.
        confidence: Of the interval of all episodes, and of those of all groups together.
    """

    total: EpisodeGroup
    by_world: tuple[EpisodeGroup, ...]
    by_variable: tuple[tuple[str, tuple[EpisodeGroup, ...]], ...]
    confidence: float

    def groups(self) -> list[tuple[str, EpisodeGroup]]:
        """Returns the groups by world and by value, each with what its label needs before it."""
        by_world = [("", group) for group in self.by_world]
        return by_world + [(f"{name}=", group) for name, values in self.by_variable for group in values]

    def family(self) -> IntervalFamily:
        """Returns how many groups have episodes, and how sure the intervals of all of them are."""
        size = sum(bool(group.episodes) for _, group in self.groups())
        return IntervalFamily(size=size, confidence=self.confidence)


class EpisodeTally:
    """Counts of a batch's episodes, taken part by part; what it holds grows with groups and not with episodes."""

    def __init__(self, variables: Sequence[str] = ()) -> None:
        """Begins to count.

        Args:
            variables: Environment variables that have more than one value in the batch: each value is a group.
        """
        self.simulated_s = 0.0
        self._total: _Counts = Counter()
        self._worlds: dict[str, _Counts] = {}
        self._variables: dict[str, dict[str, _Counts]] = {name: {} for name in sorted(variables)}
        self._samples: dict[str, str] = {}
        self._engines: set[str] = set()
        self._devices: set[str] = set()
        self._rooms = RoomTally()

    def add(
        self, requests: Sequence[EpisodeRequest] | RequestColumns, results: Sequence[EpisodeResult] | EpisodeColumns
    ) -> None:
        """Counts episodes.

        Raises:
            ValueError: The requests and results do not pair up.
        """
        asked, answered = pair_columns(requests, results)
        if not len(asked):
            return
        # One after the other, so that the last bit does not depend on how the episodes come in parts.
        self.simulated_s = float(np.cumsum(np.append(self.simulated_s, answered.numbers("simulated_s")))[-1])
        self._engines.update(answered.labels("engine"))
        self._devices.update(answered.labels("device"))
        self._rooms.add_columns(asked, answered)
        self._count(asked, answered)

    def _count(self, asked: RequestColumns, answered: EpisodeColumns) -> None:
        """Counts how episodes ended, all that share a world, a launch and an ending at once."""
        ways, ways_of = answered.endings
        endings = [ending_of(way) for way in ways]
        worlds = cast("np.ndarray", asked.worlds.codes)
        first, alike = distinct_cells([ways_of, worlds, asked.launch])
        for row, count in zip(first, np.bincount(alike).tolist(), strict=True):
            ended, environment = endings[ways_of[row]], asked.launches[asked.launch[row]].environment
            self._total[ended] += count
            self._worlds.setdefault(str(asked.worlds.labels[worlds[row]]), Counter())[ended] += count
            for name, groups in self._variables.items():
                groups.setdefault(environment.get(name, _NOT_SET), Counter())[ended] += count
        for ended, way in zip(endings, ways, strict=True):
            if ended.success is False:
                self._samples.setdefault(ended.reason, way.failure_reason)

    def counts(self) -> EpisodeCounts:
        """Returns what a gate judges by."""
        return count_endings(self._total)

    def worlds(self) -> int:
        """Returns in how many worlds episodes came to an end."""
        return sum(any(ended.success is not None for ended in counts) for counts in self._worlds.values())

    def rooms(self) -> RoomCoverage | None:
        """Returns how much of its worlds the robots were in; None if no episode started."""
        return self._rooms.coverage()

    def ran_on(self) -> dict[str, str]:
        """Returns ``engine`` and ``device``, comma-separated where episodes differ; ``none`` if nothing ran."""
        return {"engine": _join_names(self._engines), "device": _join_names(self._devices)}

    def summary(self, confidence: float = 0.95) -> BatchSummary:
        """Returns the groups of the batch so far."""
        return BatchSummary(
            total=_group("all", self._total, confidence),
            by_world=_groups(self._worlds, confidence),
            by_variable=tuple((name, _groups(values, confidence)) for name, values in self._variables.items()),
            confidence=confidence,
        )

    def why_not(self) -> list[tuple[str, int, str]]:
        """Returns why episodes did not pass, most frequent first: the reason, how many, and what the first one says."""
        return [(name, count, self._samples[name]) for name, count in _reasons(self._total)]


def summary_rows(summary: BatchSummary) -> list[tuple[str, str, str, str, str]]:
    """Returns rows for a table: group, passed of episodes, rate, interval, reasons.

    The intervals of groups hold together; that of all episodes, in the first row, is of no family.
    """
    family = summary.family()
    rows = [_row("", summary.total, summary.total.interval)]
    return rows + [
        _row(prefix, group, family.interval(group.successes, group.episodes)) for prefix, group in summary.groups()
    ]


def summary_note(summary: BatchSummary) -> str:
    """Returns what the intervals of such a table are: of which worlds, how many, and how sure all of them are."""
    worlds = sum(bool(group.episodes) for group in summary.by_world)
    said = f"Rates {in_worlds(worlds)}, that of a world in it alone; {100 * summary.confidence:g} % intervals"
    return f"{said}. {summary.family().sentence('batches')}" if summary.family().size else said


def _join_names(names: set[str]) -> str:
    return ", ".join(sorted(name for name in names if name)) or "none"


def _reasons(counts: _Counts) -> list[tuple[str, int]]:
    reasons: Counter[str] = Counter()
    for ended, count in counts.items():
        if ended.success is False:
            reasons[ended.reason] += count
    return sorted(reasons.items(), key=lambda pair: (-pair[1], pair[0]))


def _groups(members: Mapping[str, _Counts], confidence: float) -> tuple[EpisodeGroup, ...]:
    return tuple(_group(label, counts, confidence) for label, counts in members.items())


def _group(label: str, counts: _Counts, confidence: float) -> EpisodeGroup:
    return EpisodeGroup.of_counts(label, count_endings(counts), confidence, _reasons(counts))


def _row(prefix: str, group: EpisodeGroup, sure: Interval) -> tuple[str, str, str, str, str]:
    counts = f"{group.successes}/{group.episodes}"
    rate = "-" if group.rate is None else percent(group.rate)
    reasons = [f"{count} {name}" for name, count in group.reasons]
    if group.canceled:
        reasons.append(f"{group.canceled} canceled")
    return f"{prefix}{group.label}", counts, rate, percent_range(sure), ", ".join(reasons)
