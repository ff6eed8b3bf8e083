"""Reads what lists show: a page of it, the newest first, however much the store holds."""

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import TypeVar

from flows.gateway.page.visit import Visit, missing
from specs.errors import ObjectNotFound, StoreAccessDenied, StoreError, StoreUnreachable
from specs.job_kinds import JobKind
from tasks.gateway.page.content import Steps
from tasks.storage.base.encoding import decode_document
from tasks.storage.base.keys import job_key, jobs_prefix
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord

PAGE_ROWS = 50
MOST_BYTES = 16 << 20
"""More than the record of a batch in ten thousand worlds has."""
_THREADS = 8
T = TypeVar("T")
R = TypeVar("R")


def newest_names(visit: Visit, prefix: str, name_of: Callable[[str], str]) -> list[str]:
    """Returns the names of what lies in a folder, what was written last first; what may not be seen is left out.

    One listing, and nothing is read.

    Args:
        visit: Who looks, and where.
        prefix: The folder.
        name_of: Returns the name that a key stands for; empty for one that is left out.
    """
    found = sorted(visit.store.entries(prefix), key=lambda entry: (-entry.written_s, entry.key))
    return [name for entry in found if (name := name_of(entry.key))]


def newest_jobs(visit: Visit, kind: JobKind) -> list[str]:
    """Returns the ids of the jobs of a kind, what was changed last first."""
    folder = f"{jobs_prefix(kind)}/"

    def name_of(key: str) -> str:
        name = key.removeprefix(folder).removesuffix(".json")
        return name if visit.may_read(visit.arn(kind, name)) else ""

    return newest_names(visit, folder.rstrip("/"), name_of)


def step_of(visit: Visit, found: Sequence[T], here: str, rows: int = PAGE_ROWS) -> tuple[Sequence[T], Steps | None]:
    """Returns the page of a list that is wanted, and where those beside it are; None if it is the only one.

    Args:
        visit: Who looks.
        found: All of the list.
        here: The address of the list.
        rows: How many stand on a page.
    """
    first = (visit.step - 1) * rows
    shown = found[first : first + rows]
    if len(found) <= rows:
        return shown, None
    words = f"{first + 1:,} to {first + len(shown):,} of {len(found):,}" if shown else f"{len(found):,} in all"
    newer = f"{here}?step={min(visit.step - 1, -(-len(found) // rows))}" if visit.step > 1 else ""
    return shown, Steps(words, newer, f"{here}?step={visit.step + 1}" if first + rows < len(found) else "")


def known_job(store: Store, kind: JobKind, name: str) -> JobRecord | None:
    """Returns the record of a job; None if it is gone or cannot be read, which must not take the list with it.

    Raises:
        StoreUnreachable: The store does not answer.
        StoreAccessDenied: It may not be read.
        DocumentError: The name can be no job's.
    """
    key = job_key(kind, name)
    try:
        return decode_document(JobRecord, store.get(key, MOST_BYTES), store, key)
    except (StoreUnreachable, StoreAccessDenied):
        raise
    except StoreError:
        return None


def job(visit: Visit, kind: JobKind, name: str) -> JobRecord:
    """Returns the record of a job that may be seen.

    Raises:
        ResourceNotFound: There is none, or it may not be seen.
        DocumentError: The name can be no job's.
    """
    visit.require(kind, name)
    found = known_job(visit.store, kind, name)
    if found is None:
        raise missing(kind, name)
    return found


def known_jobs(visit: Visit, kind: JobKind, names: Iterable[str]) -> list[JobRecord]:
    """Returns the records of jobs in the same order, without those that cannot be read."""
    found = at_once(partial(known_job, visit.store, kind), names)
    return [record for record in found if record]


def at_once(read: Callable[[T], R], wanted: Iterable[T]) -> list[R]:
    """Returns what is read of each, in the same order; a few are asked for at a time."""
    with ThreadPoolExecutor(_THREADS) as pool:
        return list(pool.map(read, wanted))


def read_bytes(store: Store, key: str, most_bytes: int = MOST_BYTES) -> bytes | None:
    """Returns an object; None if there is none."""
    try:
        return store.get(key, most_bytes).body
    except ObjectNotFound:
        return None
