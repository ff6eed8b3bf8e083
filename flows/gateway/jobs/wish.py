"""The wish to cancel a job, written down where whoever works on it looks; nobody waits here for its end."""

from specs.base import Fault
from specs.errors import DocumentError
from specs.job_kinds import JobKind
from tasks.storage.base.store import Store
from tasks.storage.jobs.queue import enqueue, leave_queue
from tasks.storage.jobs.records import JobRecord, advance

_STOPPED = frozenset({"Canceling", "Canceled"})


def wish_canceled(store: Store, kind: JobKind, job: str) -> JobRecord:
    """Returns the record of a job of worlds that is being cancelled; one that nobody has begun is Canceled at once.

    Cancelling it again changes nothing.

    Raises:
        ResourceNotFound: No such job.
        DocumentError: It has ended otherwise.
    """
    record = advance(store, kind, job, "Canceled", only_from={"Pending"})
    record = advance(store, kind, job, "Canceling", only_from={"Running"}) if record.status == "Running" else record
    if record.status not in _STOPPED:
        raise ended(record.arn, record.status)
    if record.status == "Canceled":
        leave_queue(store, kind, job)
    else:
        enqueue(store, kind, job)  # who worked on it may have died: a worker ends it
    return record


def ended(arn: str, status: str) -> DocumentError:
    """Returns the error that says that a job cannot be cancelled any more."""
    return DocumentError([Fault(path="job", value=arn, allowed=f"a job that is under way; this one is {status}")])
