"""Counts how episodes ended: the one place for the tables, the gate, the report and what is printed."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from specs.base import Spec
from specs.data.episode import EpisodeRequest, EpisodeResult, reason, success


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


def pair_results(
    requests: Sequence[EpisodeRequest], results: Sequence[EpisodeResult]
) -> list[tuple[EpisodeRequest, EpisodeResult]]:
    """Returns every request with its result, by index.

    Raises:
        ValueError: An index comes twice, or a request has no result or the reverse.
    """
    asked = {request.index: request for request in requests}
    answered = {result.index: result for result in results}
    if len(asked) != len(requests) or len(answered) != len(results) or asked.keys() != answered.keys():
        lone = sorted(asked.keys() ^ answered.keys())[:5]
        raise ValueError(
            f"{len(requests)} requests and {len(results)} results do not pair up; the first indices without a partner "
            f"are {lone}"
        )
    return [(asked[index], answered[index]) for index in sorted(asked)]
