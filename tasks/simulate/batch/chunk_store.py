"""The chunks of a batch in the store: when each was begun, and its committed results.

A chunk begins with the owner's MAC of the columns that follow (``tasks.storage.jobs.authenticator``), so that nothing
is counted that somebody else has written there (docs/decisions/0040-results-as-columns.md). One whose MAC is not this
owner's is simulated anew and compared.

NumPy is imported when a chunk is read or written: who lists jobs does neither.
"""
# ruff: noqa: PLC0415 - see above

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from specs.base import Spec
from specs.data.episode import EpisodeResult
from specs.errors import ObjectExists, ObjectNotFound, StageFailed
from tasks.storage.base.keys import chunk_key, chunk_start_key, chunks_prefix
from tasks.storage.base.store import Store, encode_document, find_document
from tasks.storage.jobs.authenticator import MAC_LENGTH, BatchAuthenticator

if TYPE_CHECKING:
    from specs.data.episode_columns import EpisodeColumns

_MAC_BEGIN, _COLUMNS = b'{"mac":"', b'"}\n'
_BEGUN = ".started"
_ROWS_SHOWN = 3
# What an exchange with ROS nodes saw of this machine does not follow from the request: how they kept up, and what a
# node that failed printed last.
_SEEN_OF_ROS = frozenset({"late", "stray", "failure_reason"})


def authenticated_bytes(
    results: "Sequence[EpisodeResult] | EpisodeColumns", number: int, authenticator: BatchAuthenticator
) -> bytes:
    """Returns a chunk's bytes; of equal results the same.

    Args:
        results: Of its episodes.
        number: The chunk's.
        authenticator: Authenticates them.
    """
    from specs.data.column_bytes import encode_columns
    from specs.data.episode_columns import EpisodeColumns

    body = encode_columns(EpisodeColumns.of(results))
    return b"".join([_MAC_BEGIN, authenticator.mac(_columns_name(number), body).encode(), _COLUMNS, body])


def results_in(body: bytes) -> "EpisodeColumns":
    """Returns the results in a chunk, whoever wrote them.

    Raises:
        ValueError: There are none.
    """
    from specs.data.column_bytes import decode_columns

    return decode_columns(_mac_and_columns(body)[1])


def is_authentic(body: bytes, number: int, authenticator: BatchAuthenticator) -> bool:
    """Returns whether an owner authenticates a chunk's bytes, under its number."""
    mac, columns = _mac_and_columns(body)
    return authenticator.authenticates(mac, _columns_name(number), columns)


def _mac_and_columns(body: bytes) -> tuple[str, bytes]:
    """Returns a chunk's MAC and columns; neither of what is no chunk."""
    place = len(_MAC_BEGIN) + MAC_LENGTH
    if not body.startswith(_MAC_BEGIN) or body[place : place + len(_COLUMNS)] != _COLUMNS:
        return "", b""
    return body[len(_MAC_BEGIN) : place].decode(errors="replace"), body[place + len(_COLUMNS) :]


def _columns_name(number: int) -> str:
    return f"columns of chunk {number}"


# A chunk says what vouches for its results (``tasks.storage.jobs.authenticator``), so that nothing is counted that
# somebody else has written there. One that this owner cannot vouch for is simulated anew and compared.
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


class ChunkTimes(NamedTuple):
    """When chunks of a batch were last begun, and committed, by their numbers: by the store's clock, for people."""

    begun_s: dict[int, float]
    committed_s: dict[int, float]

    @property
    def begun(self) -> frozenset[int]:
        """Returns those that were begun, committed or not."""
        return frozenset(self.begun_s | self.committed_s)


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
    return find_document(store, chunk_start_key(batch, number), ChunkStart)


class StoredChunk(NamedTuple):
    """A chunk as it lies in the store.

    Attributes:
        results: Its results; None if they are not results at all.
        authentic: Whether their MAC is this owner's.
    """

    results: "EpisodeColumns | None"
    authentic: bool

    @property
    def rows(self) -> list[EpisodeResult] | None:
        """Returns its results as rows."""
        return _rows(self.results)


def commit(
    store: Store,
    batch: str,
    number: int,
    results: "Sequence[EpisodeResult] | EpisodeColumns",
    authenticator: BatchAuthenticator,
) -> "EpisodeColumns":
    """Returns what is committed of a chunk from now on: these results, or those of another process that was faster.

    Results that lie there and that nobody vouches for are replaced by equal ones.

    Args:
        store: Where the batch is.
        batch: Its id.
        number: The chunk's.
        results: Of its episodes, in request order.
        authenticator: Authenticates them.

    Raises:
        StageFailed: There are other results, which nobody vouches for.
    """
    from specs.data.episode_columns import EpisodeColumns

    columns = EpisodeColumns.of(results)
    body = authenticated_bytes(columns, number, authenticator)
    try:
        store.create(chunk_key(batch, number), body)
    except ObjectExists:
        found = stored_chunk(store, batch, number, authenticator)
        if found is not None and found.authentic and found.results is not None:
            return found.results
        if found is not None:
            _require_same(store, chunk_key(batch, number), found.rows, columns.rows())
        store.put(chunk_key(batch, number), body)
    return columns


def commit_missing(
    store: Store, batch: str, number: int, results: Sequence[EpisodeResult], authenticator: BatchAuthenticator
) -> None:
    """Commits a chunk if nobody else has: for a batch that was stopped, whose results are not judged."""
    try:
        store.create(chunk_key(batch, number), authenticated_bytes(results, number, authenticator))
    except ObjectExists:
        return


