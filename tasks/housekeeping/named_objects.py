"""What the records of a store name: any job or digest that stands anywhere in one, so that no new field is overlooked.

A record that is not what Simyard writes there may name anything: it is reported, and what it might name stays.
"""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import cast

from pydantic import JsonValue, ValidationError

from specs.errors import ObjectNotFound
from specs.job_kinds import JOB_KINDS
from specs.robomaker.bundle import Application
from tasks.housekeeping.object_kinds import (
    BUNDLES,
    METADATA,
    NAMED_BY_OTHERS,
    RECORD_FOLDERS,
    RECORDS,
    StoredJob,
    digests_in,
    ids_in,
    is_record,
    kind_of_key,
    metadata_version,
)
from tasks.storage.base.keys import token_key, trust_key
from tasks.storage.base.store import Entry, Store
from tasks.storage.jobs.records import JobRecord, is_terminal
from tasks.storage.jobs.runs import KIND as RUN
from tasks.storage.jobs.runs import jobs_of

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

    job: StoredJob
    ended: bool
    token: str
    stages: frozenset[str] = frozenset()


@dataclass(frozen=True)
class NamingRecord:
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


Records = Mapping[str, NamingRecord]


def record_entries(store: Store, known: Records) -> list[Entry]:
    """Returns the records of a store as a listing shows them now, and those that it left out though they are there.

    Args:
        store: Whose.
        known: Those of the last time: each that is not listed is looked for by its key.
    """
    listed = [entry for folder in RECORD_FOLDERS for entry in store.entries(folder) if is_record(entry.key)]
    left_out = (_entry(store, key) for key in sorted(known.keys() - {entry.key for entry in listed}))
    return [*listed, *(entry for entry in left_out if entry)]


def _entry(store: Store, key: str) -> Entry | None:
    try:
        return store.entry(key)
    except ObjectNotFound:
        return None


def read_records(store: Store, entries: list[Entry], known: Records) -> dict[str, NamingRecord]:
    """Returns what the records name, by key; those are read that are not known as they are listed."""
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        found = pool.map(lambda entry: _current(store, entry, known.get(entry.key)), entries)
        return {record.entry.key: record for record in found if record}


def _current(store: Store, entry: Entry, known: NamingRecord | None) -> NamingRecord | None:
    if known and known.entry.mark == entry.mark:
        return known
    try:
        body = store.get(entry.key).body
    except ObjectNotFound:
        return None
    return _record(entry, body)


def _record(entry: Entry, body: bytes) -> NamingRecord:
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
    return NamingRecord(entry, spoilt, ids - own, digests_in(text), facts)


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
    return JobFacts(
        StoredJob(record.kind, record.id), is_terminal(record), token_key(record.kind, record.token), stages
    )


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


@dataclass(frozen=True)
class UnreadableRecord:
    """A record that cannot be read, and what therefore stays.

    Attributes:
        key: The record's.
        why: What is wrong with it.
        keeps: Kinds of objects that it might name.
    """

    key: str
    why: str
    keeps: frozenset[str]


@dataclass(frozen=True)
class NamedByRecords:
    """What is named.

    Attributes:
        jobs: Those with a record, and whether they have ended; of one whose record is spoilt that is not believed.
        forgotten: Keys of the records of those that ended long ago, and that nobody names.
        ids: Jobs that others than themselves name.
        digests: SHA-256 digests.
        tokens: Keys of the tokens of jobs with a record.
        spoilt: Records that cannot be read.
    """

    jobs: dict[StoredJob, bool] = field(default_factory=dict[StoredJob, bool])
    forgotten: dict[StoredJob, NamingRecord] = field(default_factory=dict[StoredJob, NamingRecord])
    ids: frozenset[str] = frozenset()
    digests: frozenset[str] = frozenset()
    tokens: frozenset[str] = frozenset()
    spoilt: tuple[UnreadableRecord, ...] = ()

    @property
    def kept(self) -> frozenset[str]:
        """Kinds of objects of which nothing is freed, because a record that cannot be read may name them."""
        return frozenset[str]().union(*(each.keeps for each in self.spoilt))


