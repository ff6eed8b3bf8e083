"""Marks of the jobs that have no line yet: all that are under way, and those that ended a moment ago.

A mark is an object whose key says all: when the job was made, and its id. It is written before the job's record, so
that no record is ever without one, and removed after the job's line was written. Where there is a mark, the record is
believed and no line.
"""

from typing import NamedTuple

from specs.job_kinds import JobKind
from tasks.storage.base.key_rules import key_pattern
from tasks.storage.base.keys import LINE_MARK, line_mark_key, line_marks_prefix
from tasks.storage.base.store import Store

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
