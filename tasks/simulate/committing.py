"""One chunk of a batch: its worlds loaded, its episodes simulated, what came of them committed."""

import functools
import hashlib
from collections.abc import Callable, Mapping
from typing import NamedTuple

from specs.episode import EpisodeRequest, EpisodeResult, unfinished
from specs.errors import ObjectNotFound, SimyardError
from specs.world import World
from tasks.simulate.batch import OpenBatch, time_out
from tasks.simulate.chunk_store import begin_chunk, commit, committed_chunk
from tasks.simulate.chunks import Chunk
from tasks.simulate.fitting import after_deaths, simulate_fitting
from tasks.simulate.stopping import StopWatch
from tasks.storage.keys import world_key
from tasks.storage.opening import open_store

Simulate = Callable[[Chunk, Mapping[str, World], int, StopWatch], list[EpisodeResult]]
# As many as a chunk of the default size has at most.
_WORLDS_KEPT = 256


class ChunkEnd(NamedTuple):
    """How a chunk ended.

    Attributes:
        episodes: How many it has.
        lanes: How many fitted into memory at a time; more need not be tried again.
    """

    episodes: int
    lanes: int


def run_chunk(
    batch: OpenBatch, number: int, simulate: Simulate, *, lanes: int, left_s: float, spent_s: float = 0.0
) -> ChunkEnd:
    """Returns how a chunk ended, once its results are committed; one that was committed before is not run again.

    Args:
        batch: The batch.
        number: The chunk's number.
        simulate: Simulates episodes in worlds with so many lanes, until the watch says stop.
        lanes: How many lanes fit into memory, as far as is known.
        left_s: Wall seconds that the batch has left.
        spent_s: Wall seconds that were spent on it before.
    """
    committed = committed_chunk(batch.store, batch.id, number)
    if committed is not None:
        return ChunkEnd(len(committed), lanes)
    start = begin_chunk(batch.store, batch.id, number, spent_s)
    chunk = batch.layout.chunk(number)
    worlds, missing = _worlds(batch, chunk)
    sound = tuple(request for request in chunk.requests if request.world in worlds)
    watch = StopWatch(batch, [request.index for request in sound], left_s)
    rows, lanes = simulate_fitting(
        chunk.model_copy(update={"requests": sound}),
        after_deaths(lanes, start.attempts),
        lambda part, fitting: simulate(part, worlds, fitting, watch),
        watch,
    )
    by_index = {row.index: _canceled(row, watch) for row in rows}
    if watch.code == "BatchTimedOut" and any(row.status == "Canceled" for row in by_index.values()):
        time_out(batch)  # before the commit: whoever goes on from here must not begin the rest
    ordered = [by_index.get(each.index) or _lost(each, missing[each.world]) for each in chunk.requests]
    return ChunkEnd(len(commit(batch.store, batch.id, number, ordered)), lanes)


def _canceled(row: EpisodeResult, watch: StopWatch) -> EpisodeResult:
    """Returns a row as it stands after what was cancelled: the batch, or this job alone."""
    if row.index in watch.canceled:
        return unfinished(row.index, "Canceled", failure_code="", failure_reason="the job was canceled")
    if row.status == "Canceled":
        return canceled_row(row.index, watch.code)
    return row


def canceled_row(index: int, code: str) -> EpisodeResult:
    """Returns the row of an episode that was not ended because its batch was: BatchTimedOut or BatchCanceled."""
    why = "the batch was canceled" if code == "BatchCanceled" else "the batch's time was over"
    return unfinished(index, "Canceled", failure_code=code, failure_reason=why)


def _lost(request: EpisodeRequest, why: str) -> EpisodeResult:
    code, _, reason = why.partition(": ")
    return unfinished(request.index, "Failed", failure_code=code, failure_reason=reason, outcome_reason="crash")


def _worlds(batch: OpenBatch, chunk: Chunk) -> tuple[dict[str, World], dict[str, str]]:
    """Returns the chunk's worlds, and of those that cannot be used why, as code and reason."""
    worlds: dict[str, World] = {}
    missing: dict[str, str] = {}
    for reference in dict.fromkeys(request.world for request in chunk.requests):
        try:
            worlds[reference] = _world(batch.store.url, reference, batch.plan.world_digests[reference])
        except ObjectNotFound:
            missing[reference] = f"InvalidS3Resource: world {reference} does not exist"
        except _WorldChanged:
            missing[reference] = f"MismatchedEtag: world {reference} is not what it was when the batch was planned"
    return worlds, missing


@functools.lru_cache(maxsize=_WORLDS_KEPT)
def _world(store_url: str, reference: str, digest: str) -> World:
    """Returns a world; the last ones are kept, since chunks that follow one another share theirs."""
    generation, _, name = reference.partition("/")
    body = open_store(store_url).get(world_key(generation, name)).body
    if hashlib.sha256(body).hexdigest() != digest:
        raise _WorldChanged(reference)
    return World.model_validate_json(body)


class _WorldChanged(SimyardError):  # noqa: N818 - a state
    """A world's document has another digest than the batch's plan says."""
