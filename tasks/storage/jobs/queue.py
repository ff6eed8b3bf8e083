"""The queue: which jobs wait for a worker.

A job's record says all that a worker needs. An entry of the queue is there only so that nobody has to read the whole
history of a store to find what waits. It is made before the record and removed after the record's end: whoever dies in
between leaves at worst an entry of a job that was never recorded, or one that has ended.
"""

import logging
import time
from collections.abc import Collection
from contextlib import suppress

from pydantic import Field, JsonValue

from specs.base import Spec
from specs.errors import ObjectExists, StoreAway, StoreError
from specs.job_kinds import JobKind
from tasks.storage.base.keys import claim_key, queue_key, queue_prefix
from tasks.storage.base.store import Entry, Store, decode_document, encode_document, find_document, update

_LOG = logging.getLogger(__name__)
_MOST_BYTES = 1 << 20  # of an entry, which has some hundred


class QueueEntry(Spec):
    """A job that waits for a worker, or that a worker is at.

    Attributes:
        queued_at_s: Seconds since 1970, by the clock of the machine that queued it.
        options: What the record has no place for, such as that a deployment job is a sync.
        attempts: How often a worker has begun with it since anything came of that.
        done: How far the job was when the last attempt began: worlds, episodes or robots; -1 if nobody has looked.
        begun_s: When it began, as ``queued_at_s``.
        not_before_s: When the next attempt may begin, as ``queued_at_s``.
        handed_over: How often it was handed to a work pool of Prefect's.
        flow_run: The flow run that it was handed over as; empty for none.
    """

    kind: JobKind
    id: str
    queued_at_s: float
    options: dict[str, JsonValue] = Field(default_factory=dict[str, JsonValue])
    attempts: int = 0
    done: int = -1
    begun_s: float = 0.0
    not_before_s: float = 0.0
    handed_over: int = 0
    flow_run: str = ""


def enqueue(store: Store, kind: JobKind, job: str, options: dict[str, JsonValue] | None = None) -> None:
    """Puts a job into the queue; one that is there keeps its place."""
    entry = QueueEntry(kind=kind, id=job, queued_at_s=time.time(), options=options or {})
    with suppress(ObjectExists):
        store.create(queue_key(kind, job), encode_document(entry))


def queued_jobs(store: Store) -> list[QueueEntry]:
    """Returns the queue, oldest first."""
    found = (find_document(store, key, QueueEntry, _MOST_BYTES) for key in store.keys(queue_prefix()))
    there = (entry for entry in found if entry)  # workers have removed the others since they were listed
    return sorted(there, key=lambda entry: (entry.queued_at_s, entry.id))


def queued_entry(store: Store, key: str) -> QueueEntry:
    """Returns one entry of the queue, by its key.

    Raises:
        ObjectNotFound: There is none.
        ObjectTooBig: It is larger than any entry.
    """
    return decode_document(QueueEntry, store.get(key, _MOST_BYTES), store, key)


def is_queued(store: Store, kind: JobKind, job: str) -> bool:
    """Returns whether a job waits for a worker, or a worker is at it."""
    return store.exists(queue_key(kind, job))


def leave_queue(store: Store, kind: JobKind, job: str) -> None:
    """Removes a job that has ended from the queue."""
    store.delete(queue_key(kind, job))


def turn_key(kind: JobKind, job: str) -> str:
    """Returns the key of the claim of a worker that has taken a job from the queue.

    It is another one than the job's: a worker takes it first, without waiting, and the stage takes the job's as it does
    for a document.
    """
    return claim_key(f"queue-{kind}", job)


def find_entry(store: Store, kind: JobKind, job: str) -> QueueEntry | None:
    """Returns a job's entry as it stands; None if it has left the queue."""
    return find_document(store, queue_key(kind, job), QueueEntry, _MOST_BYTES)


def change_entry(store: Store, kind: JobKind, job: str, **fields: JsonValue) -> QueueEntry | None:
    """Returns a job's entry after the change of some fields; None if it has left the queue."""

    def step(entry: QueueEntry | None) -> QueueEntry | None:
        return entry and entry.model_copy(update=fields)

    return update(store, queue_key(kind, job), QueueEntry, step)


class QueueView:
    """The queue as a process sees it that looks again and again: only what has changed is read.

    Args:
        store: Where it is.
        kinds: Of the jobs that are looked for.
    """

    def __init__(self, store: Store, kinds: Collection[JobKind]) -> None:
        self._store = store
        self._folders = [f"{queue_prefix()}/{kind}" for kind in kinds]
        self._known: dict[str, tuple[str, QueueEntry]] = {}
        self._damaged: dict[str, str] = {}

    def entries(self) -> list[QueueEntry]:
        """Returns the queue as it is now, oldest first."""
        listed = [entry for folder in self._folders for entry in self._store.entries(folder)]
        self._known = {entry.key: found for entry in listed if (found := self._current(entry))}
        return sorted((entry for _, entry in self._known.values()), key=lambda each: (each.queued_at_s, each.id))

    def _current(self, listed: Entry) -> tuple[str, QueueEntry] | None:
        known = self._known.get(listed.key)
        if known and known[0] == listed.mark:
            return known
        if self._damaged.get(listed.key) == listed.mark:
            return None
        try:
            found = find_document(self._store, listed.key, QueueEntry, _MOST_BYTES)
        except StoreAway:
            raise
        except StoreError as exc:  # the jobs of the others do not wait for it
            self._damaged[listed.key] = listed.mark
            _LOG.warning("an entry of the queue is passed by until somebody changes it: %s", exc)
            return None
        return (listed.mark, found) if found else None
