"""What RoboMaker's calls answer about generation jobs, worlds and templates, one by one and in pages, oldest first."""

import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import PurePosixPath

from pydantic import JsonValue, TypeAdapter

from specs.arn import ResourceKind, absence, arn, reference_path, store_id_of
from specs.base import Spec, canonical_json
from specs.data.world import World
from specs.errors import ObjectNotFound, ResourceNotFound
from specs.job_kinds import JobKind
from specs.robomaker.failure_codes import WorldGenerationJobErrorCode, told_code
from specs.robomaker.shared_operations import Place, page_of, page_size, place_after, wanted_values
from specs.robomaker.world_jobs import (
    DescribeWorldGenerationJobResponse,
    DescribeWorldResponse,
    DescribeWorldTemplateResponse,
    ListWorldGenerationJobsRequest,
    ListWorldGenerationJobsResponse,
    ListWorldsRequest,
    ListWorldsResponse,
    ListWorldTemplatesRequest,
    ListWorldTemplatesResponse,
    TemplateSummary,
    WorldGenerationJobSummary,
    WorldSummary,
    world_description,
)
from specs.template.body import TemplateBody
from tasks.storage.base.keys import NAMED_TEMPLATE_PREFIX, template_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.job_index import IndexEntry, all_entries, fits, index_page, place_of
from tasks.storage.jobs.records import JobRecord, read
from tasks.storage.store_url import store_id
from tasks.storage.templates import NamedTemplate, named_templates, read_template
from tasks.storage.worlds import decode_world, reference_key

_SUMMARISED = ("template", "worldCount")
_DESCRIBED = (*_SUMMARISED, "tags", "worldTags")
_WORLDS = TypeAdapter(list[str])
# Not from the job itself, which imports what makes worlds.
_KIND: JobKind = "world-generation-job"
_WORLD, _TEMPLATE = "world", "world-template"
_MOST = 100
_JOB_FILTERS = ("status", "templateId")
_WORLD_FILTERS = ("status", "generationJobId", "templateId")
_NUMBER, _DIGITS = re.compile("[0-9]+"), 9
_LAST_US = 1 << 62
"""The place of what nobody knows the time of."""


class _Failure(Spec):
    """How often worlds of a job failed with one code, and why one of them did."""

    count: int
    sample_reason: str


_FAILURES = TypeAdapter(dict[str, _Failure])


def describe_generation_job(record: JobRecord) -> DescribeWorldGenerationJobResponse:
    """Returns the answer of DescribeWorldGenerationJob; what is empty is left out."""
    fields: dict[str, JsonValue] = {
        **record.answer(*_DESCRIBED),
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
        "succeededWorldCount": len(_world_references(record)),
        "failedWorldCount": sum(failure.count for failure in _failures(record).values()),
    }
    return WorldGenerationJobSummary.model_validate({**record.answer(*_SUMMARISED), **counts})


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


def _finished_worlds_summary(record: JobRecord) -> dict[str, JsonValue]:
    """Returns the finishedWorldsSummary: finished are those that succeeded and those that failed.

    See docs/reference/robomaker.md, section 5.
    """
    worlds, failures = _world_references(record), _failures(record)
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


def _world_references(record: JobRecord) -> list[str]:
    return _WORLDS.validate_python(record.detail.get("worlds", []))


def _failures(record: JobRecord) -> dict[str, _Failure]:
    return _FAILURES.validate_python(record.detail.get("failures", {}))


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
        return describe_named_template(store, read_template(store, name))
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
        raise ResourceNotFound.of(kind, repr(path), absence([kind], store.url)) from exc


def generation_entry(_store: Store, record: JobRecord) -> IndexEntry:
    """Returns the index entry of a generation job."""
    summary = summarise_generation_job(record).model_dump(mode="json", exclude_none=True)
    template = reference_path(str(record.request.get("template", "")))
    values = {"status": (record.status,), "templateId": (template,), "generationJobId": (record.id,)}
    return IndexEntry(place_of(record.created_at_s, record.id), values, summary, {})


def list_generation_jobs(store: Store) -> Iterator[WorldGenerationJobSummary]:
    """Yields all generation jobs."""
    entries = all_entries(store, _KIND, generation_entry)
    return (WorldGenerationJobSummary.model_validate(entry.summary) for entry in entries)


