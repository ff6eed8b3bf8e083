"""How many jobs of a kind may wait or be worked on at once, by the queue.

A call puts its job into the queue before it counts, and takes it out again if there are too many. Two gateways at once
therefore never admit one too many where the store's listings are current, as they are in a folder and on S3; of two
calls for the last place both may be refused. Jobs of `simyard run` are not in the queue and do not count.
"""

from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

from pydantic import JsonValue

from specs import settings
from specs.base import Fault
from specs.errors import LimitExceeded, ObjectNotFound, ResourceNotFound
from specs.job_kinds import JobKind
from tasks.storage.base.keys import queue_prefix
from tasks.storage.base.store import Store
from tasks.storage.jobs.queue import QueueEntry, enqueue, is_queued, leave_queue, queued_entry
from tasks.storage.jobs.records import is_terminal, read

SINGLE = "single"
"""The option of a batch's entry that says that it is a single simulation job."""


class Quota(NamedTuple):
    """A quota of RoboMaker's (docs/reference/robomaker.md, section 9).

    Attributes:
        what: What is counted.
        setting: The variable that sets it.
        most: Returns how many there may be.
        counts: Whether an entry of the queue is one.
    """

    what: str
    setting: str
    most: Callable[[], int]
    counts: Callable[[QueueEntry], bool] = lambda _: True


GENERATION_JOBS = Quota("world generation jobs", settings.MAX_GENERATION_JOBS, settings.max_generation_jobs)
EXPORT_JOBS = Quota("world export jobs", settings.MAX_EXPORT_JOBS, settings.max_export_jobs)
BATCHES = Quota(
    "simulation job batches", settings.MAX_BATCHES, settings.max_batches, lambda entry: not entry.options.get(SINGLE)
)
SIMULATION_JOBS = Quota(
    "simulation jobs",
    settings.MAX_SIMULATION_JOBS,
    settings.max_simulation_jobs,
    lambda entry: bool(entry.options.get(SINGLE)),
)
DEPLOYMENTS = Quota("deployment jobs", settings.MAX_DEPLOYMENTS, settings.max_deployments)


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
    most = quota.most()
    keys = store.keys(f"{queue_prefix()}/{kind}")
    # Only a full queue is read: some of it may have ended, or be of the other sort.
    if len(keys) <= most or len(_waiting(store, kind, quota, keys)) <= most:
        return
    allowed = f"at most {most} at a time ({quota.setting}); wait for one, or cancel one"
    raise LimitExceeded([Fault(path="request", value=f"one more of the {quota.what}", allowed=allowed)], "request")


def _waiting(store: Store, kind: JobKind, quota: Quota, keys: Sequence[str]) -> list[QueueEntry]:
    entries = [entry for key in keys if (entry := _entry(store, key)) and quota.counts(entry)]
    return [entry for entry in entries if not _has_ended(store, kind, entry.id)]


def _entry(store: Store, key: str) -> QueueEntry | None:
    try:
        return queued_entry(store, key)
    except ObjectNotFound:  # a worker has removed it since it was listed
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
