"""Segments: the lines of jobs that have ended, and the marks of all jobs that have no line yet.

A mark is an object whose key says all: when the job was made, and its id. It is written before the job's record, so
that no record is ever without one, and removed after the job's line was written. Where there is a mark, the record is
believed and no line.

The lines lie in the order of the jobs, some hundred in an object that never changes. One small object, the root, names
the segments and says what is in each. It is written by compare-and-swap alone, so that what it names at any moment is
whole: whoever dies before leaves a segment that nothing names, which gc removes.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import groupby
from typing import NamedTuple, cast
from uuid import uuid4

from pydantic import JsonValue
from pydantic_core import from_json

from specs.base import Spec
from specs.errors import ObjectConflict, ObjectExists, ObjectNotFound
from specs.job_kinds import JobKind
from tasks.storage.base.keys import (
    LINE_MARK,
    key_pattern,
    line_mark_key,
    line_marks_prefix,
    line_root_key,
    line_segment_key,
)
from tasks.storage.base.store import Store, encode_document

_PATTERN = key_pattern(LINE_MARK)
_MICROSECOND = 1e6


class Mark(NamedTuple):
    """A job's place among all of its kind: oldest first, and by id those of one microsecond."""

    created_us: int
    id: str


def mark_of(created_at_s: float, job: str) -> Mark:
    """Returns the mark of a job that was made at a time."""
    return Mark(round(created_at_s * _MICROSECOND), job)


def mark_open(store: Store, kind: JobKind, mark: Mark) -> None:
    """Writes down that a job has no line."""
    store.put(line_mark_key(kind, *mark), b"{}")


def unmark(store: Store, kind: JobKind, mark: Mark) -> None:
    """Removes the mark of a job that has a line now, or that is gone."""
    store.delete(line_mark_key(kind, *mark))


def open_marks(store: Store, kind: JobKind) -> list[Mark]:
    """Returns the marks of a kind's jobs, oldest first."""
    found = (_PATTERN.fullmatch(key) for key in store.keys(line_marks_prefix(kind)))
    return sorted(Mark(int(each["created"]), each["job"]) for each in found if each)


SEGMENT_BYTES = 1 << 18
_VALUES_NOTED = 32
_SEGMENTS_KEPT = 24
Values = Mapping[str, Sequence[str]]


class Line(NamedTuple):
    """What lists say of one job.

    Attributes:
        mark: Its place.
        values: What a list may filter it by.
        summary: What the List call answers.
        detail: What else its kind's lists want, such as what a batch's jobs are.
    """

    mark: Mark
    values: Values
    summary: dict[str, JsonValue]
    detail: dict[str, JsonValue]


class SegmentNote(Spec):
    """What the root says of a segment.

    Attributes:
        name: Part of its key.
        first: The place of its first line.
        last: The place of its last line.
        values: What its lines can be filtered by; a name is missing that has too many values, or that a line lacks.
    """

    name: str
    first: Mark
    last: Mark
    values: dict[str, tuple[str, ...]]


class Root(Spec):
    """The segments of a kind, in order.

    Attributes:
        edits: How often it was written, so that no two have the same etag.
        filled: Whether every job of the kind has a mark or a line. Jobs of a store that older versions of Simyard wrote
            have none until somebody lists them.
    """

    edits: int = 0
    filled: bool = False
    segments: tuple[SegmentNote, ...] = ()


def read_root(store: Store, kind: JobKind) -> tuple[Root, str]:
    """Returns the root as it stands, and its etag; an empty text if there is none.

    Raises:
        ValueError: It was not written by this version of Simyard.
    """
    try:
        stored = store.get(line_root_key(kind))
    except ObjectNotFound:
        return Root(), ""
    return Root.model_validate_json(stored.body), stored.etag


@lru_cache(maxsize=_SEGMENTS_KEPT)
def read_segment(store: Store, kind: JobKind, name: str) -> Sequence[Line]:
    """Returns the lines of a segment, in order; kept, because no segment ever changes.

    Raises:
        ObjectNotFound: Another process has replaced it.
        ValueError: It was not written by this version of Simyard.
    """
    found = cast("JsonValue", from_json(store.get(line_segment_key(kind, name)).body))
    return [_line(each) for each in (found if isinstance(found, list) else [None])]


def swap_root(store: Store, kind: JobKind, before: tuple[Root, str], changed: Root) -> str | None:
    """Returns the new root's etag; None if another process has changed the root since, and nothing was written."""
    root, etag = before
    body = encode_document(changed.model_copy(update={"edits": root.edits + 1}))
    try:
        if etag:
            return store.replace(line_root_key(kind), body, etag)
        return store.create(line_root_key(kind), body)
    except (ObjectConflict, ObjectExists):
        return None


class Change(NamedTuple):
    """A root after a change, the segments that were written for it, and those that it names no more."""

    root: Root
    written: tuple[str, ...]
    replaced: tuple[str, ...]


