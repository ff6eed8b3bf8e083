"""Describes batches and simulation jobs as RoboMaker does (docs/reference/robomaker.md, sections 3 and 4).

A job is `<batch>/<index>`; nothing is stored for it alone. What was asked of it follows from the batch's plan, and what
came of it stands in its chunk. A job is *pending* until its chunk is begun, *created* from then on; in a batch that
ended before it was begun it is *failed*: it never became a job.
"""

import functools
import itertools
from collections.abc import Iterable, Iterator, Sequence
from typing import TypeVar

from specs.arn import parse_reference
from specs.base import Fault
from specs.errors import ResourceNotFound
from specs.robomaker.simulation_descriptions import (
    BatchDescribeSimulationJobResponse,
    DescribeSimulationJobBatchResponse,
    DescribeSimulationJobResponse,
    SimulationJob,
)
from tasks.simulate.batch.job import KIND, job_of
from tasks.simulate.batch.job_states import Jobs
from tasks.simulate.plan.request import policy_and_tags
from tasks.storage.base.store import Store

T = TypeVar("T")
_MOST_SHOWN = 10_000  # of each list of a batch; they take 0.3 s and 3 MB (docs/reference/robomaker.md, section 4)


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
        # Programs count these two; only pendingRequests may not be empty.
        failedRequests=_few(jobs.failed()) or (),
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
    return BatchDescribeSimulationJobResponse(jobs=tuple(found), unprocessedJobs=tuple(missing) or None)


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


def _few(found: Iterable[T]) -> tuple[T, ...] | None:
    return tuple(itertools.islice(found, _MOST_SHOWN)) or None
