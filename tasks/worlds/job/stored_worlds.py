"""Worlds that are put into a store by hand, and worlds that are deleted from it (BatchDeleteWorlds).

A world that a job under way needs stays. What a job that has ended says of a world stays true after the world is gone:
its record and its evidence name the world's digest, and the record of the generation job has the template's digest and
the seed, of which the same world is made again.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path

from pydantic import JsonValue, ValidationError

from specs.arn import Reference, reference_path
from specs.data.world import World
from specs.errors import DocumentError, ObjectExists, ObjectNotFound
from specs.job_kinds import JobKind
from specs.pipeline.world_sections import source_kind
from tasks.storage.base.store import Store
from tasks.storage.jobs.job_index import records_under_way
from tasks.storage.jobs.records import JobRecord, is_terminal, read
from tasks.storage.jobs.runs import KIND as RUN
from tasks.storage.jobs.runs import jobs_of
from tasks.storage.tags import delete_tags
from tasks.storage.worlds import decode_world, encode_world, reference_key, world_bytes, write_world

_MEASURED = (
    "origin_clear_radius_m",
    "reachable_robot_radius_m",
    "doors_as_set_robot_radius_m",
    "narrowest_passage_m",
    "free_floor_share",
    "overlaps",
)

_USERS: Sequence[JobKind] = ("simulation-job-batch", "world-export-job")
_GENERATION: JobKind = "world-generation-job"


def add_world(store: Store, file: Path) -> str:
    """Returns ``<generation>/<world>`` of a world that is in the store now; the same one may be there already.

    Args:
        store: Where it goes.
        file: The world's document.

    Raises:
        DocumentError: It is no world, its certificate or its map is not that of its geometry, or another world of
            that name is there.
    """
    try:
        world = decode_world(file.read_bytes())
    except (OSError, ValidationError) as exc:
        allowed = "the document of a world, which this version of Simyard wrote"
        if file.is_file() and source_kind(file.name):
            allowed += f"; `simyard world import {file}` makes a world of a building of your own"
        raise _fault(file, str(exc).splitlines()[0], allowed) from exc
    if wrong := _wrong_fields(world):
        raise _fault(file, ", ".join(wrong), "what is measured on the world's geometry")
    reference = f"{world.generation}/{world.name}"
    try:
        write_world(store, reference, encode_world(world))
    except ObjectExists as exc:
        raise _fault(file, reference, "a name that no other world has there") from exc
    return reference


def _wrong_fields(world: World) -> list[str]:
    """Returns what a world's document says of it and is not so."""
    from tasks.worlds.importer.own_floor import keep_pieces  # noqa: PLC0415 - NumPy, which a gateway's answers do not need

    measured = keep_pieces(world, {piece.name for piece in world.furniture})
    said, found = world.certificate, measured.certificate
    wrong = [f"certificate.{name}" for name in _MEASURED if getattr(said, name) != getattr(found, name)]
    return [*wrong, *(["map"] if measured.map != world.map else [])]


def _fault(file: Path, value: str, allowed: str) -> DocumentError:
    return DocumentError.of(str(file), value, allowed, source="simyard")


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
