"""Pages of ListSimulationJobBatches and ListSimulationJobs, oldest first, the jobs of a batch by their index.

What CreateSimulationJob made is a job to RoboMaker from the call on, and no batch. A job of a batch is listed once its
chunk was begun (docs/reference/robomaker.md, section 4).

The line of a batch says what lists say of it and, once it has ended, of each of its jobs. A batch of ten thousand jobs
that ended in three ways has three summaries and says which jobs have which. So a page of its jobs reads no chunk.
"""

import json
from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import groupby
from typing import cast

from pydantic import JsonValue

from specs.arn import arn, store_id_of
from specs.errors import ResourceNotFound
from specs.robomaker.shared_operations import Place, page_of, page_size, place_after, wanted_values
from specs.robomaker.simulation import ListSimulationJobBatchesRequest, ListSimulationJobsRequest
from specs.robomaker.simulation_descriptions import (
    ListSimulationJobBatchesResponse,
    ListSimulationJobsResponse,
    SimulationJobBatchSummary,
    SimulationJobSummary,
)
from tasks.simulate.batch.batch_jobs import Jobs
from tasks.simulate.batch.batch_record import KIND
from tasks.simulate.plan.plan_batch import is_single
from tasks.storage.base.store import Store
from tasks.storage.jobs.job_index import (
    START,
    FoundJob,
    IndexEntry,
    JobIndex,
    JobPlace,
    Wanted,
    all_entries,
    index_page,
    place_of,
    skip_if_corrupt,
)
from tasks.storage.jobs.records import JobRecord, is_terminal

SHAPE, BATCH, SINGLE = "shape", "batch", "single"
"""The lines' value that says whether CreateSimulationJob made a batch, which then is none to RoboMaker."""
JOB_STATUS = "jobStatus"
APPLICATIONS = {
    "robotApplicationName": "robotApplicationNames",
    "simulationApplicationName": "simulationApplicationNames",
}
"""What jobs are filtered by, with the field of their summaries that has the values."""
_MOST_JOBS = 20_000
"""Of a batch of more jobs the line tells none: to read all its chunks for it would take half a minute."""
_JOBS, _SUMMARIES, _RUNS = "jobs", "summaries", "runs"
_OWN = ("arn", "name")
Document = dict[str, JsonValue]


def batch_entry(store: Store, record: JobRecord) -> IndexEntry:
    """Returns the index entry of a batch as it stands."""
    jobs = Jobs(store, record.id, record)
    counts = jobs.counts()
    summary = SimulationJobBatchSummary(
        arn=record.arn,
        createdAt=record.created_at_s,
        lastUpdatedAt=record.updated_at_s,
        status=record.status,  # pyright: ignore[reportArgumentType] - checked by pydantic
        pendingRequestCount=counts.pending,
        createdRequestCount=counts.created,
        failedRequestCount=counts.failed,
    )
    values: dict[str, Sequence[str]] = {SHAPE: [SINGLE if is_single(record) else BATCH], "status": [record.status]}
    detail: Document = {}
    if is_terminal(record) and jobs.episodes <= _MOST_JOBS:
        table = _table(jobs)
        detail = {_JOBS: table}
        values |= _values(cast("list[Document]", table[_SUMMARIES]))
    return IndexEntry(
        place_of(record.created_at_s, record.id), values, summary.model_dump(mode="json", exclude_none=True), detail
    )


def has_jobs(entry: IndexEntry) -> bool:
    """Returns whether an entry tells of a batch's jobs."""
    return _JOBS in entry.detail


def jobs_of_entry(entry: IndexEntry, first: int) -> Iterator[tuple[int, Document]]:
    """Yields index and summary of each job of a batch that has ended, from an index on."""
    table = cast("Document", entry.detail[_JOBS])
    summaries = cast("list[Document]", table[_SUMMARIES])
    store = store_id_of(str(entry.summary["arn"]))
    for start, count, number in cast("list[list[int]]", table[_RUNS]):
        for index in range(max(start, first), start + count):
            own = {
                "arn": arn("simulation-job", store, f"{entry.place.id}/{index}"),
                "name": f"{entry.place.id}-{index}",
            }
            yield index, {**own, **summaries[number]}


