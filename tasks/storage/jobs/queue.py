"""The queue: which jobs wait for a worker.

A job's record says all that a worker needs. An entry of the queue is there only so that nobody has to read the whole
history of a store to find what waits. It is made before the record and removed after the record's end: whoever dies in
between leaves at worst an entry of a job that was never recorded, or one that has ended.
"""

import time
from contextlib import suppress

from pydantic import Field, JsonValue

from specs.base import Spec
from specs.errors import ObjectExists, ObjectNotFound
from specs.job_kinds import JobKind
from tasks.storage.base.encoding import decode_document, encode_document
from tasks.storage.base.keys import queue_key, queue_prefix
from tasks.storage.base.store import Store


class QueueEntry(Spec):
    """A job that waits for a worker, or that a worker is at.

    Attributes:
        queued_at_s: Seconds since 1970, by the clock of the machine that queued it.
        options: What the record has no place for, such as that a deployment job is a sync.
    """

    kind: JobKind
    id: str
    queued_at_s: float
    options: dict[str, JsonValue] = Field(default_factory=dict[str, JsonValue])


def enqueue(store: Store, kind: JobKind, job: str, options: dict[str, JsonValue] | None = None) -> None:
    """Puts a job into the queue; one that is there keeps its place."""
    entry = QueueEntry(kind=kind, id=job, queued_at_s=time.time(), options=options or {})
    with suppress(ObjectExists):
        store.create(queue_key(kind, job), encode_document(entry))


def queued_jobs(store: Store) -> list[QueueEntry]:
    """Returns the queue, oldest first."""
    found: list[QueueEntry] = []
    for key in store.keys(queue_prefix()):
        try:
            found.append(queued_entry(store, key))
        except ObjectNotFound:  # a worker has removed it since it was listed
            continue
    return sorted(found, key=lambda entry: (entry.queued_at_s, entry.id))


def queued_entry(store: Store, key: str) -> QueueEntry:
    """Returns one entry of the queue, by its key.

    Raises:
        ObjectNotFound: There is none.
    """
    return decode_document(QueueEntry, store.get(key), store, key)


def is_queued(store: Store, kind: JobKind, job: str) -> bool:
    """Returns whether a job waits for a worker, or a worker is at it."""
    return store.exists(queue_key(kind, job))


def leave_queue(store: Store, kind: JobKind, job: str) -> None:
    """Removes a job that has ended from the queue."""
    store.delete(queue_key(kind, job))
