"""How many jobs of a kind may wait or be worked on at once, by the queue.

A call puts its job into the queue before it counts, and takes it out again if there are too many. Two gateways at once
therefore never admit one too many where the store's listings are current, as they are in a folder and on S3; of two
calls for the last place both may be refused. Jobs of `simyard run` are not in the queue and do not count.
"""

from collections.abc import Generator, Sequence
from contextlib import contextmanager

from pydantic import JsonValue

from specs.base import Fault
from specs.errors import LimitExceeded, ObjectNotFound, ObjectStrange, ResourceNotFound
from specs.interface.quotas import SIMULATION_JOBS, Quota
from specs.job_kinds import JobKind
from tasks.storage.base.keys import queue_prefix
from tasks.storage.base.store import Store
from tasks.storage.jobs.queue import QueueEntry, enqueue, is_queued, leave_queue, queued_entry
from tasks.storage.jobs.records import is_terminal, read

SINGLE = "single"
"""The option of a batch's entry that says that it is a single simulation job."""


@contextmanager
def require_place(
    store: Store, kind: JobKind, job: str, quota: Quota, options: dict[str, JsonValue]
) -> Generator[None]:
    """Puts a job into the queue, to be recorded inside the ``with`` block; takes it out again if that fails.

    Raises:
        LimitExceeded: There are too many; the job is not in the queue.
    """
    enqueue(store, kind, job, options)
    try:
        require_room(store, kind, quota)
        yield
    except BaseException:
        _withdraw(store, kind, job, options)
        raise


def require_room(store: Store, kind: JobKind, quota: Quota) -> None:
    """Does nothing while the queue holds no more jobs than there may be.

    Raises:
        LimitExceeded: It holds more.
    """
    most, single = quota.most(), quota is SIMULATION_JOBS
    keys = store.keys(f"{queue_prefix()}/{kind}")
    # Only a full queue is read: some of it may have ended, or be of the other sort.
    if len(keys) <= most or len(_waiting(store, kind, keys, single=single)) <= most:
        return
    allowed = f"at most {most} {quota.what} ({quota.setting}); wait for one, or cancel one"
    raise LimitExceeded([Fault(path="request", value="one more", allowed=allowed)], "request")


def _waiting(store: Store, kind: JobKind, keys: Sequence[str], *, single: bool) -> list[QueueEntry]:
    entries = [entry for key in keys if (entry := _entry(store, key)) and bool(entry.options.get(SINGLE)) == single]
    return [entry for entry in entries if not _has_ended(store, kind, entry.id)]


def _entry(store: Store, key: str) -> QueueEntry | None:
    try:
        return queued_entry(store, key)
    except (ObjectNotFound, ObjectStrange):  # a worker has removed it since it was listed, or a stranger wrote it
        return None


def _has_ended(store: Store, kind: JobKind, job: str) -> bool:
    try:
        return is_terminal(read(store, kind, job))
    except ResourceNotFound:  # about to be recorded
        return False


def _withdraw(store: Store, kind: JobKind, job: str, options: dict[str, JsonValue]) -> None:
    """Takes an entry out again, unless the same call elsewhere has recorded the job by now."""
    leave_queue(store, kind, job)
    try:
        read(store, kind, job)
    except ResourceNotFound:
        return
    if not is_queued(store, kind, job):
        enqueue(store, kind, job, options)
