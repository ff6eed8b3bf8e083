"""Removes the lines of jobs whose records are gone."""

from specs.errors import ObjectConflict, ObjectNotFound
from specs.job_kinds import JobKind
from tasks.storage.base.store import Store
from tasks.storage.jobs.lines.segments import read_root, remove_segments, swap_root, without_lines

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