def stored_chunk(store: Store, batch: str, number: int, authenticator: BatchAuthenticator) -> StoredChunk | None:
    """Returns a chunk that was committed, and whether its MAC is its owner's; None if there is none."""
    try:
        body = store.get(chunk_key(batch, number)).body
    except ObjectNotFound:
        return None
    try:
        return StoredChunk(results_in(body), is_authentic(body, number, authenticator))
    except ValueError:
        return StoredChunk(None, authentic=False)


def counted_columns(
    store: Store, batch: str, number: int, authenticator: BatchAuthenticator
) -> "EpisodeColumns | None":
    """Returns the results of a chunk to be counted, or None if it is not committed.

    Raises:
        StageFailed: Nobody vouches for what lies there.
    """
    found = stored_chunk(store, batch, number, authenticator)
    if found is not None and not found.authentic:
        why = f"{store.url}/{chunk_key(batch, number)} is not what this owner's process wrote there"
        raise StageFailed("MismatchedEtag", f"{why}. Somebody has changed it: run the document again")
    return found.results if found else None


def counted_chunk(
    store: Store, batch: str, number: int, authenticator: BatchAuthenticator
) -> list[EpisodeResult] | None:
    """Returns what `counted_columns` does, as rows."""
    return _rows(counted_columns(store, batch, number, authenticator))


def committed_columns(store: Store, batch: str, number: int) -> "EpisodeColumns | None":
    """Returns the results of a chunk that was committed, whoever wrote them, or None; to be shown, not to be judged.

    Raises:
        ValueError: What lies there are no results.
    """
    try:
        return results_in(store.get(chunk_key(batch, number)).body)
    except ObjectNotFound:
        return None


def committed_chunk(store: Store, batch: str, number: int) -> list[EpisodeResult] | None:
    """Returns what `committed_columns` does, as rows."""
    return _rows(committed_columns(store, batch, number))


def row_changes(found: Sequence[EpisodeResult] | None, computed: Sequence[EpisodeResult]) -> list[str]:
    """Returns how results differ from those that were computed, the first three of them; nothing if they are the same.

    Equal is what is written as the same bytes, but for what of an episode with ROS nodes the machine decides.

    Args:
        found: As they lie there; None if they are not results at all.
        computed: In the order that they should have.
    """
    if found is None or [row.index for row in found] != [row.index for row in computed]:
        return ["it does not hold the results of its episodes"]
    changed = [
        f"episode {ours.index} says {_differing(theirs, ours)}"
        for theirs, ours in zip(found, computed, strict=True)
        if _compared(theirs, ours) != _compared(ours, theirs)
    ]
    more = [f"and {len(changed) - _ROWS_SHOWN} more episodes"] if len(changed) > _ROWS_SHOWN else []
    return [*changed[:_ROWS_SHOWN], *more]


def chunk_numbers(store: Store, batch: str) -> ChunkNumbers:
    """Returns which chunks were begun and which are committed, as a listing tells."""
    names = [key.rpartition("/")[2].removesuffix(".json") for key in store.keys(chunks_prefix(batch))]
    committed = frozenset(int(name) for name in names if name.isdecimal())
    begun = frozenset(int(name.removesuffix(_BEGUN)) for name in names if name.endswith(_BEGUN))
    return ChunkNumbers(begun=begun | committed, committed=committed)


def chunk_times(store: Store, batch: str) -> ChunkTimes:
    """Returns when chunks were begun and committed, as a listing tells."""
    written_s = {each.key.rpartition("/")[2]: each.written_s for each in store.entries(chunks_prefix(batch))}
    names = {name.removesuffix(".json"): at_s for name, at_s in written_s.items()}
    return ChunkTimes(
        begun_s={int(name.removesuffix(_BEGUN)): at_s for name, at_s in names.items() if name.endswith(_BEGUN)},
        committed_s={int(name): at_s for name, at_s in names.items() if name.isdecimal()},
    )


def spent_s(store: Store, batch: str) -> float:
    """Returns the wall seconds that processes before this one spent on a batch, up to the last chunk they began."""
    begun = chunk_numbers(store, batch).begun
    start = chunk_start(store, batch, max(begun)) if begun else None
    return start.spent_s if start else 0.0


def _require_same(
    store: Store, key: str, found: Sequence[EpisodeResult] | None, computed: Sequence[EpisodeResult]
) -> None:
    """Lets results that nobody vouches for pass if they are those that were computed.

    They are refused, and not just replaced: either somebody has tampered with the store, or two machines of this owner
    do not compute the same, and a person has to know of both.
    """
    changes = row_changes(found, computed)
    if changes:
        why = f"{store.url}/{key} was not written by this owner, and is not what the simulation gives: "
        raise StageFailed("MismatchedEtag", f"{why}{'; '.join(changes)}. To simulate all anew, run the document again")


def _compared(row: EpisodeResult, other: EpisodeResult) -> str:
    return row.model_dump_json(exclude=set(_left_out(row, other)))


def _left_out(*rows: EpisodeResult) -> frozenset[str]:
    """Returns the fields that are not compared: some, if all rows are of ROS nodes."""
    return frozenset[str]() if any(row.late is None for row in rows) else _SEEN_OF_ROS


def _differing(theirs: EpisodeResult, ours: EpisodeResult) -> str:
    fields = [name for name in EpisodeResult.model_fields if name not in _left_out(theirs, ours)]
    names = [name for name in fields if repr(getattr(theirs, name)) != repr(getattr(ours, name))]
    shown = [f"{name} {_short(getattr(theirs, name))}, computed {_short(getattr(ours, name))}" for name in names]
    return ", ".join(shown[:_ROWS_SHOWN])


def _short(value: object) -> str:
    return repr(value)[:80]


def _rows(results: "EpisodeColumns | None") -> list[EpisodeResult] | None:
    return None if results is None else results.rows()
