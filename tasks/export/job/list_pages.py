"""Pages of ListWorldExportJobs, oldest first."""

from collections.abc import Iterator
from contextlib import suppress
from typing import cast

from specs.arn import reference_path
from specs.errors import ResourceNotFound
from specs.job_kinds import JobKind
from specs.robomaker.world_descriptions import ListWorldExportJobsResponse, WorldExportJobSummary
from specs.robomaker.world_jobs import ListWorldExportJobsRequest
from tasks.export.job.describe import summarise_export_job
from tasks.storage.base.store import Store
from tasks.storage.jobs.lines.line_page import all_lines, line_page
from tasks.storage.jobs.lines.marks import mark_of
from tasks.storage.jobs.lines.segments import Line
from tasks.storage.jobs.records import JobRecord, read

_KIND: JobKind = "world-export-job"
_GENERATION: JobKind = "world-generation-job"
_MOST = 100
_FILTERS = ("generationJobId", "templateId", "status")


def export_line(store: Store, record: JobRecord) -> Line:
    """Returns the line of an export job; it can be found by the jobs that made its worlds, and by their templates."""
    paths = [reference_path(world) for world in cast("list[str]", record.request["worlds"])]
    generations = sorted({path.partition("/")[0] for path in paths})
    values = {
        "status": (record.status,),
        "generationJobId": tuple(generations),
        "templateId": tuple(sorted({each for job in generations for each in _templates(store, job)})),
    }
    summary = summarise_export_job(record).model_dump(mode="json", exclude_none=True)
    return Line(mark_of(record.created_at_s, record.id), values, summary, {})


def list_export_jobs(store: Store) -> Iterator[WorldExportJobSummary]:
    """Yields all export jobs."""
    lines = all_lines(store, _KIND, export_line)
    return (WorldExportJobSummary.model_validate(line.summary) for line in lines)


def list_export_jobs_page(store: Store, request: ListWorldExportJobsRequest) -> ListWorldExportJobsResponse:
    """Returns one page of the export jobs; filters are ``generationJobId``, ``templateId`` and ``status``.

    Raises:
        DocumentError: The token, the size or a filter is none that the call takes.
    """
    filters = {name: name for name in _FILTERS}
    found, token = line_page(store, _KIND, export_line, request, most=_MOST, filters=filters)
    summaries = tuple(WorldExportJobSummary.model_validate(each) for each in found)
    return ListWorldExportJobsResponse(worldExportJobSummaries=summaries, nextToken=token)


def _templates(store: Store, generation: str) -> Iterator[str]:
    with suppress(ResourceNotFound):  # nobody's, or removed since
        yield reference_path(str(read(store, _GENERATION, generation).request["template"]))