def names_in(records: Records, ended_before_s: float | None = None) -> NamedByRecords:
    """Returns what records name.

    Args:
        records: All of a store, by key.
        ended_before_s: Jobs that ended before it, by the store's clock, and that nobody names, count as forgotten; None
            for none.
    """
    unread = any(record.spoilt for record in records.values())  # it may name any job
    forgotten = {} if unread or ended_before_s is None else _forgotten(records, ended_before_s)
    left = [record for key, record in records.items() if key not in forgotten]
    facts = [record.job for record in left if record.job]
    return NamedByRecords(
        jobs={**_unread(left), **{each.job: each.ended for each in facts}},
        forgotten={record.job.job: record for record in forgotten.values() if record.job},
        ids=_ids(left),
        digests=frozenset[str]().union(*(record.digests for record in left)),
        tokens=frozenset(each.token for each in facts),
        spoilt=tuple(_spoilt(record) for record in left if record.spoilt),
    )


def _unread(records: Iterable[NamingRecord]) -> dict[StoredJob, bool]:
    """Returns the jobs whose records cannot be read: they are there, and may be under way."""
    places = (kind_of_key(record.entry.key) for record in records if record.spoilt)
    return {place.job: False for place in places if place.job and place.what == RECORDS}


def _ids(records: Iterable[NamingRecord]) -> frozenset[str]:
    """Returns the jobs that others name; an ended run of a document only tells of them, and needs them no more."""
    return frozenset[str]().union(*(record.ids for record in records if not _is_ended_run(record)))


def _is_ended_run(record: NamingRecord) -> bool:
    return record.job is not None and record.job.ended and record.job.job.kind == RUN


def _forgotten(records: Records, before_s: float) -> dict[str, NamingRecord]:
    """Returns the records of jobs that ended long ago and that no other record names, by key."""
    found = {key: record for key, record in records.items() if _ended_before(record, before_s)}
    while True:
        ids = _ids(record for key, record in records.items() if key not in found)
        left = {key: record for key, record in found.items() if record.job and record.job.job.id not in ids}
        if len(left) == len(found):
            return left
        found = left


def _ended_before(record: NamingRecord, before_s: float) -> bool:
    # The record of a job that has ended is never written again, so it is as old as the end.
    facts = record.job
    return bool(facts and facts.ended and JOB_KINDS[facts.job.kind].forgettable and record.entry.written_s < before_s)


def _spoilt(record: NamingRecord) -> UnreadableRecord:
    keeps = frozenset({BUNDLES}) if record.entry.key.startswith(("robots/", "fleets/")) else NAMED_BY_OTHERS
    return UnreadableRecord(record.entry.key, record.spoilt, keeps)


_ROLES = ("targets", "deployer")


def replaced_metadata(store: Store, entries: Sequence[Entry], written_before_s: float) -> frozenset[str]:
    """Returns the keys of metadata in whose place another version has been for long enough.

    Of a repository whose newest versions cannot be told, none.

    Args:
        store: Where it lies.
        entries: All that the store holds.
        written_before_s: When what took its place must have been written at the latest, by the store's clock.
    """
    metadata = [entry for entry in entries if kind_of_key(entry.key).what == METADATA]
    repositories = sorted({metadata_version(entry.key)[0] for entry in metadata})
    current = {repository: _current_version(store, repository) for repository in repositories}
    written_s = {entry.key: entry.written_s for entry in metadata}
    return frozenset(_replaced(written_s, current, written_before_s))


def _replaced(
    written_s: Mapping[str, float], current: Mapping[str, Mapping[str, int]], before_s: float
) -> Iterable[str]:
    for key in written_s:
        repository, role, version = metadata_version(key)
        newest = current[repository].get(role, 0)
        successor = written_s.get(trust_key(repository, f"{newest}.{role}.json"), before_s)
        if version < newest and successor < before_s:
            yield key


def _current_version(store: Store, repository: str) -> dict[str, int]:
    """Returns the version of each role that counts."""
    try:
        snapshot = _versions(store, trust_key(repository, "timestamp.json"))["snapshot"]
        found = _versions(store, trust_key(repository, f"{snapshot}.snapshot.json"))
        return {"snapshot": snapshot, **{role: found[role] for role in _ROLES}}
    except (ObjectNotFound, ValueError, KeyError, TypeError, AttributeError):
        return {}  # a robot says what is wrong with it; housekeeping leaves it alone


def _versions(store: Store, key: str) -> dict[str, int]:
    document = cast("dict[str, dict[str, dict[str, dict[str, JsonValue]]]]", json.loads(store.get(key).body))
    meta = document["signed"]["meta"]
    return {name.removesuffix(".json"): int(str(found["version"])) for name, found in meta.items()}
