"""Claims: one live process at a time works on a job.

A claim is an object that its holder rewrites by compare-and-swap three times within ``ttl_s``. Another process takes it
over when it was released, when its holder is known to be dead (same host), or when it has not changed for ``ttl_s`` by
the other process's own clock, so that no two machines' clocks are ever compared (Gray and Cheriton 1989, Leases). Each
taking raises the epoch by one.

A holder that was paused may wake up after it was replaced: it must look at ``Claim.lost`` before it acts, and what it
writes must be harmless anyway (created once, or compared and swapped).

A claim may also be released on behalf of a holder that shows no life (tasks.storage.jobs.claim_state), so that nobody
has to watch it again. A holder that was only paused takes it back with its next heartbeat, unless another one was
faster.
"""

import logging
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from contextvars import copy_context
from functools import partial
from uuid import uuid4

from specs.base import Spec
from specs.errors import ObjectConflict, ObjectExists, ObjectNotFound, StoreError
from tasks.storage.base.encoding import decode_document, encode_document
from tasks.storage.base.store import Store
from tasks.storage.jobs.holder import ProcessIdentity, is_known_dead, this_process

_LOG = logging.getLogger(__name__)
_LONGEST_POLL_S = 0.2
_held: set[tuple[str, str, int]] = set()


class ClaimRecord(Spec):
    """What the claim's object holds.

    Attributes:
        owner: Random, one for each taking.
        process: Who took it.
        epoch: How many takings there were, this one included.
        beat: How often it was renewed; what makes each write differ from the one before.
        ttl_s: How long it may stay unchanged before others may take it.
        released: Whether the holder is done.
    """

    owner: str
    process: ProcessIdentity
    epoch: int
    beat: int
    ttl_s: float
    released: bool


class Claim:
    """A claim that this process took, and renews until it is released."""

    def __init__(self, store: Store, key: str, record: ClaimRecord, etag: str, taken_s: float) -> None:
        self._store = store
        self._key = key
        self._record = record
        self._etag = etag
        self._renewed_s = taken_s  # monotonic, from before the request was sent: the safe side
        self._replaced = False
        self._ended = threading.Event()
        beat = partial(copy_context().run, self._beat)  # what it logs is the run's that holds the claim
        self._heart = threading.Thread(target=beat, name=f"claim {key}", daemon=True)
        self._heart.start()

    @property
    def epoch(self) -> int:
        """How many takings of this claim there were, this one included."""
        return self._record.epoch

    @property
    def replaced(self) -> bool:
        """Whether another process is known to hold it; that never changes again."""
        return self._replaced

    @property
    def lost(self) -> bool:
        """Whether another process may hold it by now; until that turns out to be wrong, nothing may be written.

        It does when a renewal arrives after all: it would not have, had another process taken the claim meanwhile.
        """
        return self._replaced or time.monotonic() - self._renewed_s >= self._record.ttl_s

    def release(self) -> None:
        """Ends the heartbeat and lets the next process in at once."""
        self._ended.set()
        self._heart.join()
        if self._replaced:
            return
        try:
            self._write(self._record.model_copy(update={"released": True}))
        except StoreError as exc:  # the next process waits for ttl_s instead
            _LOG.warning("%s could not be released: %s", self._key, exc)

    def _beat(self) -> None:
        while not self._replaced and not self._ended.wait(self._record.ttl_s / 3):
            before_s = time.monotonic()
            try:
                self._write(self._record.model_copy(update={"beat": self._record.beat + 1}))
            except StoreError as exc:  # the store may come back; if it does not in time, `lost` tells
                _LOG.warning("%s could not be renewed: %s", self._key, exc)
            else:
                self._renewed_s = before_s

    def _write(self, record: ClaimRecord) -> None:
        try:
            self._etag = self._store.replace(self._key, encode_document(record), self._etag)
        except ObjectConflict:
            self._look_again()
            if self._replaced:
                raise
            self._etag = self._store.replace(self._key, encode_document(record), self._etag)
        self._record = record

    def _look_again(self) -> None:
        # An earlier write whose answer never came also changes the object, and leaves it ours; so does who released it
        # because nothing was heard of us.
        try:
            stored = self._store.get(self._key)
        except ObjectNotFound:
            self._replaced = True
            return
        found = decode_document(ClaimRecord, stored, self._store, self._key)
        self._replaced = found.owner != self._record.owner
        self._etag = stored.etag