def _table(jobs: Jobs) -> Document:
    """Returns the different summaries of a batch's jobs, and which of them each job has, equal neighbours together."""
    numbers: dict[str, int] = {}
    of_job: dict[int, int] = {}
    for index, summary in jobs.summaries_by_chunk():
        text = json.dumps(
            {name: value for name, value in summary.items() if name not in _OWN and value is not None}, sort_keys=True
        )
        of_job[index] = numbers.setdefault(text, len(numbers))
    runs: list[JsonValue] = []
    # Neighbours of one summary have the same difference between their index and their place in the group.
    for (_, number), group in groupby(enumerate(sorted(of_job)), lambda each: (each[1] - each[0], of_job[each[1]])):
        indices = [index for _, index in group]
        runs.append([indices[0], len(indices), number])
    return {_SUMMARIES: [json.loads(text) for text in numbers], _RUNS: runs}


def _values(summaries: Sequence[Document]) -> dict[str, Sequence[str]]:
    names = {name: [cast("list[str]", each[field]) for each in summaries] for name, field in APPLICATIONS.items()}
    return {
        JOB_STATUS: sorted({str(each["status"]) for each in summaries}),
        **{name: sorted({value for values in found for value in values}) for name, found in names.items()},
    }


_MOST_LISTED = 1000
_ONLY_BATCHES: Wanted = {SHAPE: (BATCH,)}
_FILTERS = {"status": JOB_STATUS, **{name: name for name in APPLICATIONS}}
_JOB = "simulation-job"
_PLACE = (int, str, int)


def list_batches(store: Store) -> Iterator[SimulationJobBatchSummary]:
    """Yields all batches, oldest first."""
    entries = all_entries(store, KIND, batch_entry, _ONLY_BATCHES)
    return (SimulationJobBatchSummary.model_validate(entry.summary) for entry in entries)


def list_batches_page(store: Store, request: ListSimulationJobBatchesRequest) -> ListSimulationJobBatchesResponse:
    """Returns one page of the batches; the filter is ``status``.

    Raises:
        DocumentError: The token, the size or a filter is none that the call takes.
    """
    found, token = index_page(
        store, KIND, batch_entry, request, most=_MOST_LISTED, filters={"status": "status"}, only=_ONLY_BATCHES
    )
    summaries = tuple(SimulationJobBatchSummary.model_validate(each) for each in found)
    return ListSimulationJobBatchesResponse(simulationJobBatchSummaries=summaries, nextToken=token)


def list_jobs(store: Store) -> Iterator[SimulationJobSummary]:
    """Yields all jobs; what never became a job is none."""
    yield from (_summary(job) for _, job in _jobs_after(store, None, {}))


def list_jobs_page(store: Store, request: ListSimulationJobsRequest) -> ListSimulationJobsResponse:
    """Returns one page of all jobs; filters are ``status``, ``robotApplicationName``, ``simulationApplicationName``.

    Raises:
        DocumentError: The token, the size or a filter is none that the call takes.
    """
    wanted = wanted_values(request, tuple(_FILTERS))
    size, after = page_size(request, _MOST_LISTED), place_after(request, _JOB, _PLACE)
    jobs, token = page_of(_jobs_after(store, after, wanted), size, _JOB)
    return ListSimulationJobsResponse(simulationJobSummaries=tuple(map(_summary, jobs)), nextToken=token)


def _jobs_after(
    store: Store, after: Place | None, wanted: dict[str, frozenset[str]]
) -> Iterator[tuple[Place, Document]]:
    """Yields jobs with their places, those after a place; a job must have one of the wanted values."""
    first, index = (JobPlace(int(after[0]), str(after[1])), int(after[2]) + 1) if after else (START, 0)
    of_entries = {_FILTERS[name]: values for name, values in wanted.items()}
    for found in JobIndex(store, KIND, batch_entry).jobs(first, of_entries):
        start = index if found.place == first else 0
        for number, job in _jobs_of(store, found, start, wanted):
            if _is_wanted(job, wanted):
                yield (*found.place, number), job


def _jobs_of(
    store: Store, found: FoundJob, first: int, wanted: dict[str, frozenset[str]]
) -> Iterator[tuple[int, Document]]:
    if found.entry and has_jobs(found.entry):
        yield from jobs_of_entry(found.entry, first)
        return
    with skip_if_corrupt(store, KIND, found.place.id), suppress(ResourceNotFound):  # removed since it was found
        yield from Jobs(store, found.place.id, found.record).listed(first, wanted.get("status", ()))


def _is_wanted(job: Document, wanted: dict[str, frozenset[str]]) -> bool:
    for name, values in wanted.items():
        own = {str(job["status"])} if name == "status" else set(cast("list[str]", job[APPLICATIONS[name]]))
        if values.isdisjoint(own):
            return False
    return True


def _summary(job: Document) -> SimulationJobSummary:
    return SimulationJobSummary.model_validate(job)
