"""Describes and lists batches and simulation jobs as RoboMaker does (docs/reference/robomaker.md, sections 3 and 4).

A job is `<batch>/<index>`; nothing is stored for it alone. What was asked of it follows from the batch's plan, and what
came of it stands in its chunk. A job is *pending* until its chunk is begun, *created* from then on; in a batch that
ended before it was begun it is *failed*: it never became a job.
"""

import functools
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TypeVar

from specs.arn import parse_reference
from specs.base import Fault
from specs.errors import DocumentError, ResourceNotFound
from specs.robomaker.list_filters import filter_pairs
from specs.robomaker.simulation import ListSimulationJobBatchesRequest, ListSimulationJobsRequest
from specs.robomaker.simulation_descriptions import (
    BatchDescribeSimulationJobResponse,
    DescribeSimulationJobBatchResponse,
    DescribeSimulationJobResponse,
    ListSimulationJobBatchesResponse,
    ListSimulationJobsResponse,
    SimulationJob,
    SimulationJobBatchSummary,
    SimulationJobSummary,
)
from tasks.simulate.batch.job import KIND, job_of
from tasks.simulate.batch.job_states import Jobs
from tasks.simulate.plan.request import policy_and_tags
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, records

T = TypeVar("T")
_PAGE = 1000
_MOST_SHOWN = 10_000  # of each list of a batch; they take 0.3 s and 3 MB (docs/reference/robomaker.md, section 4)
_FILTERED: Mapping[str, Callable[[SimulationJobSummary], tuple[str, ...]]] = {
    "status": lambda job: (str(job.status),),
    "robotApplicationName": lambda job: job.robotApplicationNames or (),
    "simulationApplicationName": lambda job: job.simulationApplicationNames or (),
}


def describe_batch(store: Store, batch: str) -> DescribeSimulationJobBatchResponse:
    """Returns a batch with its pending, created and failed requests, at most 10,000 of each.

    RoboMaker's batches had 1,000 at most. A matrix may make more, of which `batch_notes` tells, and `list_jobs` yields
    them all.

    Raises:
        ResourceNotFound: No such batch.
    """
    jobs = Jobs(store, batch)
    record = jobs.record
    policy, tags = policy_and_tags(record)
    return DescribeSimulationJobBatchResponse(
        arn=record.arn,
        status=record.status,  # pyright: ignore[reportArgumentType] - checked by pydantic
        createdAt=record.created_at_s,
        lastUpdatedAt=record.updated_at_s,
        clientRequestToken=record.token,
        failureCode="InternalServiceError" if record.failure_code else None,  # a batch has no other
        failureReason=record.failure_reason or None,
        batchPolicy=policy,
        pendingRequests=_few(jobs.pending()),
        createdRequests=_few(jobs.created()) or (),
        failedRequests=_few(jobs.failed()),
        tags=tags,
    )


def batch_notes(store: Store, name: str) -> Iterator[str]:
    """Yields a line for each list that the answer about a batch does not hold in full; for no batch, none."""
    parsed = parse_reference(name)
    if parsed.kind != KIND:
        return
    counts = Jobs(store, parsed.path).counts()
    jobs = counts.pending + counts.created + counts.failed
    for field in ("pending", "created", "failed"):
        if (count := int(getattr(counts, field))) > _MOST_SHOWN:
            where = f"simyard list simulation-jobs shows all jobs, {parsed.path}/0 to {parsed.path}/{jobs - 1}"
            yield f"{field}Requests has the first {_MOST_SHOWN:,} of {count:,}: {where}"


def list_batches(store: Store) -> list[SimulationJobBatchSummary]:
    """Returns all batches, oldest first."""
    return [_batch_summary(store, record) for record in records(store, KIND)]


def list_batches_page(store: Store, request: ListSimulationJobBatchesRequest) -> ListSimulationJobBatchesResponse:
    """Returns one page of the batches, oldest first.

    Args:
        store: Where they are.
        request: Pages hold 1,000 batches if it does not say. The filter is ``status``; several are alternatives.

    Raises:
        DocumentError: The token is none that a page gave, or a filter has another name.
    """
    wanted = {value for _, value in filter_pairs(request, ("status",))}
    rest = list(itertools.dropwhile(lambda record: request.nextToken not in {None, record.id}, records(store, KIND)))
    if request.nextToken and not rest:
        raise _refused("nextToken", request.nextToken, "the nextToken of a page")
    later = [record for record in rest if not wanted or record.status in wanted]
    size = request.maxResults or _PAGE
    return ListSimulationJobBatchesResponse(
        simulationJobBatchSummaries=tuple(_batch_summary(store, record) for record in later[:size]),
        nextToken=later[size].id if len(later) > size else None,
    )


