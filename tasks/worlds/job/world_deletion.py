"""BatchDeleteWorlds: worlds that nobody needs any more go, one by one.

A world that a job under way needs stays. What a job that has ended says of a world stays true after the world is gone:
its record and its evidence name the world's digest, and the record of the generation job has the template's digest and
the seed, of which the same world is made again.
"""

from collections.abc import Iterable, Sequence

from pydantic import JsonValue

from specs.arn import Reference, reference_path
from specs.errors import DocumentError, ObjectNotFound
from specs.job_kinds import JobKind
from tasks.storage.base.store import Store
from tasks.storage.jobs.lines.under_way import records_under_way
from tasks.storage.jobs.records import JobRecord, is_terminal, read
from tasks.storage.jobs.runs import KIND as RUN
from tasks.storage.jobs.runs import jobs_of
from tasks.storage.tags import delete_tags
from tasks.storage.worlds import reference_key, world_bytes, write_world

_USERS: Sequence[JobKind] = ("simulation-job-batch", "world-export-job")
_GENERATION: JobKind = "world-generation-job"


def delete_worlds(store: Store, worlds: Iterable[str]) -> list[str]:
    """Returns those of the worlds that are not deleted: they are not there, or a job under way needs them.

    Args:
        store: Where they are.
        worlds: Their references, ``<generation>/<world>``; what is none is not deleted.
    """
    left: list[str] = []
    gone: dict[str, bytes] = {}
    needed = _Needed(store)
    for world in dict.fromkeys(worlds):
        body = None if world in needed or _is_under_way(store, world) else _body(store, world)
        if body is None:
            left.append(world)
            continue
        store.delete(reference_key(world))
        gone[world] = body
    needed = _Needed(store) if gone else needed
    for world, body in gone.items():
        if world in needed:  # a job that began between the look and the removal names it
            write_world(store, world, body)
            left.append(world)
        else:
            delete_tags(store, Reference(kind="world", path=world))
    return left


def _body(store: Store, world: str) -> bytes | None:
    try:
        return world_bytes(store, world)
    except (ObjectNotFound, DocumentError):  # not there, or nothing can be called so
        return None


def _is_under_way(store: Store, world: str) -> bool:
    """Returns whether the job that makes the world has not ended; it would make the world again."""
    try:
        return not is_terminal(read(store, _GENERATION, world.partition("/")[0]))
    except DocumentError:  # somebody added the world, or nothing can be called so
        return False


class _Needed:
    """The worlds that jobs under way name, and those that runs of documents under way have made."""

    def __init__(self, store: Store) -> None:
        users = [each for kind in _USERS for each in records_under_way(store, kind)]
        runs = records_under_way(store, RUN)
        self._worlds = frozenset(world for each in users for world in _named_worlds(each))
        self._generations = frozenset(job for each in runs for kind, job in jobs_of(each) if kind == _GENERATION)

    def __contains__(self, world: str) -> bool:
        return world in self._worlds or world.partition("/")[0] in self._generations


def _named_worlds(record: JobRecord) -> Iterable[str]:
    """Returns the worlds of a batch's plan, or of an export's request."""
    plan = record.request.get("plan")
    if isinstance(plan, dict):
        pinned = plan.get("world_digests")
        return pinned.keys() if isinstance(pinned, dict) else ()
    listed: JsonValue = record.request.get("worlds")
    return [reference_path(str(each)) for each in listed] if isinstance(listed, list) else ()
