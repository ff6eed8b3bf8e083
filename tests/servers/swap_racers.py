"""What child processes do to a store in the races of its compare-and-swap, each noting what the store acknowledged."""

import hashlib
import json
import random
import time
from collections import Counter
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Protocol, cast

from specs.errors import ObjectConflict, ObjectExists, ObjectNotFound
from specs.robomaker.bundle import Application, Build
from tasks.applications.versions import change, with_version
from tasks.storage.base.store import Entry, Store
from tasks.storage.jobs.claim import ProcessIdentity, hold_claim, is_known_dead, this_process
from tasks.storage.jobs.records import advance
from tasks.storage.store_url import open_store
from tests.servers.racers import wait_for_all

JOB = "world-generation-job"


@dataclass
class RaceNotes:
    """What a process did.

    Attributes:
        done: What was acknowledged, in order.
        operations: How many requests to change something were made, refused ones too.
        wrong: What must never be.
    """

    done: list[str] = field(default_factory=list[str])
    operations: int = 0
    wrong: list[str] = field(default_factory=list[str])


class Race(Protocol):
    """What a process does with keys of a store for some seconds, under a name of its own."""

    __name__: str

    def __call__(self, url: str, me: str, keys: list[str], seconds: float, /) -> RaceNotes:
        """Returns what it did."""
        ...


def append_for(url: str, me: str, keys: list[str], seconds: float, log: str = "") -> RaceNotes:
    """Appends to the lists under the keys, as what nobody else appends; ``done`` has ``key name`` of each.

    Args:
        url: The store.
        me: The process's name.
        keys: Where the lists are.
        seconds: How long.
        log: A file that is told of each attempt and each success as it happens, for a process that is killed.
    """
    store, chance = open_store(url), _chance(me)
    if not log:
        wait_for_all()
    notes, end_s = RaceNotes(), time.monotonic() + seconds
    for number in _until(end_s):
        key, item = chance.choice(keys), f"{me}-{number}"
        _note(log, f"try {key} {item}")
        notes.operations += 1
        stale = _append(store, key, item)
        if stale is None:
            continue
        notes.done.append(f"{key} {item}")
        _note(log, f"done {key} {item}")
        if stale and chance.random() < 0.2:
            notes.operations += 1
            notes.wrong += _if_accepted(store, key, stale)
    return notes


def _append(store: Store, key: str, item: str) -> str | None:
    """Returns the etag that was written over ("" for a creation), or None if another was faster."""
    try:
        found = store.get(key)
        body = json.dumps([*cast("list[str]", json.loads(found.body)), item]).encode()
        etag = store.replace(key, body, found.etag)
    except ObjectNotFound:
        return _append_first(store, key, item)
    except ObjectConflict:
        return None
    return found.etag if etag != found.etag else None


def _append_first(store: Store, key: str, item: str) -> str | None:
    try:
        store.create(key, json.dumps([item]).encode())
    except ObjectExists:
        return None
    return ""


def _if_accepted(store: Store, key: str, stale: str) -> list[str]:
    try:
        store.replace(key, b'["written with a stale etag"]', stale)
    except ObjectConflict:
        return []
    return [f"{key}: a stale etag was accepted"]


def lock_for(url: str, me: str, keys: list[str], seconds: float) -> RaceNotes:
    """Makes and removes the keys again and again, as locks of counters; ``done`` has the key of each.

    Whoever has a lock tries what it knows of the time before, when it had the same lock: an etag, and an entry.
    """
    store, chance, known = open_store(url), _chance(me), dict[str, tuple[str, Entry]]()
    wait_for_all()
    notes, end_s = RaceNotes(), time.monotonic() + seconds
    for number in _until(end_s):
        key = chance.choice(keys)
        notes.operations += 1
        try:
            etag = store.create(key, f"{me}-{number:09}".encode())
        except ObjectExists:
            continue
        notes.wrong += _try_what_was(store, key, *known[key]) if key in known else []
        known[key] = (etag, store.entry(key))
        count_up(store, f"{key}-count")
        if store.get(key).body != f"{me}-{number:09}".encode():
            notes.wrong.append(f"{key}: the lock is another's")
        notes.done.append(key)
        notes.operations += 2
        _remove(store, key, known[key][1], notes)
    return notes


def _try_what_was(store: Store, key: str, etag: str, entry: Entry) -> list[str]:
    wrong = _if_accepted(store, key, etag)
    if store.delete_unchanged(entry):
        wrong.append(f"{key}: what was made anew was removed as what it was before")
    return wrong


def _remove(store: Store, key: str, entry: Entry, notes: RaceNotes) -> None:
    if len(notes.done) % 2:
        store.delete(key)
    elif not store.delete_unchanged(entry):
        notes.wrong.append(f"{key}: what nobody changed was not removed")


def count_up(store: Store, key: str) -> None:
    """Adds one to a counter, without looking whether anybody else does."""
    try:
        count = int(store.get(key).body)
    except ObjectNotFound:
        count = 0
    store.put(key, str(count + 1).encode())


