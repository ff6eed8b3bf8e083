"""The jobs of a kind, oldest first, from any place on, without reading the record of each.

What lists say of jobs that have ended is kept on this machine, in a table of SQLite in the cache folder. Each list asks
the store which jobs there are: a listing gives the mark of each record, which changes whenever the record is written. A
row of the table is believed for exactly the mark that it was made of, so lists say what the records say, whatever other
machines and gc have done. Read are the records with another mark, and those of the jobs under way that are shown.

The table is no more than a gain of time: one that is missing or damaged is made anew, and where it cannot be written,
lists read the records.
"""

import hashlib
import json
import logging
import sqlite3
from collections.abc import Callable, Collection, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager
from functools import lru_cache
from itertools import islice
from typing import Any, NamedTuple, TypeVar

from pydantic import JsonValue

from specs.errors import DocumentError, ObjectCorrupt
from specs.field_types import FilteredPage, Page
from specs.job_kinds import JobKind
from specs.robomaker.shared_operations import Place, page_of, page_size, place_after, wanted_values
from tasks.storage.base.keys import job_key, jobs_prefix
from tasks.storage.base.local_files import cache_folder
from tasks.storage.base.store import Store, find_document
from tasks.storage.jobs.records import JobRecord, is_terminal
from tasks.storage.store_url import store_id

_LOG = logging.getLogger(__name__)
_THREADS, _READ_AHEAD, _READ_AT_ONCE = 16, 64, 512
_KEPT_FROM = 8
"""Of fewer jobs nothing is kept, unless an entry has a detail, which takes long to make."""
_FORM = 1
"""Of what an entry says: it rises with each change, and tables of another form are not looked at."""
_JOBS = """CREATE TABLE IF NOT EXISTS jobs (
    kind TEXT, job TEXT, created_us INTEGER, mark TEXT, ended INTEGER, entry TEXT, PRIMARY KEY (kind, job)
)"""
_BUSY_S = 5.0
_MICROSECOND = 1e6
_CORRUPT = (ObjectCorrupt, DocumentError, ValueError, TypeError, LookupError, AttributeError)
T = TypeVar("T")
Values = Mapping[str, Sequence[str]]
Wanted = Mapping[str, Collection[str]]
"""Names of values, and those of which an entry must have one, for each name."""
Summaries = tuple[dict[str, JsonValue], ...]


class JobPlace(NamedTuple):
    """A job's place among all of its kind: oldest first, and by id those of one microsecond."""

    created_us: int
    id: str


START = JobPlace(0, "")


class IndexEntry(NamedTuple):
    """What lists say of one job.

    Attributes:
        place: Its place.
        values: What a list may filter it by.
        summary: What the List call answers.
        detail: What else its kind's lists want, such as what a batch's jobs are.
    """

    place: JobPlace
    values: Values
    summary: dict[str, JsonValue]
    detail: dict[str, JsonValue]


class FoundJob(NamedTuple):
    """A job: its entry if it has ended, and its record if it was read."""

    place: JobPlace
    entry: IndexEntry | None
    record: JobRecord | None


EntryOf = Callable[[Store, JobRecord], IndexEntry]


def place_of(created_at_s: float, job: str) -> JobPlace:
    """Returns the place of a job that was made at a time."""
    return JobPlace(round(created_at_s * _MICROSECOND), job)


def index_page(
    store: Store,
    kind: JobKind,
    entry_of: EntryOf,
    request: Page,
    *,
    most: int,
    filters: Mapping[str, str],
    only: Wanted | None = None,
) -> tuple[Summaries, str | None]:
    """Returns the summaries of a page of jobs, oldest first, and the token of the next one.

    Args:
        store: Where they are.
        kind: Of the jobs.
        entry_of: Makes the entry of one from its record.
        request: The List call's.
        most: How many a page has at most.
        filters: The names that the call filters by, each with the name of the entries' values.
        only: What else an entry must have.

    Raises:
        DocumentError: The request has a token, a size or filters that the call does not take.
    """
    asked = wanted_values(request, filters) if isinstance(request, FilteredPage) else {}
    wanted = {**(only or {}), **{filters[name]: values for name, values in asked.items()}}
    size, token = page_size(request, most), place_after(request, kind, (int, str))
    after = JobPlace(int(token[0]), str(token[1])) if token else None
    return page_of(_summaries(JobIndex(store, kind, entry_of), after, wanted), size, kind)


def all_entries(store: Store, kind: JobKind, entry_of: EntryOf, only: Wanted | None = None) -> Iterator[IndexEntry]:
    """Yields the entries of all jobs of a kind, oldest first."""
    index = JobIndex(store, kind, entry_of)
    for found in index.jobs(START, only):
        entry = index.entry(found)
        if entry and fits(entry, only or {}):
            yield entry


