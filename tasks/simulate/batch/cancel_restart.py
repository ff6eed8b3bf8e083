"""Cancels a batch or one of its jobs, and restarts a running job, as RoboMaker's calls of these names do.

See docs/reference/robomaker.md, sections 3 and 4, and docs/decisions/0008.
"""

import time

from pydantic import JsonValue

from specs.base import Fault
from specs.errors import DocumentError
from tasks.simulate.batch.chunk_store import chunk_start, committed_chunk
from tasks.simulate.batch.job import GOING, KIND, canceled_job_mark, canceled_job_time, job_of, restarted_job_mark
from tasks.simulate.batch.job_states import Jobs
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance


def cancel_batch(store: Store, batch: str) -> JobRecord:
    """Returns the record of a batch that is being cancelled: who works on it stops within seconds.

    Episodes that are done keep their results; the others become Canceled. Cancelling it again changes nothing.

    Raises:
        ResourceNotFound: No such batch.
        DocumentError: It has ended, or is about to.
    """
    record = advance(store, KIND, batch, "Canceling", only_from=GOING | {"Canceling"})
    if record.status != "Canceling":
        raise _refused(batch, f"a batch that is in progress; this one is {record.status}")
    return record


def cancel_job(store: Store, path: str) -> None:
    """Cancels one job of a batch: the others do not notice, and the batch's lanes go on.

    Args:
        store: Where the batch is.
        path: ``<batch>/<index>``.

    Raises:
        ResourceNotFound: No such job, or its batch ended before it became one.
        DocumentError: It has ended, or its batch has, or is about to.
    """
    batch, index = job_of(store, path)
    chunk = batch.layout.chunk_of(index)
    begun = chunk_start(store, batch.id, chunk) is not None
    mark: dict[str, JsonValue] = {canceled_job_mark(index): begun, canceled_job_time(index): time.time()}
    ended = {row.index: row.status for row in committed_chunk(store, batch.id, chunk) or ()}
    record = batch.record()
    if index not in ended and record.status in GOING and mark.keys() <= record.detail.keys():
        return
    while index not in ended and record.status in GOING:
        # Only if the batch still stands as it was read: a mark on one that has ended would mean nothing.
        record = advance(store, KIND, batch.id, record.status, only_from={record.status}, detail=mark)
        if mark.keys() <= record.detail.keys():
            return
    Jobs(store, batch.id).require_job(index)
    status = ended.get(index, f"in a batch that is {record.status}")
    raise _refused(path, f"a job that has not ended; this one is {status}")


def _refused(value: str, allowed: str) -> DocumentError:
    return DocumentError([Fault(path="arn", value=repr(value), allowed=allowed)], source="simyard")


def restart_job(store: Store, path: str) -> None:
    """Marks a running job to be simulated once more, with the configuration and the bundles of its batch.

    Whoever works on it does so before its chunk is committed. Since a result follows from the request alone, the job's
    row is what it would have been.

    Args:
        store: Where the batch is.
        path: ``<batch>/<index>``.

    Raises:
        ResourceNotFound: No such job.
        DocumentError: It is not running: it has ended, was not begun, or is being stopped.
    """
    batch, index = job_of(store, path)
    mark = restarted_job_mark(index)
    while True:
        jobs = Jobs(store, batch.id)
        status = str(jobs.described(index)["status"])
        if status not in {"Running", "Restarting"} or jobs.record.status not in GOING:
            raise _not_running(path, status)
        # Only if the batch still stands as it was read: a mark on one that is being stopped would mean nothing.
        stood = jobs.record.status
        record = advance(store, KIND, batch.id, stood, only_from={stood}, detail={mark: time.time()})
        if record.status == stood and mark in record.detail:
            return


def _not_running(path: str, status: str) -> DocumentError:
    allowed = f"a job that is running; this one is {status}. To test new content of its applications, run the document"
    return DocumentError([Fault(path="arn", value=repr(path), allowed=f"{allowed} again")], source="simyard")
