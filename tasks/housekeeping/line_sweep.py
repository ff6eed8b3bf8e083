"""The lines of jobs, kept true to the records by gc: removed after a record is, and made good where one is missing.

A job is marked before its record goes, and the mark goes last: killed in between, no list shows what is gone.
"""

from collections.abc import Collection, Iterable, Sequence
from contextlib import suppress

from specs.errors import ResourceNotFound
from specs.job_kinds import JOB_KINDS, JobKind
from tasks.housekeeping.object_kinds import SEGMENTS, Job, kind_of_key
from tasks.storage.base.keys import job_key, line_segment_key
from tasks.storage.base.store import Entry, Store
from tasks.storage.jobs.lines.marks import mark_of, mark_open, open_marks, unmark
from tasks.storage.jobs.lines.removal import remove_lines
from tasks.storage.jobs.lines.segments import Root, read_root, read_segment
from tasks.storage.jobs.records import read


def mark_job(store: Store, job: Job) -> None:
    """Marks a job whose record is about to go, so that lists believe the record and no line."""
    with suppress(ResourceNotFound):
        mark_open(store, job.kind, mark_of(read(store, job.kind, job.id).created_at_s, job.id))


def sweep_lines(store: Store, jobs: Iterable[Job]) -> None:
    """Removes the lines, and then the marks, of those of the jobs that have no record."""
    gone: dict[JobKind, set[str]] = {}
    for job in jobs:
        if not store.exists(job_key(job.kind, job.id)):
            gone.setdefault(job.kind, set()).add(job.id)
    for kind, ids in gone.items():
        remove_lines(store, kind, frozenset(ids))
        for mark in open_marks(store, kind):
            if mark.id in ids:
                unmark(store, kind, mark)


def mend_lines(store: Store, jobs: Collection[Job]) -> None:
    """Marks the jobs that have neither line nor mark, and removes the lines of what has no record.

    Neither happens but when an older version of Simyard, or a person, writes to the store too.

    Args:
        store: Where they are.
        jobs: Those that have a record.
    """
    for kind in JOB_KINDS:
        root = _root(store, kind)
        if root is None or not root.filled:  # the next list reads all records
            continue
        lines = {line.mark.id for note in root.segments for line in read_segment(store, kind, note.name)}
        marked = {mark.id for mark in open_marks(store, kind)}
        recorded = {job.id for job in jobs if job.kind == kind}
        for job in sorted(recorded - lines - marked):
            mark_job(store, Job(kind, job))
        sweep_lines(store, [Job(kind, job) for job in sorted(lines - recorded - marked)])


def unnamed_segments(store: Store, entries: Sequence[Entry]) -> frozenset[str]:
    """Returns the keys of segments that no root names: of processes that were killed; of a damaged root, none."""
    found = {entry.key for entry in entries if kind_of_key(entry.key).what == SEGMENTS}
    roots = [(kind, _root(store, kind)) for kind in JOB_KINDS] if found else []
    if any(root is None for _, root in roots):
        return frozenset()
    return frozenset(
        found - {line_segment_key(kind, note.name) for kind, root in roots if root for note in root.segments}
    )


def _root(store: Store, kind: JobKind) -> Root | None:
    try:
        return read_root(store, kind)[0]
    except ValueError:  # damaged: the next list makes it anew
        return None