def _nobody(_holder: ClaimRecord) -> None:
    """Drops what is told: nobody watches."""


@contextmanager
def hold_claim(
    store: Store, key: str, *, ttl_s: float = 15.0, waiting: Callable[[ClaimRecord], None] = _nobody
) -> Generator[Claim]:
    """Takes the claim, waiting while another live process holds it; releases it at the end.

    Args:
        store: Where the claim lies.
        key: See ``tasks.storage.base.keys.claim_key``.
        ttl_s: Seconds without a heartbeat after which other processes take the claim over.
        waiting: Told several times a second who holds it, for as long as somebody does.

    Raises:
        StoreError: This very thread holds the claim already, or the store fails.
    """
    mark = (store.url, key, threading.get_ident())
    if mark in _held:
        raise StoreError(f"{store.url}: {key} is held by this very thread, which would wait for itself")
    while (claim := _take(store, key, ttl_s, waiting)) is None:
        pass
    with _holding(claim, mark):
        yield claim


@contextmanager
def hold_claim_unless_alive(store: Store, key: str, *, ttl_s: float = 15.0) -> Generator[Claim | None]:
    """Takes the claim, or yields None as soon as its holder is seen to renew it; releases it at the end.

    Whether a holder elsewhere lives is found out by watching, so this takes up to the time without a heartbeat after
    which the holder itself knows that it has lost.

    Args:
        store: Where the claim lies.
        key: See ``tasks.storage.base.keys.claim_key``.
        ttl_s: Seconds without a heartbeat after which other processes take the claim over.

    Raises:
        StoreError: The store fails.
    """
    claim = _take(store, key, ttl_s)
    if claim is None:
        yield None
        return
    with _holding(claim, (store.url, key, threading.get_ident())):
        yield claim


@contextmanager
def _holding(claim: Claim, mark: tuple[str, str, int]) -> Generator[None]:
    _held.add(mark)
    try:
        yield
    finally:
        _held.discard(mark)
        claim.release()


def _take(store: Store, key: str, ttl_s: float, waiting: Callable[[ClaimRecord], None] = _nobody) -> Claim | None:
    """Returns the claim, or None when somebody else was seen to write it: its holder, or who was faster."""
    watched, since_s = "", time.monotonic()
    while True:
        try:
            stored = store.get(key)
        except ObjectNotFound:
            return _write_first(store, key, _new_record(1, ttl_s), None)
        found = decode_document(ClaimRecord, stored, store, key)
        if _is_free(found, time.monotonic() - since_s if stored.etag == watched else 0.0):
            _LOG.debug("%s: process %d had it, released: %s", key, found.process.pid, found.released)
            return _write_first(store, key, _new_record(found.epoch + 1, ttl_s), stored.etag)
        if watched and stored.etag != watched:
            return None
        if not watched:
            watched, since_s = stored.etag, time.monotonic()
        waiting(found)
        time.sleep(min(_LONGEST_POLL_S, found.ttl_s / 10))


def _is_free(found: ClaimRecord, unchanged_s: float) -> bool:
    return found.released or unchanged_s >= found.ttl_s or is_known_dead(found.process)


def _write_first(store: Store, key: str, record: ClaimRecord, etag: str | None) -> Claim | None:
    before_s = time.monotonic()
    try:
        etag = (
            store.create(key, encode_document(record))
            if etag is None
            else store.replace(key, encode_document(record), etag)
        )
    except (ObjectExists, ObjectConflict):  # another process was faster
        return None
    return Claim(store, key, record, etag, before_s)


def _new_record(epoch: int, ttl_s: float) -> ClaimRecord:
    owner = uuid4().hex
    return ClaimRecord(owner=owner, process=this_process(), epoch=epoch, beat=0, ttl_s=ttl_s, released=False)
