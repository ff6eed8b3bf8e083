"""Episodes counted by what they have in common."""

from collections.abc import Iterable

import numpy as np

from tasks.results.report.batch_columns import CANCELED, FAILED, PASSED, Episodes, Failures, Labels
from tasks.results.statistics.intervals import wilson
from tasks.results.statistics.summary import Group


def whole(episodes: Episodes, confidence: float) -> Group:
    """Returns all episodes as one group."""
    (group,) = counted(episodes, Labels(("all episodes",), np.zeros(len(episodes.outcome), np.int64)), confidence)
    return group


def counted(episodes: Episodes, labels: Labels, confidence: float) -> list[Group]:
    """Returns a group a label, in the labels' order, without their reasons.

    Args:
        episodes: The batch.
        labels: Which group each episode belongs to.
        confidence: Of the Wilson intervals.
    """
    counts = {kind: _count(labels, episodes.outcome == kind) for kind in (PASSED, FAILED, CANCELED)}
    return [
        Group(
            label=label,
            episodes=passed + failed,
            successes=passed,
            canceled=canceled,
            interval=wilson(passed, passed + failed, confidence),
            reasons=(),
        )
        for label, passed, failed, canceled in zip(
            labels.names, *(counts[kind] for kind in (PASSED, FAILED, CANCELED)), strict=True
        )
    ]


def reasons_by_world(failures: Failures) -> dict[str, tuple[tuple[str, int], ...]]:
    """Returns why episodes did not pass, by world, most frequent first."""
    worlds, kinds = len(failures.world.names), len(failures.reason.names)
    both = failures.world.codes * kinds + failures.reason.codes
    counts = np.bincount(both, minlength=worlds * kinds).reshape(worlds, kinds)
    return {
        world: _most_frequent(zip(failures.reason.names, row.tolist(), strict=True))
        for world, row in zip(failures.world.names, counts, strict=True)
    }


def reasons(failures: Failures) -> tuple[tuple[str, int], ...]:
    """Returns why episodes did not pass, most frequent first."""
    counts = np.bincount(failures.reason.codes, minlength=len(failures.reason.names))
    return _most_frequent(zip(failures.reason.names, counts.tolist(), strict=True))


def _most_frequent(counts: Iterable[tuple[str, int]]) -> tuple[tuple[str, int], ...]:
    return tuple(sorted((pair for pair in counts if pair[1]), key=lambda pair: (-pair[1], pair[0])))


def _count(labels: Labels, rows: np.ndarray) -> list[int]:
    return np.bincount(labels.codes[rows], minlength=len(labels.names)).tolist()
