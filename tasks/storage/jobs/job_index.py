"""The jobs of a kind, oldest first, from any place on, without reading the record of each.

Of a job that has ended there is a line, and a mark of every other one, whose record is read. What has ended since
somebody listed it last is settled on the way: a line is written, then its mark is removed. So what a list costs depends
on the jobs that are under way and on the length of the page, and not on how many there ever were.

Who settles has read the root before the records, and writes only over that very root; who removes a record writes the
root afterwards. So no line can be written of a record that was removed meanwhile.
"""

import heapq
import logging
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import lru_cache, partial
from itertools import islice
from typing import NamedTuple, TypeVar

from pydantic import JsonValue

from specs.errors import DocumentError, ObjectCorrupt, ObjectNotFound, ResourceNotFound, StoreAccessDenied
from specs.field_types import FilteredPage, Page
from specs.job_kinds import JobKind
from specs.robomaker.shared_operations import Place, page_of, page_size, place_after, wanted_values
from tasks.storage.base.keys import job_key, jobs_prefix, line_root_key
from tasks.storage.base.store import Store, decode_document
from tasks.storage.jobs.index_segments import (
    Line,
    Mark,
    Root,
    Values,
    mark_of,
    mark_open,
    open_marks,
    read_root,
    read_segment,
    remove_segments,
    swap_root,
    unmark,
    with_lines,
)
from tasks.storage.jobs.records import JobRecord, is_terminal, read, records

_LOG = logging.getLogger(__name__)
_CORRUPT = (ObjectCorrupt, DocumentError, ValueError, TypeError, LookupError, AttributeError)


@contextmanager
def skip_if_corrupt(store: Store, kind: JobKind, job: str) -> Generator[None]:
    """Ends the block without an error where a job's record is not what Simyard writes; a store that fails is an error.

    Args:
        store: Where the job is.
        kind: The job's.
        job: Its id.
    """
    try:
        yield
    except _CORRUPT as exc:
        _warn_once(f"{store.url}: {kind} {job}", f"{type(exc).__name__}: {str(exc)[:300]}")


@lru_cache(maxsize=4096)
def _warn_once(job: str, why: str) -> None:
    _LOG.warning("%s is left out of lists, its record cannot be read: %s", job, why)


_READ_AT_ONCE = 16


def records_under_way(store: Store, kind: JobKind) -> list[JobRecord]:
    """Returns the jobs of a kind that have not ended, oldest first."""
    if not _is_filled(store, kind):  # by an older version: not every job has a mark or a line
        return [record for record in records(store, kind) if not is_terminal(record)]
    jobs = list(dict.fromkeys(mark.id for mark in open_marks(store, kind)))
    with ThreadPoolExecutor(min(_READ_AT_ONCE, len(jobs) or 1)) as pool:
        found = [record for record in pool.map(lambda job: _read(store, kind, job), jobs) if record]
    going = [record for record in found if not is_terminal(record)]
    return sorted(going, key=lambda record: (record.created_at_s, record.id))


def _is_filled(store: Store, kind: JobKind) -> bool:
    try:
        return read_root(store, kind)[0].filled
    except ValueError:  # damaged, and made anew by the next list
        return False


def _read(store: Store, kind: JobKind, job: str) -> JobRecord | None:
    try:
        return read(store, kind, job)
    except ResourceNotFound:  # not made yet, or removed
        return None


_AT_ONCE, _READ_AHEAD = 16, 32
_SETTLED_FROM, _SETTLED_AT_ONCE, _FILLED_AT_ONCE = 8, 512, 2048
T = TypeVar("T")
START = Mark(0, "")
Wanted = Mapping[str, Collection[str]]
"""Names of values, and those of which a line must have one, for each name."""
LineOf = Callable[[Store, JobRecord], Line]


class Found(NamedTuple):
    """A job: its line if it has ended, and its record if it was read."""

    mark: Mark
    line: Line | None
    record: JobRecord | None


class _OutdatedRootError(Exception):
    """The root has been replaced since it was read, and with it a segment that it names."""