def read_and_put_for(url: str, me: str, keys: list[str], seconds: float) -> RaceNotes:
    """Writes bodies that begin with the digest of the rest over one another, and reads them; ``done`` has each key."""
    store, chance = open_store(url), _chance(me)
    wait_for_all()
    notes, end_s = RaceNotes(), time.monotonic() + seconds
    for _ in _until(end_s):
        key, rest = chance.choice(keys), chance.randbytes(chance.choice((10, 10_000, 300_000)))
        store.put(key, hashlib.sha256(rest).digest() + rest)
        found = store.get(key).body
        if hashlib.sha256(found[32:]).digest() != found[:32]:
            notes.wrong.append(f"{key}: {len(found)} bytes of two writers")
        notes.done.append(key)
        notes.operations += 2
    return notes


def add_versions_for(url: str, me: str, names: list[str], seconds: float) -> RaceNotes:
    """Adds versions to applications; ``done`` has ``name number`` of each."""
    store, chance = open_store(url), _chance(me)
    wait_for_all()
    notes, end_s = RaceNotes(), time.monotonic() + seconds
    for number in _until(end_s):
        name, digest = chance.choice(names), hashlib.sha256(f"{me}-{number}".encode()).hexdigest()
        after = change(store, "robot-application", name, partial(_with_one_more, name, digest))
        made = [version.number for version in after.versions if version.digest == digest]
        notes.done += [f"{name} {each}" for each in made]
        notes.operations += 1
        if len(made) != 1:
            notes.wrong.append(f"{name}: {digest} has {len(made)} versions")
    return notes


def _with_one_more(name: str, digest: str, before: Application | None, number: int) -> Application:
    found = before or Application(kind="robot-application", name=name, versions=())
    found = found.model_copy(update={"versions": found.versions[-10:]})  # there may be forty
    build = Build(architecture="X86_64", digest=digest, size_bytes=1)
    return with_version(found, [build], whole=True, shipped=False, number=number)


def advance_for(url: str, me: str, ids: list[str], seconds: float) -> RaceNotes:
    """Advances jobs, each time with a new detail, and ends them; ``done`` has ``id detail`` of each."""
    store, chance = open_store(url), _chance(me)
    wait_for_all()
    notes, end_s = RaceNotes(), time.monotonic() + seconds
    for number in _until(end_s):
        wanted, detail = chance.choice(ids), f"{me}-{number}"
        record = advance(store, JOB, wanted, "Running", detail={detail: number})
        notes.done.append(f"{wanted} {detail}")
        notes.operations += 1
        if detail not in record.detail:
            notes.wrong.append(f"{wanted}: {detail} is missing from what was acknowledged")
    wait_for_all()
    for wanted in ids:
        record = advance(store, JOB, wanted, "Completed", detail={"ended_by": me})
        notes.done.append(f"{wanted} ended by {record.detail['ended_by']}")
    return notes


def claim_for(url: str, me: str, keys: list[str], seconds: float, folder: str = "") -> RaceNotes:
    """Takes claims again and again, and counts up what nothing else protects; ``done`` has ``key epoch`` of each.

    Args:
        url: The store.
        me: The process's name.
        keys: Of the claims.
        seconds: How long.
        folder: Where who has a claim shows it, for processes that are killed.
    """
    store, chance = open_store(url), _chance(me)
    if not folder:
        wait_for_all()
    notes, end_s = RaceNotes(), time.monotonic() + seconds
    for _ in _until(end_s):
        key = chance.choice(keys)
        with hold_claim(store, key, ttl_s=30.0) as claim, _shown(folder, key, claim.epoch):
            count_up(store, f"counts/{key}")
            notes.done.append(f"{key} {claim.epoch}")
            notes.operations += 3
    return notes


@contextmanager
def _shown(folder: str, key: str, epoch: int) -> Generator[None]:
    """Shows who is where only one may be; notes in the file ``wrong`` if another one is, who lives."""
    if not folder:
        yield
        return
    mine = Path(folder, key.replace("/", "-"))
    if mine.exists() and (other := mine.read_text()) and not is_known_dead(ProcessIdentity.model_validate_json(other)):
        _note(f"{folder}/wrong", f"{key}: {other} is there too")
    mine.write_text(this_process().model_dump_json())
    _note(f"{folder}/epochs", f"{key} {epoch}")
    yield
    mine.write_text("")


def doubled(names: list[str]) -> list[str]:
    """Returns the names that are there more than once."""
    return [name for name, count in Counter(names).items() if count > 1]


def appended(store: Store, keys: list[str]) -> list[str]:
    """Returns what lies in the lists, as `append_for` notes it."""
    found: list[str] = []
    for key in keys:
        found += [f"{key} {item}" for item in cast("list[str]", json.loads(store.get(key).body))]
    return found


def _chance(me: str) -> random.Random:
    return random.Random(me)  # noqa: S311 - no secret depends on it


def _until(end_s: float) -> Generator[int]:
    number = 0
    while time.monotonic() < end_s:
        yield number
        number += 1


def _note(log: str, line: str) -> None:
    if log:
        with Path(log).open("a") as file:
            file.write(f"{line}\n")
