"""The outcome of a simulation job as tags: RoboMaker's users fail where a tag of a job says ``Failed``."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from specs.data.episode import EpisodeResult

OUTCOME, REASON = "simyard:outcome", "simyard:outcome-reason"
MOST_OWN_TAGS = 48
"""Of a simulation job: RoboMaker's 50 of a resource, without those of its outcome."""
_MOST_TAGS = 50
_RESERVED = "simyard:"


def is_reserved(key: str) -> bool:
    """Returns whether the key of a tag is Simyard's own, so that nobody else may set or remove it."""
    return key.lower().startswith(_RESERVED)


def outcome_tags(row: "EpisodeResult") -> dict[str, str]:
    """Returns the tags of a job that has ended with that result; none for one that was cancelled.

    A job that failed for a technical reason has not passed either: it says Failed, and its failure code.
    """
    from specs.data.episode import reason, success  # noqa: PLC0415 - a robot's agent needs this module, and no episode

    passed = success(row)
    if passed is None:
        return {}
    return {OUTCOME: "Passed"} if passed else failed_tags(reason(row))


def failed_tags(why: str) -> dict[str, str]:
    """Returns the tags of a job that has not passed, with its outcome's reason or its failure code."""
    return {OUTCOME: "Failed", REASON: why}


def with_outcome(own: Mapping[str, str], outcome: Mapping[str, str]) -> dict[str, str]:
    """Returns a job's own tags and those of its outcome, which win; a document's job may have had 50 of its own."""
    kept = [(key, value) for key, value in own.items() if key not in outcome]
    return {**dict(kept[: _MOST_TAGS - len(outcome)]), **outcome}
