"""What a person wants to see of a batch: how often it went well, by world and by swept value, and why not."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence

from specs.base import Spec
from specs.episode import EpisodeRequest, EpisodeResult
from tasks.results.statistics import Interval, wilson
from tasks.results.success import paired, reason, success

_Episode = tuple[EpisodeRequest, EpisodeResult]


class Group(Spec):
    """Some of a batch's episodes.

    Attributes:
        label: What they have in common.
        episodes: How many there are, canceled ones apart.
        successes: How many of them passed.
        canceled: How many more were canceled.
        interval: Wilson interval of their success rate.
        reasons: Why the others did not pass, most frequent first, with counts.
    """

    label: str
    episodes: int
    successes: int
    canceled: int
    interval: Interval
    reasons: tuple[tuple[str, int], ...]

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
    """

    total: Group
    by_world: tuple[Group, ...]
    by_variable: tuple[tuple[str, tuple[Group, ...]], ...]


def summarise(
    requests: Sequence[EpisodeRequest], results: Sequence[EpisodeResult], *, confidence: float = 0.95
) -> BatchSummary:
    """Returns the groups of a batch.

    Raises:
        ValueError: The requests and results do not pair up.
    """
    episodes = paired(requests, results)
    variables = sorted({name for request in requests for name in request.environment})
    swept = [name for name in variables if len({request.environment.get(name) for request in requests}) > 1]
    return BatchSummary(
        total=_group("all", episodes, confidence),
        by_world=_groups(episodes, lambda request: request.world, confidence),
        by_variable=tuple((name, _groups(episodes, _valued(name), confidence)) for name in swept),
    )


def summary_rows(summary: BatchSummary) -> list[tuple[str, str, str, str, str]]:
    """Returns rows for a table: group, passed of episodes, rate, interval, reasons."""
    groups = [("", summary.total), *(("", group) for group in summary.by_world)]
    groups += [(f"{name}=", group) for name, values in summary.by_variable for group in values]
    return [_row(prefix, group) for prefix, group in groups]


def why_not(results: Sequence[EpisodeResult]) -> list[tuple[str, int, str]]:
    """Returns why episodes did not pass, most frequent first: the reason, how many, and what one of them says."""
    failed = [result for result in results if success(result) is False]
    counts = Counter(reason(result) for result in failed)
    samples = {reason(result): result.failure_reason for result in reversed(failed)}
    return [
        (name, count, samples[name]) for name, count in sorted(counts.items(), key=lambda pair: (-pair[1], pair[0]))
    ]


def summary_text(summary: BatchSummary) -> str:
    """Returns the rows of `summary_rows` under headings, aligned, for a terminal without colours or for a log."""
    rows = [("episodes", "passed", "rate", "interval", "why not"), *summary_rows(summary)]
    widths = [max(len(row[column]) for row in rows) for column in range(5)]
    lines = ("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows)
    return "\n".join(lines)


def _valued(name: str) -> Callable[[EpisodeRequest], str]:
    return lambda request: request.environment.get(name, "(not set)")


def _groups(
    episodes: Iterable[_Episode], label: Callable[[EpisodeRequest], str], confidence: float
) -> tuple[Group, ...]:
    members: dict[str, list[_Episode]] = {}
    for episode in episodes:
        members.setdefault(label(episode[0]), []).append(episode)
    return tuple(_group(name, members[name], confidence) for name in members)


def _group(label: str, episodes: Sequence[_Episode], confidence: float) -> Group:
    answers = [success(result) for _, result in episodes]
    successes, canceled = answers.count(True), answers.count(None)
    reasons = Counter(reason(result) for _, result in episodes if success(result) is False)
    counted = len(answers) - canceled
    return Group(
        label=label,
        episodes=counted,
        successes=successes,
        canceled=canceled,
        interval=wilson(successes, counted, confidence),
        reasons=tuple(sorted(reasons.items(), key=lambda pair: (-pair[1], pair[0]))),
    )


def _row(prefix: str, group: Group) -> tuple[str, str, str, str, str]:
    rate = "-" if group.rate is None else f"{100 * group.rate:.1f} %"
    interval = f"{100 * group.interval.lower:.1f} - {100 * group.interval.upper:.1f} %"
    reasons = [f"{count} {name}" for name, count in group.reasons]
    if group.canceled:
        reasons.append(f"{group.canceled} canceled")
    return f"{prefix}{group.label}", f"{group.successes}/{group.episodes}", rate, interval, ", ".join(reasons)
