"""Writes a batch's tables, and what the batch's record says of them."""

from collections.abc import Iterable, Mapping

from pydantic import JsonValue

from specs.field_types import OutputLocation
from tasks.results.statistics.summary import EpisodeTally
from tasks.results.tables.result_files import EpisodePart, Variables, recounted_results, write_results
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket

WORLDS = "worlds_driven"
"""Where a batch's record says in how many worlds its episodes came to an end."""
ROOMS = "rooms"
"""Where a batch's record says which rooms robots were in, as a `RoomCoverage`."""


def write_batch_tables(
    store: Store,
    batch: str,
    parts: Iterable[EpisodePart],
    *,
    variables: Variables,
    location: OutputLocation,
    metadata: Mapping[str, str],
) -> tuple[dict[str, JsonValue], EpisodeTally]:
    """Writes a batch's tables; returns where they lie and what they add up to, for its record, and the tally.

    Args:
        store: The store that the output location's bucket belongs to.
        batch: The batch's id.
        parts: Its episodes in the order of their indices, some at a time.
        variables: The values that each environment variable takes in the batch.
        location: Where the tables go.
        metadata: For the files' footers and the record; what the rows say of engines and devices is added.
    """
    bucket = open_bucket(store, location.s3Bucket or "")
    written, tally = write_results(bucket, location.s3Prefix, batch, parts, variables=variables, metadata=metadata)
    counts = tally.counts()
    why_not: list[JsonValue] = [
        {"reason": name, "episodes": count, "sample": sample} for name, count, sample in tally.why_not()
    ]
    detail: dict[str, JsonValue] = {
        **written,
        "metadata": _metadata(metadata, tally),
        "episodes": counts.episodes + counts.canceled,
        "passed": counts.successes,
        "simulated_s": round(tally.simulated_s, 3),
        "counts": counts.model_dump(),
        WORLDS: tally.worlds(),
        "failed_inside": sum(count for name, count, _ in tally.why_not() if name == "InternalServiceError"),
        "why_not": why_not,
    }
    rooms = tally.rooms()
    if rooms:
        detail[ROOMS] = rooms.model_dump(mode="json")
    return detail, tally


def recounted_facts(
    batch: str, parts: Iterable[EpisodePart], *, variables: Variables, metadata: Mapping[str, str]
) -> dict[str, JsonValue]:
    """Returns what a batch's record has to say of its tables and counts; nothing is written.

    Args:
        batch: The batch's id.
        parts: Its episodes in the order of their indices, some at a time.
        variables: The values that each environment variable takes in the batch.
        metadata: For the files' footers; what the rows say of engines and devices is added, over what it says of them.
    """
    digests, tally = recounted_results(batch, parts, variables=variables, metadata=metadata)
    return {
        "sha256s": {**digests},
        "metadata": _metadata(metadata, tally),
        "counts": tally.counts().model_dump(),
    }


def _metadata(metadata: Mapping[str, str], tally: EpisodeTally) -> dict[str, JsonValue]:
    return {**metadata, **tally.ran_on()}
