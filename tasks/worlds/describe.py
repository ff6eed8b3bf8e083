"""What RoboMaker's calls answer about generation jobs and worlds."""

from pydantic import JsonValue, TypeAdapter

from specs.arn import arn
from specs.base import Spec
from specs.digests import canonical_json
from specs.world import World
from specs.world_descriptions import (
    DescribeWorldGenerationJobResponse,
    DescribeWorldResponse,
    WorldGenerationJobSummary,
    WorldSummary,
)
from specs.world_doors import world_description
from tasks.storage.records import JobRecord

_SUMMARISED = ("template", "worldCount")
_DESCRIBED = (*_SUMMARISED, "tags", "worldTags")


class _Failure(Spec):
    """How often worlds of a job failed with one code, and why one of them did."""

    count: int
    sample_reason: str


_WORLDS = TypeAdapter(list[str])
_FAILURES = TypeAdapter(dict[str, _Failure])


def describe_generation_job(record: JobRecord) -> DescribeWorldGenerationJobResponse:
    """Returns the answer of DescribeWorldGenerationJob; what is empty is left out."""
    fields: dict[str, JsonValue] = {
        **_state(record),
        **_from_request(record, _DESCRIBED),
        "clientRequestToken": record.token,
        "finishedWorldsSummary": _finished(record),
    }
    if record.failure_code:
        fields |= {"failureCode": record.failure_code, "failureReason": record.failure_reason}
    return DescribeWorldGenerationJobResponse.model_validate(fields)


def summarise_generation_job(record: JobRecord) -> WorldGenerationJobSummary:
    """Returns the job's line in ListWorldGenerationJobs."""
    counts: dict[str, JsonValue] = {
        "succeededWorldCount": len(_worlds(record)),
        "failedWorldCount": sum(failure.count for failure in _failures(record).values()),
    }
    fields = {**_state(record), **_from_request(record, _SUMMARISED), **counts}
    return WorldGenerationJobSummary.model_validate(fields)


def describe_world(world: World, record: JobRecord | None, store: str) -> DescribeWorldResponse:
    """Returns the answer of DescribeWorld; what is empty is left out.

    The description body is left out for a world without doors, as it is for templates of version 1.

    Args:
        world: The world.
        record: The job that generated it; None for one that somebody added.
        store: Id of the store.
    """
    fields = _identity(f"{world.generation}/{world.name}", record, store)
    if record and "worldTags" in record.request:
        fields["tags"] = record.request["worldTags"]
    if world.doors:
        fields["worldDescriptionBody"] = canonical_json(world_description(world)).decode()
    return DescribeWorldResponse.model_validate(fields)


def summarise_worlds(record: JobRecord) -> tuple[WorldSummary, ...]:
    """Returns the lines of a job's worlds in ListWorlds."""
    store = _store(record)
    return tuple(WorldSummary.model_validate(_identity(reference, record, store)) for reference in _worlds(record))


def summarise_added_world(reference: str, store: str) -> WorldSummary:
    """Returns the line in ListWorlds of a world that no job generated."""
    return WorldSummary.model_validate(_identity(reference, None, store))


def _identity(reference: str, record: JobRecord | None, store: str) -> dict[str, JsonValue]:
    own: dict[str, JsonValue] = {"arn": arn("world", store, reference)}
    if record is None:
        return own
    return own | {
        "generationJob": record.arn,
        "template": record.request["template"],
        "createdAt": record.created_at_s,
    }


def _state(record: JobRecord) -> dict[str, JsonValue]:
    return {"arn": record.arn, "status": record.status, "createdAt": record.created_at_s}


def _from_request(record: JobRecord, names: tuple[str, ...]) -> dict[str, JsonValue]:
    return {name: record.request[name] for name in names if name in record.request}


def _finished(record: JobRecord) -> dict[str, JsonValue]:
    """Returns the finishedWorldsSummary: finished are those that succeeded and those that failed (semantics 5)."""
    worlds, failures = _worlds(record), _failures(record)
    failed = sum(failure.count for failure in failures.values())
    summary: dict[str, JsonValue] = {"finishedCount": len(worlds) + failed}
    if worlds:
        summary["succeededWorlds"] = [arn("world", _store(record), reference) for reference in worlds]
    if failures:
        listed: list[JsonValue] = [
            {"failureCode": code, "sampleFailureReason": failure.sample_reason, "failureCount": failure.count}
            for code, failure in failures.items()
        ]
        summary["failureSummary"] = {"totalFailureCount": failed, "failures": listed}
    return summary


def _worlds(record: JobRecord) -> list[str]:
    return _WORLDS.validate_python(record.detail.get("worlds", []))


def _failures(record: JobRecord) -> dict[str, _Failure]:
    return _FAILURES.validate_python(record.detail.get("failures", {}))


def _store(record: JobRecord) -> str:
    return record.arn.split(":")[3]