class JobLines:
    """The jobs of a kind; made anew for each list.

    Args:
        store: Where they are.
        kind: Of the jobs.
        line_of: Makes the line of a job that has ended.
    """

    def __init__(self, store: Store, kind: JobKind, line_of: LineOf) -> None:
        self._store = store
        self._kind: JobKind = kind
        self._line_of = line_of
        self._base: tuple[Root, str] | None = None
        self._ended: list[Line] = []
        self._marks: set[Mark] = set()

    def found(self, first: Mark = START, wanted: Wanted | None = None) -> Iterator[Found]:
        """Yields the jobs from a place on; those whose record is not read are left out that are not wanted for certain.

        Args:
            first: Where to begin.
            wanted: What the caller goes on to look for.
        """
        last: Mark | None = None
        while True:
            try:
                for each in self._walk(max(first, last or first), wanted or {}):
                    if last is None or each.mark > last:
                        last = each.mark
                        yield each
            except _OutdatedRootError:
                continue
            return

    def line(self, found: Found) -> Line | None:
        """Returns the line of a job; of one that is under way, as it stands now. None if its record cannot be read."""
        if found.line is None:
            if found.record is None:
                raise AssertionError(f"{found.mark.id} has neither line nor record")
            return self._line(found.record)
        return found.line

    def settle(self, at_least: int = _SETTLED_FROM) -> None:
        """Writes the lines of what was found to have ended, unless they are few or another process is at it."""
        lines, self._ended = self._ended, []
        if len(lines) >= max(1, at_least) and self._base:
            with suppress(_OutdatedRootError):
                self._write(lines)

    def _write(self, lines: Sequence[Line], *, filled: bool = False) -> None:
        """Writes lines over the very root that was read before the records; of a store that may only be read, none.

        Raises:
            _OutdatedRootError: Another process has changed the root since.
        """
        if self._base is None:
            return
        root, _ = self._base
        try:
            change = with_lines(self._store, self._kind, root, lines)
            new = change.root.model_copy(update={"edits": root.edits + 1, "filled": root.filled or filled})
            etag = swap_root(self._store, self._kind, self._base, new)
        except StoreAccessDenied as exc:
            _LOG.debug("%s: the lines of %d jobs were not written: %s", self._store.url, len(lines), exc)
            self._base = None
            return
        except ObjectNotFound as exc:
            raise _OutdatedRootError from exc
        if etag is None:
            remove_segments(self._store, self._kind, change.written)
            self._base = None
            raise _OutdatedRootError
        self._base = new, etag
        remove_segments(self._store, self._kind, change.replaced)
        marks = [line.mark for line in lines if line.mark in self._marks]
        with ThreadPoolExecutor(_AT_ONCE) as pool:
            list(pool.map(partial(unmark, self._store, self._kind), marks))

    def _walk(self, first: Mark, wanted: Wanted) -> Iterator[Found]:
        marks = open_marks(self._store, self._kind)  # before the root: what has no mark any more has a line there
        self._base = self._read_root()
        self._marks, unwritten = set(marks), list[Line]()
        if not self._base[0].filled:
            unwritten = self._fill()
        root, etag = self._base or self._read_root()
        sources = (
            self._open(sorted(mark for mark in self._marks if mark >= first)),
            self._settled(root, etag, first, wanted),
            (Found(line.mark, line, None) for line in sorted(unwritten) if line.mark >= first),
        )
        yield from heapq.merge(*sources, key=lambda each: each.mark)

    def _read_root(self) -> tuple[Root, str]:
        try:
            return read_root(self._store, self._kind)
        except ValueError as exc:
            self._drop_root(exc)
            return Root(), ""

    def _open(self, marks: Sequence[Mark]) -> Iterator[Found]:
        """Yields the marked jobs, a few records read ahead."""
        for few in _batched(marks, _READ_AHEAD):
            for mark, record in zip(few, self._records([mark.id for mark in few]), strict=True):
                if record is None:
                    continue
                if mark != mark_of(record.created_at_s, record.id):  # of who was slower to make the same job
                    self._try(partial(unmark, self._store, self._kind, mark))
                    continue
                line = self._line(record) if is_terminal(record) else None
                if line:
                    self._ended.append(line)
                if line or not is_terminal(record):
                    yield Found(mark, line, record)
            if len(self._ended) >= _SETTLED_AT_ONCE:
                self.settle()

    def _line(self, record: JobRecord) -> Line | None:
        with skip_if_corrupt(self._store, self._kind, record.id):
            return self._line_of(self._store, record)
        return None

    def _records(self, jobs: Sequence[str]) -> list[JobRecord | None]:
        if len(jobs) < 2:
            return [self._record(job) for job in jobs]
        with ThreadPoolExecutor(min(_AT_ONCE, len(jobs))) as pool:
            return list(pool.map(self._record, jobs))

    def _record(self, job: str) -> JobRecord | None:
        key = job_key(self._kind, job)
        try:
            stored = self._store.get(key)
        except ObjectNotFound:  # not made yet, or removed
            return None
        with skip_if_corrupt(self._store, self._kind, job):
            return decode_document(JobRecord, stored, self._store, key)
        return None

    def _settled(self, root: Root, etag: str, first: Mark, wanted: Wanted) -> Iterator[Found]:
        marked = {mark.id for mark in self._marks}
        for note in root.segments:
            if note.last >= first and _may_fit(note.values, wanted):
                lines = self._segment(note.name, etag)
                yield from (
                    Found(line.mark, line, None)
                    for line in lines
                    if line.mark >= first and line.mark.id not in marked and _may_fit(line.values, wanted)
                )

    def _segment(self, name: str, etag: str) -> Sequence[Line]:
        try:
            return read_segment(self._store, self._kind, name)
        except (ObjectNotFound, ValueError) as exc:
            if self._read_root()[1] == etag:
                self._drop_root(exc)
            raise _OutdatedRootError from exc

    def _drop_root(self, why: Exception) -> None:
        """Lets all lines be made anew from the records: what was kept of them is damaged."""
        reason = type(why).__name__
        _LOG.warning("%s: the lines of %s are damaged, and made anew (%s)", self._store.url, self._kind, reason)
        self._try(partial(self._store.delete, line_root_key(self._kind)))

    def _fill(self) -> list[Line]:
        """Gives every job of the store a line or a mark, once, for what older versions wrote; killed, it goes on later.

        Returns the lines that could not be written, of a store that may only be read.
        """
        root, etag = self._base or self._read_root()
        known = {line.mark.id for note in root.segments for line in self._segment(note.name, etag)}
        known |= {mark.id for mark in self._marks}
        unwritten: list[Line] = []
        jobs = [key.rpartition("/")[2].removesuffix(".json") for key in self._store.keys(jobs_prefix(self._kind))]
        for few in _batched([job for job in jobs if job not in known], _FILLED_AT_ONCE):
            records = [record for record in self._records(few) if record]
            for record in records:
                if not is_terminal(record):
                    mark = mark_of(record.created_at_s, record.id)
                    self._marks.add(mark)
                    self._try(partial(mark_open, self._store, self._kind, mark))
            ended = [line for record in records if is_terminal(record) and (line := self._line(record))]
            self._write(ended)
            unwritten += [] if self._base else ended
        self._write([], filled=True)
        return unwritten

    def _try(self, write: Callable[[], None]) -> None:
        try:
            write()
        except StoreAccessDenied as exc:
            _LOG.debug("%s may only be read: %s", self._store.url, exc)


