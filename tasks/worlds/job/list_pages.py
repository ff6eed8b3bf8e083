"""Pages of ListWorldGenerationJobs, ListWorlds and ListWorldTemplates, oldest first."""

import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import PurePosixPath

from pydantic import JsonValue

from specs.arn import arn, reference_path
from specs.job_kinds import JobKind
from specs.robomaker.list_pages import Place, page_of, page_size, place_after, wanted_values
from specs.robomaker.world_descriptions import (
    ListWorldGenerationJobsResponse,
    ListWorldsResponse,
    ListWorldTemplatesResponse,
    TemplateSummary,
    WorldGenerationJobSummary,
    WorldSummary,
)
from specs.robomaker.world_jobs import ListWorldGenerationJobsRequest, ListWorldsRequest, ListWorldTemplatesRequest
from tasks.storage.base.keys import template_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.lines.line_page import all_lines, fits, line_page
from tasks.storage.jobs.lines.marks import mark_of
from tasks.storage.jobs.lines.segments import Line
from tasks.storage.jobs.records import JobRecord
from tasks.storage.store_url import store_id
from tasks.storage.templates.named_templates import named_templates
from tasks.worlds.job.describe import describe_template, summarise_generation_job

_KIND: JobKind = "world-generation-job"
_WORLD, _TEMPLATE = "world", "world-template"
_MOST = 100
_JOB_FILTERS = ("status", "templateId")
_WORLD_FILTERS = ("status", "generationJobId", "templateId")
_NUMBER, _DIGITS = re.compile("[0-9]+"), 9
_LAST_US = 1 << 62
"""The place of what nobody knows the time of."""


def generation_line(_store: Store, record: JobRecord) -> Line:
    """Returns the line of a generation job."""
    summary = summarise_generation_job(record).model_dump(mode="json", exclude_none=True)
    template = reference_path(str(record.request.get("template", "")))
    values = {"status": (record.status,), "templateId": (template,), "generationJobId": (record.id,)}
    return Line(mark_of(record.created_at_s, record.id), values, summary, {})


def list_generation_jobs(store: Store) -> Iterator[WorldGenerationJobSummary]:
    """Yields all generation jobs."""
    lines = all_lines(store, _KIND, generation_line)
    return (WorldGenerationJobSummary.model_validate(line.summary) for line in lines)


def list_generation_jobs_page(store: Store, request: ListWorldGenerationJobsRequest) -> ListWorldGenerationJobsResponse:
    """Returns one page of the generation jobs; filters are ``status`` and ``templateId``.

    Raises:
        DocumentError: The token, the size or a filter is none that the call takes.
    """
    filters = {name: name for name in _JOB_FILTERS}
    found, token = line_page(store, _KIND, generation_line, request, most=_MOST, filters=filters)
    summaries = tuple(WorldGenerationJobSummary.model_validate(each) for each in found)
    return ListWorldGenerationJobsResponse(worldGenerationJobSummaries=summaries, nextToken=token)


def list_worlds(store: Store) -> list[WorldSummary]:
    """Returns all worlds: those of the oldest job first, and then those that somebody added, by name."""
    return [summary for _, summary in _worlds(store, ListWorldsRequest())]


def list_worlds_page(store: Store, request: ListWorldsRequest) -> ListWorldsResponse:
    """Returns one page of the worlds; filters are ``generationJobId``, ``templateId``, and ``status``, the job's.

    Raises:
        DocumentError: The token, the size or a filter is none that the call takes.
    """
    size, after = page_size(request, _MOST), place_after(request, _WORLD, (int, str, str))
    found = ((place, world) for place, world in _worlds(store, request) if after is None or place > after)
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


def _worlds(store: Store, request: ListWorldsRequest) -> Iterator[tuple[Place, WorldSummary]]:
    wanted = wanted_values(request, _WORLD_FILTERS)
    names = _world_names(store)
    for line in list(all_lines(store, _KIND, generation_line)):
        made = names.pop(line.mark.id, [])
        if not fits(line, wanted):
            continue
        job = line.summary
        for name in made:
            own: dict[str, JsonValue] = {
                "generationJob": job["arn"],
                "template": job.get("template"),
                "createdAt": job["createdAt"],
            }
            yield (*line.mark, _in_order(name)), _world(store, f"{line.mark.id}/{name}", own)
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
        place = mark_of(each.created_at_s, each.id)
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
