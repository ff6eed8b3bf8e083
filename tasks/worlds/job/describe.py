"""What RoboMaker's calls answer about generation jobs and worlds.

What a store holds of templates and worlds, in RoboMaker's words.
"""

from pydantic import JsonValue, TypeAdapter

from specs.arn import ResourceKind, absence, arn, store_id_of
from specs.base import Fault, Spec
from specs.data.world import World
from specs.digest import canonical_json
from specs.errors import ObjectNotFound, ResourceNotFound
from specs.job_kinds import JobKind
from specs.robomaker.failure_codes import WorldGenerationJobErrorCode, told_code
from specs.robomaker.world_descriptions import (
    DescribeWorldGenerationJobResponse,
    DescribeWorldResponse,
    DescribeWorldTemplateResponse,
    WorldGenerationJobSummary,
    world_description,
)
from specs.template.body import TemplateBody
from tasks.storage.base.keys import NAMED_TEMPLATE_PREFIX, template_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, read
from tasks.storage.store_url import store_id
from tasks.storage.templates.named_templates import NamedTemplate, read_template
from tasks.storage.worlds import decode_world, reference_key

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
        "finishedWorldsSummary": _finished_worlds_summary(record),
    }
    if record.failure_code:
        code = told_code(record.failure_code, WorldGenerationJobErrorCode)
        fields |= {"failureCode": code, "failureReason": record.failure_reason}
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


def _finished_worlds_summary(record: JobRecord) -> dict[str, JsonValue]:
    """Returns the finishedWorldsSummary: finished are those that succeeded and those that failed.

    See docs/reference/robomaker.md, section 5.
    """
    worlds, failures = _worlds(record), _failures(record)
    failed = sum(failure.count for failure in failures.values())
    summary: dict[str, JsonValue] = {"finishedCount": len(worlds) + failed}
    if worlds:
        summary["succeededWorlds"] = [arn("world", store_id_of(record.arn), reference) for reference in worlds]
    if failures:
        listed: list[JsonValue] = [
            {
                "failureCode": told_code(code, WorldGenerationJobErrorCode),
                "sampleFailureReason": failure.sample_reason,
                "failureCount": failure.count,
            }
            for code, failure in failures.items()
        ]
        summary["failureSummary"] = {"totalFailureCount": failed, "failures": listed}
    return summary


def _worlds(record: JobRecord) -> list[str]:
    return _WORLDS.validate_python(record.detail.get("worlds", []))


def _failures(record: JobRecord) -> dict[str, _Failure]:
    return _FAILURES.validate_python(record.detail.get("failures", {}))


# Not from the job itself, which imports what makes worlds.
_KIND: JobKind = "world-generation-job"


def describe_stored_world(store: Store, path: str) -> DescribeWorldResponse:
    """Returns a world, by ``<generation>/<world>``; of one that somebody added no job is told.

    Raises:
        ResourceNotFound: There is no such world.
        DocumentError: The path is no world's.
    """
    body = _read_object(store, reference_key(path), "world", path)
    try:
        record = read(store, _KIND, path.partition("/")[0])
    except ResourceNotFound:
        record = None
    return describe_world(decode_world(body), record, store_id(store))


def describe_template(store: Store, name: str) -> DescribeWorldTemplateResponse:
    """Returns a template: one that somebody named, by its id, or a body that worlds were made from, by its digest.

    Raises:
        ResourceNotFound: There is no such template.
        DocumentError: The name is none.
    """
    if name.startswith(NAMED_TEMPLATE_PREFIX):
        return describe_named_template(store, read_template(store, name)[0])
    body = TemplateBody.model_validate_json(_read_object(store, template_key(name), "world-template", name))
    return DescribeWorldTemplateResponse(arn=_arn(store, name), name=name, version=body.Version)


def describe_named_template(store: Store, found: NamedTemplate) -> DescribeWorldTemplateResponse:
    """Returns the answer of DescribeWorldTemplate for a template that somebody named."""
    return DescribeWorldTemplateResponse(
        arn=_arn(store, found.id),
        clientRequestToken=found.token or None,
        name=found.name or None,
        createdAt=found.created_at_s,
        lastUpdatedAt=found.updated_at_s,
        tags=found.tags or None,
        version=found.version,
    )


def _arn(store: Store, name: str) -> str:
    return arn("world-template", store_id(store), name)


def _read_object(store: Store, key: str, kind: ResourceKind, path: str) -> bytes:
    try:
        return store.get(key).body
    except ObjectNotFound as exc:
        raise ResourceNotFound([Fault(path=kind, value=repr(path), allowed=absence([kind], store.url))]) from exc