def list_generation_jobs_page(store: Store, request: ListWorldGenerationJobsRequest) -> ListWorldGenerationJobsResponse:
    """Returns one page of the generation jobs; filters are ``status`` and ``templateId``.

    Raises:
        DocumentError: The token, the size or a filter is none that the call takes.
    """
    filters = {name: name for name in _JOB_FILTERS}
    found, token = index_page(store, _KIND, generation_entry, request, most=_MOST, filters=filters)
    summaries = tuple(WorldGenerationJobSummary.model_validate(each) for each in found)
    return ListWorldGenerationJobsResponse(worldGenerationJobSummaries=summaries, nextToken=token)


def list_worlds(store: Store) -> list[WorldSummary]:
    """Returns all worlds: those of the oldest job first, and then those that somebody added, by name."""
    return [summary for _, summary in _summaries(store, ListWorldsRequest())]


def list_worlds_page(store: Store, request: ListWorldsRequest) -> ListWorldsResponse:
    """Returns one page of the worlds; filters are ``generationJobId``, ``templateId``, and ``status``, the job's.

    Raises:
        DocumentError: The token, the size or a filter is none that the call takes.
    """
    size, after = page_size(request, _MOST), place_after(request, _WORLD, (int, str, str))
    found = ((place, world) for place, world in _summaries(store, request) if after is None or place > after)
    worlds, token = page_of(found, size, _WORLD)
    return ListWorldsResponse(worldSummaries=worlds, nextToken=token)


def list_templates(store: Store) -> list[TemplateSummary]:
    """Returns all templates: those that somebody named first, and then those that documents brought, by digest."""
    return [summary for _, summary in _templates(store, None)]


def list_templates_page(store: Store, request: ListWorldTemplatesRequest) -> ListWorldTemplatesResponse:
    """Returns one page of the templates.

    Raises:
        DocumentError: The token or the size is none that the call takes.
    """
    size, after = page_size(request, _MOST), place_after(request, _TEMPLATE, (int, str))
    templates, token = page_of(_templates(store, after), size, _TEMPLATE)
    return ListWorldTemplatesResponse(templateSummaries=templates, nextToken=token)


def _summaries(store: Store, request: ListWorldsRequest) -> Iterator[tuple[Place, WorldSummary]]:
    wanted = wanted_values(request, _WORLD_FILTERS)
    names = _world_names(store)
    for entry in list(all_entries(store, _KIND, generation_entry)):
        made = names.pop(entry.place.id, [])
        if not fits(entry, wanted):
            continue
        job = entry.summary
        for name in made:
            own: dict[str, JsonValue] = {
                "generationJob": job["arn"],
                "template": job.get("template"),
                "createdAt": job["createdAt"],
            }
            yield (*entry.place, _in_order(name)), _world(store, f"{entry.place.id}/{name}", own)
    for generation in sorted(names):
        if not wanted or generation in wanted.get("generationJobId", ()):
            for name in names[generation]:
                yield (_LAST_US, generation, _in_order(name)), _world(store, f"{generation}/{name}", {})


def _world_names(store: Store) -> dict[str, list[str]]:
    """Returns the worlds of each generation that are there, in the order of their numbers."""
    found: defaultdict[str, list[str]] = defaultdict(list)
    for key in store.keys("worlds"):
        path = PurePosixPath(key)
        if path.suffix == ".json":
            found[path.parent.name].append(path.stem)
    return {generation: sorted(names, key=_in_order) for generation, names in found.items()}


def _in_order(name: str) -> str:
    """Returns a name with its numbers filled up, so that world-1-10 stands behind world-1-9."""
    return _NUMBER.sub(lambda number: number[0].zfill(_DIGITS), name)


def _world(store: Store, reference: str, own: dict[str, JsonValue]) -> WorldSummary:
    return WorldSummary.model_validate({"arn": arn("world", store_id(store), reference), **own})


def _templates(store: Store, after: Place | None) -> Iterator[tuple[Place, TemplateSummary]]:
    named = named_templates(store)
    bodies = {digest for each in named for digest in (each.digest, *each.earlier)}
    for each in named:
        place = place_of(each.created_at_s, each.id)
        if after is None or place > after:
            yield (
                place,
                TemplateSummary(
                    arn=arn("world-template", store_id(store), each.id),
                    createdAt=each.created_at_s,
                    lastUpdatedAt=each.updated_at_s,
                    name=each.name or None,
                    version=each.version,
                ),
            )
    for digest in _digests(store):
        if digest not in bodies and (after is None or (_LAST_US, digest) > after):
            found = describe_template(store, digest)
            yield (_LAST_US, digest), TemplateSummary(arn=found.arn, name=found.name, version=found.version)


def _digests(store: Store) -> Sequence[str]:
    return [PurePosixPath(key).stem for key in store.keys(PurePosixPath(template_key("a")).parent.as_posix())]
