"""`simyard cancel`: what an ARN names is cancelled, whatever its kind; of a run of a document, the job under way."""

import logging
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress

from specs.arn import ResourceKind, parse_reference, run_id
from specs.base import Fault
from specs.errors import DocumentError, ResourceNotFound, StageFailed, StoreError
from tasks.deploy.rollout.operator_commands import steer
from tasks.simulate.batch.cancel_restart import cancel_batch, cancel_job
from tasks.simulate.batch.job import KIND as BATCH
from tasks.simulate.batch.job import STOPPING
from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.cancellation import cancel_job as cancel_making
from tasks.storage.jobs.claim import claimed_unless_alive
from tasks.storage.jobs.records import JobRecord, advance, is_terminal, read, records
from tasks.storage.jobs.runs import KIND as RUN
from tasks.storage.jobs.runs import jobs_of

REASON = "canceled on request"
_GOING = frozenset({"Pending", "Running", "Canceling"})
_CANCEL: Mapping[ResourceKind, Callable[[Store, str], object]] = {
    "simulation-job-batch": cancel_batch,
    "simulation-job": cancel_job,
    "world-generation-job": lambda store, path: cancel_making(store, "world-generation-job", path),
    "world-export-job": lambda store, path: cancel_making(store, "world-export-job", path),
    "deployment-job": lambda store, path: steer(store, path, "cancel"),
}
logger = logging.getLogger(__name__)


def cancel(store: Store, text: str) -> None:
    """Cancels what an ARN names: whoever works on it stops within seconds; where nobody does, it ends here and now.

    Raises:
        ResourceNotFound: The store has no such resource.
        DocumentError: The text is no ARN, or its kind is none that is cancelled, or it has ended.
    """
    if run := run_id(text):
        cancel_run(store, run)
        return
    try:
        reference = parse_reference(text)
    except ValueError as exc:
        raise _refused(text, str(exc)) from exc
    if reference.kind is None or reference.kind not in _CANCEL:
        raise _refused(text, f"an ARN of a {' or '.join([*_CANCEL, RUN])}")
    _CANCEL[reference.kind](store, reference.path)
    if reference.kind in {"simulation-job", BATCH}:
        close_stopped_batch(store, reference.path)


def cancel_run(store: Store, run: str) -> JobRecord:
    """Returns the record of a run that is being cancelled, or is Canceled at once where nobody works on it.

    Its jobs that have ended keep their results; the one that is under way is cancelled, and no other begins.

    Raises:
        ResourceNotFound: No such run.
        DocumentError: It has ended.
    """
    record = advance(store, RUN, run, "Canceling", only_from=_GOING)
    if record.status != "Canceling":
        raise _refused(run, f"a run that is under way; this one is {record.status}")
    cancel_jobs(store, record)
    with claimed_unless_alive(store, claim_key(RUN, run)) as claim:
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
                    cancel(store, record.arn)
    return frozenset(found)


def require_not_canceled(store: Store, run: JobRecord) -> None:
    """Does nothing while a run may begin its next stage.

    Raises:
        StageFailed: Somebody has cancelled it.
    """
    if read(store, RUN, run.id).status in {"Canceling", "Canceled"}:
        raise StageFailed("Canceled", REASON, run.arn)


def close_stopped_batch(store: Store, path: str) -> str:
    """Returns ``<batch>`` or ``<batch>/<index>`` as it stands, having closed a batch that was stopped and left.

    One that cannot be closed now, its output bucket being gone, is told as it is: the others are none the worse for it.
    """
    batch = path.partition("/")[0]
    if read(store, BATCH, batch).status in STOPPING:
        from flows.batch.batch_end import settled  # noqa: PLC0415 - it imports MuJoCo and Arrow, which describing does not need

        try:
            settled(store, batch)
        except StoreError as exc:
            logger.warning("batch %s was stopped and cannot be closed: %s", batch, exc)
    return path


def close_stopped_batches(store: Store) -> Store:
    """Returns the store, having closed every batch that was stopped and left."""
    for record in records(store, BATCH):
        close_stopped_batch(store, record.id)
    return store


def _refused(value: str, allowed: str) -> DocumentError:
    return DocumentError([Fault(path="arn", value=repr(value), allowed=allowed)], source="simyard")
