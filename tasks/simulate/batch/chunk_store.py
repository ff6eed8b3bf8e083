"""The chunks of a batch in the store: when each was begun, and its committed results."""

import time
from collections.abc import Sequence

from pydantic import TypeAdapter

from specs.base import Spec
from specs.data.episode import EpisodeResult
from specs.errors import ObjectExists, ObjectNotFound
from tasks.storage.base.encoding import decode_document, encode_document
from tasks.storage.base.keys import chunk_key, chunk_start_key, chunks_prefix
from tasks.storage.base.store import Store

_ROWS = TypeAdapter(list[EpisodeResult])


class ChunkStart(Spec):
    """When a chunk was last begun; for telling people and for the batch's timeout, never for results.

    Attributes:
        attempts: How often it was begun; more than once when the process that simulated it died.
        started_at_s: Seconds since 1970.
        spent_s: Wall seconds that were spent on the batch before.
    """

    attempts: int
    started_at_s: float
    spent_s: float


class ChunkNumbers(Spec):
    """Which chunks of a batch were begun, and which are committed."""

    begun: frozenset[int]
    committed: frozenset[int]


def begin_chunk(store: Store, batch: str, number: int, spent_s: float) -> ChunkStart:
    """Records that a chunk is begun, and returns what was recorded.

    Args:
        store: Where the batch is.
        batch: Its id.
        number: The chunk's.
        spent_s: Wall seconds that were spent on the batch before.
    """
    before = chunk_start(store, batch, number)
    attempts = 1 + (before.attempts if before else 0)
    start = ChunkStart(attempts=attempts, started_at_s=time.time(), spent_s=spent_s)
    store.put(chunk_start_key(batch, number), encode_document(start))
    return start


def chunk_start(store: Store, batch: str, number: int) -> ChunkStart | None:
    """Returns when a chunk was last begun, or None."""
    key = chunk_start_key(batch, number)
    try:
        return decode_document(ChunkStart, store.get(key), store, key)
    except ObjectNotFound:
        return None


def commit(store: Store, batch: str, number: int, results: Sequence[EpisodeResult]) -> list[EpisodeResult]:
    """Returns what is committed of a chunk from now on: these results, or those of another process that was faster.

    Args:
        store: Where the batch is.
        batch: Its id.
        number: The chunk's.
        results: Of its episodes, in request order.
    """
    try:
        store.create(chunk_key(batch, number), _ROWS.dump_json(list(results)))
    except ObjectExists:
        return committed_chunk(store, batch, number) or []
    return list(results)


def committed_chunk(store: Store, batch: str, number: int) -> list[EpisodeResult] | None:
    """Returns the results of a chunk that was committed, or None."""
    try:
        return _ROWS.validate_json(store.get(chunk_key(batch, number)).body)
    except ObjectNotFound:
        return None


def is_committed(store: Store, batch: str, number: int) -> bool:
    """Returns whether a chunk was committed."""
    return store.exists(chunk_key(batch, number))


def chunk_numbers(store: Store, batch: str) -> ChunkNumbers:
    """Returns which chunks were begun and which are committed, as a listing tells."""
    names = [key.rpartition("/")[2].removesuffix(".json") for key in store.keys(chunks_prefix(batch))]
    committed = frozenset(int(name) for name in names if name.isdecimal())
    begun = frozenset(int(name.removesuffix(".started")) for name in names if name.endswith(".started"))
    return ChunkNumbers(begun=begun | committed, committed=committed)


def spent_s(store: Store, batch: str) -> float:
    """Returns the wall seconds that processes before this one spent on a batch, up to the last chunk they began."""
    begun = chunk_numbers(store, batch).begun
    start = chunk_start(store, batch, max(begun)) if begun else None
    return start.spent_s if start else 0.0
