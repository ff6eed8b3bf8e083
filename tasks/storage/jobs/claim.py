"""Claims: one live process at a time works on a job.

A claim is an object that its holder rewrites by compare-and-swap three times within ``ttl_s``. Another process takes it
over when it was released, when its holder is known to be dead (same host), or when it has not changed for ``ttl_s`` by
the other process's own clock, so that no two machines' clocks are ever compared (Gray and Cheriton 1989, Leases). Each
taking raises the epoch by one.

A holder that was paused may wake up after it was replaced: it must look at ``Claim.lost`` before it acts, and what it
writes must be harmless anyway (created once, or compared and swapped).

A claim may also be released on behalf of a holder that shows no life (``ClaimWatch``), so that nobody has to watch it
again. A holder that was only paused takes it back with its next heartbeat, unless another one was faster.
"""

import logging
import os
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from contextvars import copy_context
from functools import partial
from pathlib import Path
from uuid import uuid4

from specs.base import Spec
from specs.errors import ObjectConflict, ObjectExists, ObjectNotFound, StoreError
from tasks.storage.base.store import Store, decode_document, encode_document

_PROC = Path("/proc")
_ENDED_STATES = frozenset("ZX")
_LOG = logging.getLogger(__name__)
_LONGEST_POLL_S = 0.2
# How often a holder renews its claim in the time that it is good for.
_BEATS = 3


class ProcessIdentity(Spec):
    """One process, never mistaken for a later one that was given the same number.

    Attributes:
        host: The running kernel and the space in which ``pid`` counts (containers have their own); empty where the
            system does not tell.
        pid: The process's number.
        started: When it started, in the kernel's ticks since boot; empty where the system does not tell.
    """

    host: str
    pid: int
    started: str


def this_process() -> ProcessIdentity:
    """Returns the identity of the calling process."""
    return process_of(os.getpid())


def process_of(pid: int) -> ProcessIdentity:
    """Returns the identity of the process that has the number now; one that has ended has no start."""
    state = _state_and_start(pid)
    return ProcessIdentity(host=_host(), pid=pid, started=state[1] if state else "")


def is_known_dead(process: ProcessIdentity) -> bool:
    """Returns whether the process certainly runs no more; False for one on another host, of which nothing is known."""
    if not process.started or not process.host or process.host != _host():
        return False
    state = _state_and_start(process.pid)
    return state is None or state[1] != process.started or state[0] in _ENDED_STATES


def _host() -> str:
    try:
        boot = (_PROC / "sys/kernel/random/boot_id").read_text().strip()
        space = (_PROC / "self/ns/pid").readlink()
    except OSError:
        return ""
    return f"{boot} {space}"


def _state_and_start(pid: int) -> tuple[str, str] | None:
    # proc(5): the name in brackets may hold anything; state is the field behind it, the start time the 20th.
    try:
        fields = (_PROC / str(pid) / "stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    return fields[0], fields[19]


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
        while not self._replaced and not self._ended.wait(self._record.ttl_s / _BEATS):
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


class ClaimWatch:
    """Looks at a claim again and again; its holder is gone when nobody has renewed it for the time it is good for.

    Args:
        store: Where the claim lies.
        key: See ``tasks.storage.base.keys.claim_key``.
        now_s: A clock that never goes back.
    """

    def __init__(self, store: Store, key: str, now_s: Callable[[], float] = time.monotonic) -> None:
        self._store = store
        self._key = key
        self._now_s = now_s
        self._seen = ""
        self._found: ClaimRecord | None = None
        self._since_s = 0.0
        self._writes = 0

    @property
    def renewed(self) -> bool:
        """Whether somebody was seen to write it: its holder lives, or another one took it."""
        return self._writes > 1

    def is_left(self) -> bool:
        """Returns whether nobody works on it as far as can be told from what was seen until now."""
        try:
            stored = self._store.get(self._key)
        except ObjectNotFound:
            self._found = None
            return True
        if stored.etag != self._seen:
            self._seen, self._since_s = stored.etag, self._now_s()
            self._writes += 1
        found = self._found = decode_document(ClaimRecord, stored, self._store, self._key)
        return found.released or self._now_s() - self._since_s >= found.ttl_s or is_known_dead(found.process)

    def release(self) -> bool:
        """Returns whether the claim is free now, having released it on behalf of a holder that left it.

        Only exactly what was seen is written over, so that a holder which renews it at the same moment keeps it; one
        that was paused takes it back when it wakes up, and is first, or finds itself replaced.
        """
        if self._found is None or self._found.released:
            return True
        try:
            body = encode_document(self._found.model_copy(update={"released": True}))
            self._seen = self._store.replace(self._key, body, self._seen)
        except (ObjectConflict, ObjectNotFound):
            return False
        return True
