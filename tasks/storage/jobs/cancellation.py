"""Cancels a job whose worker looks at its record: world generation and export."""

from specs.base import Fault
from specs.errors import DocumentError
from specs.job_kinds import JobKind
from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import hold_claim_unless_alive
from tasks.storage.jobs.records import JobRecord, advance

_GOING = frozenset({"Pending", "Running", "Canceling"})


def cancel_watched_job(store: Store, kind: JobKind, job: str) -> JobRecord:
    """Returns the record of a job that is being cancelled, or is Canceled at once where nobody works on it.

    Raises:
        ResourceNotFound: No such job.
        DocumentError: It has ended.
    """
    record = advance(store, kind, job, "Canceling", only_from=_GOING)
    if record.status != "Canceling":
        fault = Fault(path="arn", value=repr(job), allowed=f"a job that is under way; this one is {record.status}")
        raise DocumentError([fault], source="simyard")
    with hold_claim_unless_alive(store, claim_key(kind, job)) as claim:
        if claim is None:
            return record
        return advance(store, kind, job, "Canceled", only_from={"Canceling"})
