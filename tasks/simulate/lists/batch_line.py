"""The line of a batch: what lists say of it and, once it has ended, of each of its jobs.

A batch of ten thousand jobs that ended in three ways has three summaries and says which jobs have which. So a page of
its jobs reads no chunk.
"""

import json
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import cast

from pydantic import JsonValue

from specs.arn import arn, store_id_of
from specs.robomaker.simulation_descriptions import SimulationJobBatchSummary
from tasks.simulate.batch.job_states import Jobs
from tasks.simulate.plan.request import is_single
from tasks.storage.base.store import Store
from tasks.storage.jobs.lines.marks import mark_of
from tasks.storage.jobs.lines.segments import Line
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


def batch_line(store: Store, record: JobRecord) -> Line:
    """Returns the line of a batch as it stands."""
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
    return Line(
        mark_of(record.created_at_s, record.id), values, summary.model_dump(mode="json", exclude_none=True), detail
    )


def has_jobs(line: Line) -> bool:
    """Returns whether a line tells of a batch's jobs."""
    return _JOBS in line.detail


def jobs_of_line(line: Line, first: int) -> Iterator[tuple[int, Document]]:
    """Yields index and summary of each job of a batch that has ended, from an index on."""
    table = cast("Document", line.detail[_JOBS])
    summaries = cast("list[Document]", table[_SUMMARIES])
    store = store_id_of(str(line.summary["arn"]))
    for start, count, number in cast("list[list[int]]", table[_RUNS]):
        for index in range(max(start, first), start + count):
            own = {"arn": arn("simulation-job", store, f"{line.mark.id}/{index}"), "name": f"{line.mark.id}-{index}"}
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
