"""RestartSimulationJob (semantics 3, docs/decisions/0008): a running job is simulated once more before it ends."""

import time

from specs.base import Fault
from specs.errors import DocumentError
from tasks.simulate.batch import GOING, KIND, job_of, restarted_job_mark
from tasks.simulate.job_states import Jobs
from tasks.storage.records import advance
from tasks.storage.store import Store


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
