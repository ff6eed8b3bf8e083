"""Pages of ListSimulationJobBatches and ListSimulationJobs, oldest first, the jobs of a batch by their index.

What CreateSimulationJob made is a job to RoboMaker from the call on, and no batch. A job of a batch is listed once its
chunk was begun (docs/reference/robomaker.md, section 4).
"""

from collections.abc import Iterator
from contextlib import suppress
from typing import cast

from specs.errors import ResourceNotFound
from specs.robomaker.list_pages import Place, page_of, page_size, place_after, wanted_values
from specs.robomaker.simulation import ListSimulationJobBatchesRequest, ListSimulationJobsRequest
from specs.robomaker.simulation_descriptions import (
    ListSimulationJobBatchesResponse,
    ListSimulationJobsResponse,
    SimulationJobBatchSummary,
    SimulationJobSummary,
)
from tasks.simulate.batch.job import KIND
from tasks.simulate.batch.job_states import Jobs
from tasks.simulate.lists.batch_line import (
    APPLICATIONS,
    BATCH,
    JOB_STATUS,
    SHAPE,
    Document,
    batch_line,
    has_jobs,
    jobs_of_line,
)
from tasks.storage.base.store import Store
from tasks.storage.jobs.lines.job_lines import START, Found, JobLines, Wanted
from tasks.storage.jobs.lines.line_page import all_lines, line_page
from tasks.storage.jobs.lines.marks import Mark
from tasks.storage.jobs.lines.strange import left_out_if_strange

_MOST = 1000
_ONLY_BATCHES: Wanted = {SHAPE: (BATCH,)}
_FILTERS = {"status": JOB_STATUS, **{name: name for name in APPLICATIONS}}
_JOB = "simulation-job"
_PLACE = (int, str, int)


def list_batches(store: Store) -> Iterator[SimulationJobBatchSummary]:
    """Yields all batches, oldest first."""
    lines = all_lines(store, KIND, batch_line, _ONLY_BATCHES)
    return (SimulationJobBatchSummary.model_validate(line.summary) for line in lines)


def list_batches_page(store: Store, request: ListSimulationJobBatchesRequest) -> ListSimulationJobBatchesResponse:
    """Returns one page of the batches; the filter is ``status``.

    Raises:
        DocumentError: The token, the size or a filter is none that the call takes.
    """
    found, token = line_page(
        store, KIND, batch_line, request, most=_MOST, filters={"status": "status"}, only=_ONLY_BATCHES
    )
    summaries = tuple(SimulationJobBatchSummary.model_validate(each) for each in found)
    return ListSimulationJobBatchesResponse(simulationJobBatchSummaries=summaries, nextToken=token)


def list_jobs(store: Store) -> Iterator[SimulationJobSummary]:
    """Yields all jobs; what never became a job is none."""
    lines = JobLines(store, KIND, batch_line)
    yield from (_summary(job) for _, job in _jobs(store, lines, None, {}))
    lines.settle()


def list_jobs_page(store: Store, request: ListSimulationJobsRequest) -> ListSimulationJobsResponse:
    """Returns one page of all jobs; filters are ``status``, ``robotApplicationName``, ``simulationApplicationName``.

    Raises:
        DocumentError: The token, the size or a filter is none that the call takes.
    """
    wanted = wanted_values(request, tuple(_FILTERS))
    size, after = page_size(request, _MOST), place_after(request, _JOB, _PLACE)
    lines = JobLines(store, KIND, batch_line)
    jobs, token = page_of(_jobs(store, lines, after, wanted), size, _JOB)
    lines.settle()
    return ListSimulationJobsResponse(simulationJobSummaries=tuple(map(_summary, jobs)), nextToken=token)


def _jobs(
    store: Store, lines: JobLines, after: Place | None, wanted: dict[str, frozenset[str]]
) -> Iterator[tuple[Place, Document]]:
    """Yields jobs with their places, those after a place; a job must have one of the wanted values."""
    first, index = (Mark(int(after[0]), str(after[1])), int(after[2]) + 1) if after else (START, 0)
    of_lines = {_FILTERS[name]: values for name, values in wanted.items()}
    for found in lines.found(first, of_lines):
        start = index if found.mark == first else 0
        for number, job in _jobs_of(store, found, start, wanted):
            if _is_wanted(job, wanted):
                yield (*found.mark, number), job


def _jobs_of(
    store: Store, found: Found, first: int, wanted: dict[str, frozenset[str]]
) -> Iterator[tuple[int, Document]]:
    if found.line and has_jobs(found.line):
        yield from jobs_of_line(found.line, first)
        return
    with left_out_if_strange(store, KIND, found.mark.id), suppress(ResourceNotFound):  # removed since it was found
        yield from Jobs(store, found.mark.id, found.record).listed(first, wanted.get("status", ()))


def _is_wanted(job: Document, wanted: dict[str, frozenset[str]]) -> bool:
    for name, values in wanted.items():
        own = {str(job["status"])} if name == "status" else set(cast("list[str]", job[APPLICATIONS[name]]))
        if values.isdisjoint(own):
            return False
    return True


def _summary(job: Document) -> SimulationJobSummary:
    return SimulationJobSummary.model_validate(job)
