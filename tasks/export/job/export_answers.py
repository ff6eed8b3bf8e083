"""An export job in RoboMaker's words: the answers of its calls, why one failed, and pages of ListWorldExportJobs."""

from collections.abc import Iterator
from contextlib import suppress
from typing import cast

from pydantic import JsonValue

from specs.arn import reference_path
from specs.errors import (
    BucketNotFound,
    DocumentError,
    LimitExceeded,
    ObjectNotFound,
    ResourceNotFound,
    SimyardError,
    StoreAccessDenied,
    StoreAway,
    StoreFull,
    StoreThrottled,
)
from specs.job_kinds import JobKind
from specs.robomaker.failure_codes import WorldExportJobErrorCode, told_code
from specs.robomaker.world_jobs import (
    DescribeWorldExportJobResponse,
    ListWorldExportJobsRequest,
    ListWorldExportJobsResponse,
    WorldExportJobSummary,
)
from tasks.storage.base.store import Store
from tasks.storage.jobs.job_index import IndexEntry, all_entries, index_page, place_of
from tasks.storage.jobs.records import JobRecord, read

_SUMMARISED = ("worlds", "outputLocation")
_DESCRIBED = (*_SUMMARISED, "iamRole", "tags")
_LONGEST_REASON = 1024  # GenericString

# The first that fits counts, so a subclass stands before its base.
_CODES: tuple[tuple[type[SimyardError], WorldExportJobErrorCode], ...] = (
    (StoreAccessDenied, "AccessDenied"),
    (ObjectNotFound, "ResourceNotFound"),
    (BucketNotFound, "ResourceNotFound"),  # a bucket that is gone (docs/reference/robomaker.md, section 7)
    (StoreThrottled, "RequestThrottled"),
    (StoreFull, "LimitExceeded"),
    (ResourceNotFound, "ResourceNotFound"),
    (LimitExceeded, "LimitExceeded"),
    (DocumentError, "InvalidInput"),
)


def describe_export_job(record: JobRecord) -> DescribeWorldExportJobResponse:
    """Returns the answer of DescribeWorldExportJob; what is empty is left out."""
    fields: dict[str, JsonValue] = {
        **record.answer(*_DESCRIBED),
        "clientRequestToken": record.token,
    }
    if record.failure_code:
        code = told_code(record.failure_code, WorldExportJobErrorCode)
        fields |= {"failureCode": code, "failureReason": record.failure_reason}
    return DescribeWorldExportJobResponse.model_validate(fields)


def summarise_export_job(record: JobRecord) -> WorldExportJobSummary:
    """Returns the job's line in ListWorldExportJobs."""
    return WorldExportJobSummary.model_validate(record.answer(*_SUMMARISED))


def failure_code(error: SimyardError) -> WorldExportJobErrorCode:
    """Returns RoboMaker's code for what went wrong; InternalServiceError for what no other fits."""
    for kind, code in _CODES:
        if isinstance(error, kind):
            return code
    return "InternalServiceError"


def is_outage(error: SimyardError) -> bool:
    """Returns whether nothing is wrong but that a store does not answer now: the job need not fail for that.

    RoboMaker has a code for a bucket that asks for fewer requests, even after a while of fewer: RequestThrottled.
    """
    return isinstance(error, StoreAway) and not isinstance(error, StoreThrottled)


def failure_reason(error: SimyardError) -> str:
    """Returns the error as one line of at most 1,024 characters, as RoboMaker's failureReason must be."""
    return " ".join(str(error).split())[:_LONGEST_REASON]


_KIND: JobKind = "world-export-job"
_GENERATION: JobKind = "world-generation-job"
_MOST = 100
_FILTERS = ("generationJobId", "templateId", "status")


def export_entry(store: Store, record: JobRecord) -> IndexEntry:
    """Returns the index entry of an export job, found by the jobs that made its worlds, and by their templates."""
    paths = [reference_path(world) for world in cast("list[str]", record.request["worlds"])]
    generations = sorted({path.partition("/")[0] for path in paths})
    values = {
        "status": (record.status,),
        "generationJobId": tuple(generations),
        "templateId": tuple(sorted({each for job in generations for each in _templates(store, job)})),
    }
    summary = summarise_export_job(record).model_dump(mode="json", exclude_none=True)
    return IndexEntry(place_of(record.created_at_s, record.id), values, summary, {})


def list_export_jobs(store: Store) -> Iterator[WorldExportJobSummary]:
    """Yields all export jobs."""
    entries = all_entries(store, _KIND, export_entry)
    return (WorldExportJobSummary.model_validate(entry.summary) for entry in entries)


def list_export_jobs_page(store: Store, request: ListWorldExportJobsRequest) -> ListWorldExportJobsResponse:
    """Returns one page of the export jobs; filters are ``generationJobId``, ``templateId`` and ``status``.

    Raises:
        DocumentError: The token, the size or a filter is none that the call takes.
    """
    filters = {name: name for name in _FILTERS}
    found, token = index_page(store, _KIND, export_entry, request, most=_MOST, filters=filters)
    summaries = tuple(WorldExportJobSummary.model_validate(each) for each in found)
    return ListWorldExportJobsResponse(worldExportJobSummaries=summaries, nextToken=token)


def _templates(store: Store, generation: str) -> Iterator[str]:
    with suppress(ResourceNotFound):  # nobody's, or removed since
        yield reference_path(str(read(store, _GENERATION, generation).request["template"]))
