"""The jobs that are under way, found by their marks, without reading the record of any that ended long ago."""

from concurrent.futures import ThreadPoolExecutor

from specs.errors import ResourceNotFound
from specs.job_kinds import JobKind
from tasks.storage.base.store import Store
from tasks.storage.jobs.lines.marks import open_marks
from tasks.storage.jobs.lines.segments import read_root
from tasks.storage.jobs.records import JobRecord, is_terminal, read, records

_AT_ONCE = 16


def records_under_way(store: Store, kind: JobKind) -> list[JobRecord]:
    """Returns the jobs of a kind that have not ended, oldest first."""
    if not _is_filled(store, kind):  # by an older version: not every job has a mark or a line
        return [record for record in records(store, kind) if not is_terminal(record)]
    jobs = list(dict.fromkeys(mark.id for mark in open_marks(store, kind)))
    with ThreadPoolExecutor(min(_AT_ONCE, len(jobs) or 1)) as pool:
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
