"""`simyard cancel`: cancels a job, or the job under way of a run."""

from collections.abc import Collection
from contextlib import suppress

from flows.resource.kinds import KINDS
from specs.base import Fault
from specs.errors import DocumentError, ResourceNotFound, StageFailed
from specs.job_kinds import JOB_KINDS
from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import hold_claim_unless_alive
from tasks.storage.jobs.records import JobRecord, advance, is_terminal, read
from tasks.storage.jobs.runs import KIND as RUN
from tasks.storage.jobs.runs import jobs_of
from tasks.storage.resource_names import find_resource

REASON = "canceled on request"
CANCELED = "Canceled"
_GOING = frozenset({"Pending", "Running", "Canceling"})


def cancel_resource(store: Store, text: str) -> None:
    """Cancels a job or a run, by its ARN or id.

    A process that works on it stops within seconds; without one, it ends here and now.

    Raises:
        ResourceNotFound: The store has no such resource.
        DocumentError: It is of a kind that is not cancelled, or it has ended.
    """
    kind, path = find_resource(store, text, ("simulation-job", *JOB_KINDS))
    cancel_one = KINDS[kind].load().cancel
    if cancel_one is None:
        raise _refused(text, f"what can be cancelled; a {kind} cannot")
    cancel_one(store, path)


def cancel_run(store: Store, run: str) -> JobRecord:
    """Returns the record of a run that is being cancelled, or is Canceled at once if no process works on it.

    Its jobs that have ended keep their results; the one that is under way is cancelled, and no other begins.

    Raises:
        ResourceNotFound: No such run.
        DocumentError: It has ended.
    """
    record = advance(store, RUN, run, "Canceling", only_from=_GOING)
    if record.status != "Canceling":
        raise _refused(run, f"a run that is under way; this one is {record.status}")
    cancel_jobs(store, record)
    with hold_claim_unless_alive(store, claim_key(RUN, run)) as claim:
        return record if claim is None else end_canceled(store, record)


def end_canceled(store: Store, run: JobRecord) -> JobRecord:
    """Returns the record of a run, Canceled with the job that was under way; for who holds the run's claim."""
    advance(store, RUN, run.id, "Canceling", only_from=_GOING)
    cancel_jobs(store, run)
    return advance(
        store, RUN, run.id, "Canceled", failure_code="Canceled", failure_reason=REASON, only_from={"Canceling"}
    )


def cancel_jobs(store: Store, run: JobRecord, but_for: Collection[str] = ()) -> frozenset[str]:
    """Returns the ids of the jobs of a run that have not ended, having cancelled them.

    One that is about to end is left to that.

    Args:
        store: Where the run is.
        run: Whose jobs.
        but_for: Ids of jobs to leave alone.
    """
    found: set[str] = set()
    for kind, job in jobs_of(run):
        with suppress(ResourceNotFound):  # not begun
            record = read(store, kind, job)
            if job not in but_for and not is_terminal(record):
                found.add(job)
                with suppress(DocumentError):  # ended, or about to, since it was read
                    cancel_resource(store, record.arn)
    return frozenset(found)


def require_not_canceled(store: Store, run: JobRecord) -> None:
    """Does nothing while a run may begin its next stage.

    Raises:
        StageFailed: Somebody has cancelled it.
    """
    if read(store, RUN, run.id).status in {"Canceling", "Canceled"}:
        raise StageFailed("Canceled", REASON, run.arn)


def _refused(value: str, allowed: str) -> DocumentError:
    return DocumentError([Fault(path="arn", value=repr(value), allowed=allowed)], source="simyard")