def with_lines(store: Store, kind: JobKind, root: Root, lines: Sequence[Line]) -> Change:
    """Returns the root with lines of more jobs; a job that has a line gets the new one."""
    kept: list[SegmentNote] = []
    written: list[str] = []
    replaced: list[str] = []
    of_segment = {place: list(few) for place, few in groupby(sorted(lines), lambda line: _segment_of(root, line.mark))}
    for place, note in enumerate(root.segments or (None,)):
        if place not in of_segment:
            kept += [note] if note else []
            continue
        old = {line.mark: line for line in read_segment(store, kind, note.name)} if note else {}
        merged = sorted((old | {line.mark: line for line in of_segment[place]}).values())
        added = _write_segments(store, kind, merged)
        replaced += [note.name] if note else []
        written += [each.name for each in added]
        kept += added
    return Change(root.model_copy(update={"segments": tuple(kept)}), tuple(written), tuple(replaced))


def without_lines(store: Store, kind: JobKind, root: Root, jobs: frozenset[str]) -> Change:
    """Returns the root without the lines of some jobs."""
    kept: list[SegmentNote] = []
    written: list[str] = []
    replaced: list[str] = []
    for note in root.segments:
        lines = read_segment(store, kind, note.name)
        left = [line for line in lines if line.mark.id not in jobs]
        if len(left) == len(lines):
            kept.append(note)
            continue
        added = _write_segments(store, kind, left) if left else []
        replaced.append(note.name)
        written += [each.name for each in added]
        kept += added
    return Change(root.model_copy(update={"segments": tuple(kept)}), tuple(written), tuple(replaced))


def remove_segments(store: Store, kind: JobKind, names: Iterable[str]) -> None:
    """Removes segments that no root names."""
    for name in names:
        store.delete(line_segment_key(kind, name))


def _segment_of(root: Root, mark: Mark) -> int:
    """Returns the number of the segment where a line belongs."""
    return max((place for place, note in enumerate(root.segments) if note.first <= mark), default=0)


def _write_segments(store: Store, kind: JobKind, lines: Sequence[Line]) -> list[SegmentNote]:
    return [_write_segment(store, kind, few, body) for few, body in _bodies(lines)]


def _write_segment(store: Store, kind: JobKind, lines: Sequence[Line], body: bytes) -> SegmentNote:
    # A name of its own: what two processes write at once may be the same lines, and one of the two removes its own.
    name = uuid4().hex
    store.put(line_segment_key(kind, name), body)
    return SegmentNote(name=name, first=lines[0].mark, last=lines[-1].mark, values=_noted_values(lines))


def _bodies(lines: Sequence[Line]) -> Iterator[tuple[list[Line], bytes]]:
    """Yields the lines of each segment, and its bytes: as many as it may have, so that what is added last fills it."""
    few: list[Line] = []
    texts: list[bytes] = []
    size = 0
    for line in lines:
        text = json.dumps([*line.mark, line.values, line.summary, line.detail], separators=(",", ":")).encode()
        if few and size + len(text) > SEGMENT_BYTES:
            yield few, b"[" + b",".join(texts) + b"]"
            few, texts, size = [], [], 0
        few.append(line)
        texts.append(text)
        size += len(text) + 1
    yield few, b"[" + b",".join(texts) + b"]"


def _noted_values(lines: Sequence[Line]) -> dict[str, tuple[str, ...]]:
    """Returns the values of all lines; a line without a name may have any value of it."""
    names = set(lines[0].values).intersection(*(line.values for line in lines))
    found = {name: {value for line in lines for value in line.values[name]} for name in sorted(names)}
    return {name: tuple(sorted(values)) for name, values in found.items() if len(values) <= _VALUES_NOTED}


def _line(found: JsonValue) -> Line:
    match found:
        case [int(created_us), str(job), dict(values), dict(summary), dict(detail)]:
            return Line(Mark(created_us, job), cast("Values", values), summary, detail)
        case _:
            raise ValueError("a line is no line")


_ATTEMPTS = 100


def remove_lines(store: Store, kind: JobKind, jobs: frozenset[str]) -> None:
    """Removes the lines of jobs whose records were removed before.

    The root is written in any case: who read one of these records, and would write its line now, finds that it changed.

    Raises:
        ObjectConflict: Others wrote the root faster, a hundred times in a row.
    """
    for _ in range(_ATTEMPTS):
        base = read_root(store, kind)
        try:
            change = without_lines(store, kind, base[0], jobs)
        except ObjectNotFound:  # another process has replaced a segment since the root was read
            continue
        if swap_root(store, kind, base, change.root) is not None:
            remove_segments(store, kind, change.replaced)
            return
        remove_segments(store, kind, change.written)
    raise ObjectConflict(f"{store.url}: the lines of {kind} changed {_ATTEMPTS} times while some were being removed")