def _may_fit(values: Values, wanted: Wanted) -> bool:
    """Returns whether something with these values may be wanted; what lacks a name may have any value of it."""
    return all(name not in values or not set(values[name]).isdisjoint(each) for name, each in wanted.items())


def _batched(items: Sequence[T], size: int) -> Iterator[list[T]]:
    left = iter(items)
    while few := list(islice(left, size)):
        yield few


Summaries = tuple[dict[str, JsonValue], ...]
_PLACE = (int, str)


def line_page(
    store: Store,
    kind: JobKind,
    line_of: LineOf,
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
        line_of: Makes the line of one from its record.
        request: The List call's.
        most: How many a page has at most.
        filters: The names that the call filters by, each with the name of the lines' values.
        only: What else a line must have.

    Raises:
        DocumentError: The request has a token, a size or filters that the call does not take.
    """
    asked = wanted_values(request, filters) if isinstance(request, FilteredPage) else {}
    wanted = {**(only or {}), **{filters[name]: values for name, values in asked.items()}}
    size, after = page_size(request, most), place_after(request, kind, _PLACE)
    lines = JobLines(store, kind, line_of)
    page = page_of(_summaries(lines, _mark(after), wanted), size, kind)
    lines.settle()
    return page


def all_lines(store: Store, kind: JobKind, line_of: LineOf, only: Wanted | None = None) -> Iterator[Line]:
    """Yields the lines of all jobs of a kind, oldest first."""
    lines = JobLines(store, kind, line_of)
    for found in lines.found(START, only):
        line = lines.line(found)
        if line and fits(line, only or {}):
            yield line
    lines.settle()


def fits(line: Line, wanted: Wanted) -> bool:
    """Returns whether a line has one of the wanted values, of each name."""
    return all(not set(line.values.get(name, ())).isdisjoint(values) for name, values in wanted.items())


def _summaries(lines: JobLines, after: Mark | None, wanted: Wanted) -> Iterator[tuple[Place, dict[str, JsonValue]]]:
    for found in lines.found(after or START, wanted):
        if after is None or found.mark > after:
            line = lines.line(found)
            if line and fits(line, wanted):
                yield line.mark, line.summary


def _mark(place: Place | None) -> Mark | None:
    return Mark(int(place[0]), str(place[1])) if place else None