def fits(entry: IndexEntry, wanted: Wanted) -> bool:
    """Returns whether an entry has one of the wanted values, of each name."""
    return all(not set(entry.values.get(name, ())).isdisjoint(values) for name, values in wanted.items())


def records_under_way(store: Store, kind: JobKind) -> list[JobRecord]:
    """Returns the jobs of a kind that have not ended, oldest first."""
    return JobIndex(store, kind, _no_entry).under_way()


@contextmanager
def skip_if_corrupt(store: Store, kind: JobKind, job: str) -> Generator[None]:
    """Ends the block without an error where a job's record is not what Simyard writes; a store that fails is an error.

    A list leaves such a record out, names it in the log, and shows everybody else's jobs.

    Args:
        store: Where the job is.
        kind: The job's.
        job: Its id.
    """
    try:
        yield
    except _CORRUPT as exc:
        _warn_once(f"{store.url}: {kind} {job}", f"{type(exc).__name__}: {str(exc)[:300]}")


class JobIndex:
    """The jobs of a kind; made anew for each list.

    Args:
        store: Where they are.
        kind: Of the jobs.
        entry_of: Makes the entry of a job from its record.
    """

    def __init__(self, store: Store, kind: JobKind, entry_of: EntryOf) -> None:
        self._store = store
        self._kind: JobKind = kind
        self._entry_of = entry_of
        self._table = _Table(store, kind)
        self._records: dict[str, JobRecord] = {}  # that this list has read, and not shown yet
        self._new: list[tuple[_Row, IndexEntry]] = []

    def jobs(self, first: JobPlace = START, wanted: Wanted | None = None) -> Iterator[FoundJob]:
        """Yields the jobs from a place on; those whose record is not read are left out that are not wanted for certain.

        Args:
            first: Where to begin.
            wanted: What the caller goes on to look for.
        """
        rows = sorted(row for row in self._listed().values() if row.place >= first)
        for few in _batched(rows, _READ_AHEAD):
            yield from self._found(few, wanted or {})

    def entry(self, found: FoundJob) -> IndexEntry | None:
        """Returns the entry of a job; of one that is under way, as it stands now. None if its record cannot be read."""
        if found.entry is None:
            if found.record is None:
                raise AssertionError(f"{found.place.id} has neither entry nor record")
            return self._made(found.record)
        return found.entry

    def under_way(self) -> list[JobRecord]:
        """Returns the records of the jobs that have not ended, oldest first."""
        going = [row.place.id for row in sorted(self._listed().values()) if not row.ended]
        return [record for record in self._read(going) if record and not is_terminal(record)]

    def _listed(self) -> dict[str, "_Row"]:
        """Returns what is known of each job that the store lists, having read the records whose mark is new."""
        listed = {_job_of(entry.key): entry.mark for entry in self._store.entries(jobs_prefix(self._kind))}
        known = self._table.rows()
        rows = {job: row for job, row in known.items() if listed.get(job) == row.mark}
        changed = [job for job in listed if job not in rows]
        for few in _batched(changed, _READ_AT_ONCE):
            read = {job: record for job, record in zip(few, self._read(few), strict=True) if record}
            fresh = {
                job: _Row(place_of(record.created_at_s, job), listed[job], is_terminal(record))
                for job, record in read.items()
            }
            rows |= fresh
            if len(changed) <= _READ_AT_ONCE:
                self._records = read
            if len(changed) >= _KEPT_FROM:
                self._table.write([(row, None) for row in fresh.values()])
        self._table.forget(known.keys() - listed.keys())
        return rows

    def _found(self, rows: Sequence["_Row"], wanted: Wanted) -> list[FoundJob]:
        """Returns some jobs, in their order: what the table says, and for the rest what the records say."""
        kept = self._table.entries([row for row in rows if row.ended])
        left = [row.place.id for row in rows if row.place not in kept]
        records = dict(zip(left, self._read(left), strict=True))
        found: list[FoundJob] = []
        for row in rows:
            if row.place in kept:
                entry = kept[row.place]
                found += [FoundJob(row.place, entry, None)] if _may_fit(entry.values, wanted) else []
                continue
            record = records[row.place.id]
            if record is None:  # removed since it was listed
                continue
            entry = self._made(record) if is_terminal(record) else None
            if entry:
                self._new.append((row._replace(ended=True), entry))
            if entry or not is_terminal(record):
                found.append(FoundJob(row.place, entry, record))
        if len(self._new) >= _KEPT_FROM or any(entry.detail for _, entry in self._new):
            self._table.write(self._new)
            self._new = []
        return found

    def _made(self, record: JobRecord) -> IndexEntry | None:
        with skip_if_corrupt(self._store, self._kind, record.id):
            return self._entry_of(self._store, record)
        return None

    def _read(self, jobs: Sequence[str]) -> list[JobRecord | None]:
        if len(jobs) < 2:
            return [self._record(job) for job in jobs]
        with ThreadPoolExecutor(min(_THREADS, len(jobs))) as pool:
            return list(pool.map(self._record, jobs))

    def _record(self, job: str) -> JobRecord | None:
        if job in self._records:
            return self._records.pop(job)
        with skip_if_corrupt(self._store, self._kind, job):
            return find_document(self._store, job_key(self._kind, job), JobRecord)
        return None


