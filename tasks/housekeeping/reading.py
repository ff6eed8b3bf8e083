"""What each record of a store names: whatever job or digest stands anywhere in it, so that no new field is overlooked.

A record that is not what Simyard writes there may name anything; it is told as spoilt, and what it might name stays.
"""

import json
import re
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import cast

from pydantic import JsonValue, ValidationError

from specs.bundle import Application
from specs.errors import ObjectNotFound
from tasks.housekeeping.layout import RECORD_FOLDERS, Job, digests_in, ids_in, is_record
from tasks.storage.keys import token_key
from tasks.storage.records import JobRecord, is_terminal
from tasks.storage.runs import KIND as RUN
from tasks.storage.runs import jobs_of
from tasks.storage.store import Entry, Store

_AT_ONCE = 16
_DIGEST = re.compile(r"[0-9a-f]{64}")


class _SpoiltError(ValueError):
    """What stands in a record is not what Simyard writes there."""


@dataclass(frozen=True)
class JobFacts:
    """What housekeeping wants of a job's record.

    Attributes:
        ended: Whether it will never change.
        token: Key of its token.
        stages: Of a run of a document, the ids of its jobs, which its record does not spell out until it has ended.
    """

    job: Job
    ended: bool
    token: str
    stages: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Record:
    """A record, and what it names.

    Attributes:
        entry: As it was listed.
        spoilt: Why it cannot be read, or empty.
        ids: Of jobs, its own left out.
        digests: SHA-256 digests, of bundles and of other things.
        job: What it says, if it is a job's.
    """

    entry: Entry
    spoilt: str
    ids: frozenset[str]
    digests: frozenset[str]
    job: JobFacts | None = None


Records = Mapping[str, Record]


def record_entries(store: Store) -> list[Entry]:
    """Returns the records of a store as a listing shows them now."""
    found = (entry for folder in RECORD_FOLDERS for entry in store.entries(folder))
    return [entry for entry in found if is_record(entry.key)]


def read_records(store: Store, entries: list[Entry], known: Records) -> dict[str, Record]:
    """Returns what the records name, by key; those are read that are not known as they are listed."""
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        found = pool.map(lambda entry: _current(store, entry, known.get(entry.key)), entries)
        return {record.entry.key: record for record in found if record}


def _current(store: Store, entry: Entry, known: Record | None) -> Record | None:
    if known and known.entry.mark == entry.mark:
        return known
    try:
        body = store.get(entry.key).body
    except ObjectNotFound:
        return None
    return _record(entry, body)


def _record(entry: Entry, body: bytes) -> Record:
    text = body.decode(errors="replace")
    try:
        # Written anew, so that no other spelling of the same letters hides a name.
        text = f"{text} {json.dumps(json.loads(text), ensure_ascii=False)}"
        facts = _checked(entry.key, body)
        spoilt = ""
    except (ValueError, RecursionError) as exc:  # pydantic's and json's errors are ValueErrors
        facts, spoilt = None, _one_line(exc)
    own = {PurePosixPath(entry.key).stem} if entry.key.startswith("jobs/") else set[str]()
    ids = ids_in(text) | (facts.stages if facts else frozenset[str]())
    return Record(entry, spoilt, ids - own, digests_in(text), facts)


def _checked(key: str, body: bytes) -> JobFacts | None:
    """Returns what a job's record says; None for any other record.

    Raises:
        ValueError: It is not what Simyard writes under that key.
    """
    folder, *rest = key.split("/")
    if folder == "jobs":
        return _job(body, rest)
    if folder == "applications":
        _same(Application.model_validate_json(body).name, PurePosixPath(key).stem)
    elif folder == "results":
        _evidence(body, rest[0])
    elif folder == "fleets":
        _same(_document(body).get("name"), PurePosixPath(key).stem)
    else:
        _robot(body, rest)
    return None


def _job(body: bytes, place: list[str]) -> JobFacts:
    record = JobRecord.model_validate_json(body)
    _same(f"{record.kind}/{record.id}.json", "/".join(place))
    if record.kind == "simulation-job-batch":
        plan = record.request.get("plan")
        if not isinstance(plan, dict) or not {"templates", "world_digests"} <= plan.keys():
            raise _SpoiltError("has no plan of a batch")
    stages = frozenset(job for _, job in jobs_of(record)) if record.kind == RUN else frozenset[str]()
    return JobFacts(Job(record.kind, record.id), is_terminal(record), token_key(record.kind, record.token), stages)


def _evidence(body: bytes, batch: str) -> None:
    found = _document(body)
    _same(found.get("batch"), batch)
    if not {"robots", "simulations", "worlds"} <= found.keys():
        raise _SpoiltError("is no evidence")


def _robot(body: bytes, place: list[str]) -> None:
    name, file = place[0], place[-1]
    if file == "desired.json" and body.strip() == b"null":
        return
    found = _document(body)
    if file == "desired.json" and found.keys() == {"withdrawn"}:
        return
    _same(found.get("name" if file == "record.json" else "robot"), name)
    digest = found.get({"desired.json": "digest", "reported.json": "running_digest"}.get(file, ""), "")
    if not isinstance(digest, str) or (digest and not _DIGEST.fullmatch(digest)):
        raise _SpoiltError("names no bundle where it should")


def _document(body: bytes) -> dict[str, JsonValue]:
    found = cast("JsonValue", json.loads(body))
    if not isinstance(found, dict):
        raise _SpoiltError("is no JSON object")
    return found


def _same(found: JsonValue, expected: str) -> None:
    if found != expected:
        raise _SpoiltError(f"is that of {found!r}")


def _one_line(exc: Exception) -> str:
    if isinstance(exc, ValidationError):
        return exc.errors(include_url=False, include_input=False)[0]["msg"]
    return " ".join(str(exc).split())[:200]