def _batch_summary(store: Store, record: JobRecord) -> SimulationJobBatchSummary:
    counts = Jobs(store, record.id).counts()
    return SimulationJobBatchSummary(
        arn=record.arn,
        createdAt=record.created_at_s,
        lastUpdatedAt=record.updated_at_s,
        status=record.status,  # pyright: ignore[reportArgumentType] - as above
        pendingRequestCount=counts.pending,
        createdRequestCount=counts.created,
        failedRequestCount=counts.failed,
    )


def list_jobs(store: Store) -> Iterator[SimulationJobSummary]:
    """Yields the jobs of all batches, by batch and index; what never became a job is none."""
    return (summary for _, summary in _jobs_from(store, "", 0))


def list_jobs_page(store: Store, request: ListSimulationJobsRequest) -> ListSimulationJobsResponse:
    """Returns one page of the jobs of all batches.

    Args:
        store: Where the batches are.
        request: Pages hold 1,000 jobs if it does not say. Filters are ``status``, ``robotApplicationName`` and
            ``simulationApplicationName``; several are alternatives.

    Raises:
        DocumentError: The token is none that a page gave, or a filter has another name.
    """
    batch, index = _position(request.nextToken)
    wanted = _filters(request)
    found = ((at, job) for at, job in _jobs_from(store, batch, index) if wanted(job))
    page = list(itertools.islice(found, (request.maxResults or _PAGE) + 1))
    more = len(page) > (request.maxResults or _PAGE)
    return ListSimulationJobsResponse(
        simulationJobSummaries=tuple(job for _, job in (page[:-1] if more else page)),
        nextToken=page[-1][0] if more else None,
    )


def describe_job(store: Store, path: str) -> DescribeSimulationJobResponse:
    """Returns one job of a batch.

    Args:
        store: Where the batch is.
        path: ``<batch>/<index>``.

    Raises:
        ResourceNotFound: No such batch, or it has no such job, or that never became one.
    """
    batch, index = job_of(store, path)
    return DescribeSimulationJobResponse.model_validate(Jobs(store, batch.id).described(index))


def job_outcome_tags(store: Store, path: str) -> dict[str, str]:
    """Returns the tags that say what came of a job; none before its end, and for one that was cancelled.

    Raises:
        ResourceNotFound: No such batch, or it has no such job.
    """
    batch, index = job_of(store, path)
    return Jobs(store, batch.id).outcome_tags(index)


def batch_describe_jobs(store: Store, jobs: Sequence[str]) -> BatchDescribeSimulationJobResponse:
    """Returns several jobs, and the ARNs of those that do not exist.

    Args:
        store: Where their batches are.
        jobs: ARNs, at most 100.
    """
    found: list[SimulationJob] = []
    missing: list[str] = []
    batches = functools.cache(lambda batch: Jobs(store, batch))  # as they stand now, each read once
    for arn in jobs:
        try:
            batch, index = job_of(store, _job_path(arn))
            found.append(SimulationJob.model_validate(batches(batch.id).described(index)))
        except ResourceNotFound:
            missing.append(arn)
    return BatchDescribeSimulationJobResponse(jobs=tuple(found) or None, unprocessedJobs=tuple(missing) or None)


def _job_path(reference: str) -> str:
    """Returns ``<batch>/<index>`` of a job's ARN; what is none is as unknown as a job that is gone.

    Raises:
        ResourceNotFound: It names no job.
    """
    try:
        parsed = parse_reference(reference)
    except ValueError as exc:
        raise _unknown(reference) from exc
    if parsed.kind not in {None, "simulation-job"}:
        raise _unknown(reference)
    return parsed.path


def _unknown(reference: str) -> ResourceNotFound:
    return ResourceNotFound([Fault(path="jobs", value=repr(reference), allowed="the ARN of a simulation job")])


def _jobs_from(store: Store, batch: str, index: int) -> Iterator[tuple[str, SimulationJobSummary]]:
    """Yields jobs, each after its place ``<batch>/<index>``, from a place on; an empty batch is the first."""
    skipped = itertools.dropwhile(lambda record: batch not in {"", record.id}, records(store, KIND))
    for record in skipped:
        for summary in Jobs(store, record.id).created(index if record.id == batch else 0):
            yield parse_reference(str(summary.arn)).path, summary


def _position(token: str | None) -> tuple[str, int]:
    batch, _, index = (token or "/0").partition("/")
    if not index.isdecimal():
        raise _refused("nextToken", str(token), "the nextToken of a page")
    return batch, int(index)


def _filters(request: ListSimulationJobsRequest) -> Callable[[SimulationJobSummary], bool]:
    pairs = filter_pairs(request, tuple(_FILTERED))
    return lambda job: not pairs or any(value in _FILTERED[name](job) for name, value in pairs)


def _refused(path: str, value: str, allowed: str) -> DocumentError:
    return DocumentError([Fault(path=path, value=repr(value), allowed=allowed)], source="simyard")


def _few(found: Iterable[T]) -> tuple[T, ...] | None:
    return tuple(itertools.islice(found, _MOST_SHOWN)) or None
