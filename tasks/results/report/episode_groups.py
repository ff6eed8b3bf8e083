"""Counts a batch's episodes by world, application, variable or room, and failures by reason."""

from collections.abc import Collection, Iterable

import numpy as np

from tasks.results.report.batch_columns import CANCELED, FAILED, PASSED, Episodes, Failures, Labels
from tasks.results.statistics.success import Ending, count_endings
from tasks.results.statistics.summary import EpisodeGroup


def total_group(episodes: Episodes, confidence: float) -> EpisodeGroup:
    """Returns all episodes as one group."""
    (group,) = group_episodes(
        episodes, Labels(("all episodes",), np.zeros(len(episodes.outcome), np.int64)), confidence
    )
    return group


def group_episodes(episodes: Episodes, labels: Labels, confidence: float) -> list[EpisodeGroup]:
    """Returns a group a label, in the labels' order, without their reasons.

    Args:
        episodes: The batch.
        labels: Which group each episode belongs to.
        confidence: Of the Wilson intervals.
    """
    kinds = {
        Ending(success, failed_job=False): _count(labels, episodes.outcome == code)
        for success, code in ((True, PASSED), (False, FAILED), (None, CANCELED))
    }
    return [
        EpisodeGroup.of_counts(
            label, count_endings({kind: counts[number] for kind, counts in kinds.items()}), confidence
        )
        for number, label in enumerate(labels.names)
    ]


def counts_by_world(episodes: Episodes, digests: Collection[str] = ()) -> tuple[list[int], list[int]]:
    """Returns of each world how many episodes passed, and how many came to an end.

    Args:
        episodes: The batch.
        digests: Robot applications whose episodes are meant; of none, all are.
    """
    codes = [code for code, name in enumerate(episodes.robot.names) if not digests or name in digests]
    meant = np.isin(episodes.robot.codes, codes)
    passed = _count(episodes.world, meant & (episodes.outcome == PASSED))
    return passed, _count(episodes.world, meant & (episodes.outcome != CANCELED))


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
