"""Counts how episodes ended: the one place for the tables, the gate, the report and what is printed."""

from collections.abc import Mapping
from typing import NamedTuple

from specs.base import Spec
from specs.data.episode import EpisodeResult, reason, success


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