class _Row(NamedTuple):
    """What is known of a job while its record has this mark."""

    place: JobPlace
    mark: str
    ended: bool


class _Table:
    """What the records of a kind said, in a file of the cache folder that holds all kinds of a store.

    Whatever is wrong with the file, nothing is known: a damaged one is removed, and one that cannot be read or written,
    as in a home that is read-only, is passed by.
    """

    def __init__(self, store: Store, kind: JobKind) -> None:
        name = hashlib.sha256(f"{_FORM} {store.url} {store_id(store)}".encode()).hexdigest()[:16]
        self._path = cache_folder() / "lists" / f"{name}.sqlite"
        self._kind = kind

    def rows(self) -> dict[str, _Row]:
        """Returns all rows, by job."""
        found = self._read("SELECT created_us, job, mark, ended FROM jobs WHERE kind = ?", [self._kind])
        return {job: _Row(JobPlace(created_us, job), mark, bool(ended)) for created_us, job, mark, ended in found}

    def entries(self, rows: Sequence[_Row]) -> dict[JobPlace, IndexEntry]:
        """Returns the entries of the jobs that have one which was made of this very record."""
        jobs = ", ".join("?" * len(rows))
        text = f"SELECT job, mark, entry FROM jobs WHERE kind = ? AND entry IS NOT NULL AND job IN ({jobs})"  # noqa: S608 - question marks alone
        found = self._read(text, [self._kind, *(row.place.id for row in rows)]) if rows else []
        kept = {(job, mark): entry for job, mark, entry in found}
        return {
            row.place: IndexEntry(row.place, *json.loads(kept[row.place.id, row.mark]))
            for row in rows
            if (row.place.id, row.mark) in kept
        }

    def write(self, rows: Iterable[tuple[_Row, IndexEntry | None]]) -> None:
        """Writes rows; that of a job replaces the one that it had."""
        values = [
            (self._kind, row.place.id, row.place.created_us, row.mark, row.ended, entry and json.dumps(entry[1:]))
            for row, entry in rows
        ]
        self._write("INSERT OR REPLACE INTO jobs VALUES (?, ?, ?, ?, ?, ?)", values)

    def forget(self, jobs: Collection[str]) -> None:
        """Removes the rows of jobs that are gone."""
        if jobs:
            self._write("DELETE FROM jobs WHERE kind = ? AND job = ?", [(self._kind, job) for job in jobs])

    def _read(self, text: str, values: Sequence[str]) -> list[tuple[Any, ...]]:
        with self._passed_by():
            if self._path.exists():
                with closing(sqlite3.connect(self._path, timeout=_BUSY_S)) as file:
                    return file.execute(text, values).fetchall()
        return []

    def _write(self, text: str, values: Iterable[tuple[object, ...]]) -> None:
        with self._passed_by():
            self._path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            self._path.touch(mode=0o600)
            with closing(sqlite3.connect(self._path, timeout=_BUSY_S)) as file, file:
                file.execute(_JOBS)
                file.executemany(text, values)

    @contextmanager
    def _passed_by(self) -> Generator[None]:
        """Ends the block without an error where the file cannot be used; removes it where it is damaged."""
        try:
            yield
        except (sqlite3.OperationalError, OSError) as exc:
            _LOG.debug("%s is passed by: %s", self._path, exc)
        except sqlite3.DatabaseError as exc:
            _LOG.warning("%s is damaged, and made anew: %s", self._path, exc)
            self._path.unlink(missing_ok=True)


def _no_entry(_store: Store, record: JobRecord) -> IndexEntry:
    raise AssertionError(f"nobody asked for the entry of {record.id}")


def _summaries(index: JobIndex, after: JobPlace | None, wanted: Wanted) -> Iterator[tuple[Place, dict[str, JsonValue]]]:
    for found in index.jobs(after or START, wanted):
        if after is None or found.place > after:
            entry = index.entry(found)
            if entry and fits(entry, wanted):
                yield entry.place, entry.summary


def _may_fit(values: Values, wanted: Wanted) -> bool:
    """Returns whether something with these values may be wanted; what lacks a name may have any value of it."""
    return all(name not in values or not set(values[name]).isdisjoint(each) for name, each in wanted.items())


def _job_of(key: str) -> str:
    return key.rpartition("/")[2].removesuffix(".json")


def _batched(items: Sequence[T], size: int) -> Iterator[list[T]]:
    left = iter(items)
    while few := list(islice(left, size)):
        yield few


@lru_cache(maxsize=4096)
def _warn_once(job: str, why: str) -> None:
    _LOG.warning("%s is left out of lists, its record cannot be read: %s", job, why)
