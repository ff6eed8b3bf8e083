"""A batch as a job: opened once, its chunks committed one by one, closed when all are there.

A chunk is committed by creating one immutable object. Killed anywhere, a batch goes on with the chunks that are
missing, and since a chunk's results depend on the plan alone, an unbroken run would have written the same bytes.
"""

import json
import logging
from collections.abc import Callable, Iterator, Mapping

from pydantic import JsonValue

from specs.episode import EpisodeRequest, EpisodeResult, unfinished
from specs.errors import ObjectExists, ObjectNotFound
from specs.world import World
from tasks.simulate.batch_plan import BatchPlan, episodes
from tasks.simulate.chunks import Chunk, plan_chunks
from tasks.storage.keys import chunk_key, world_key
from tasks.storage.records import JobRecord, advance, submit
from tasks.storage.store import Store

logger = logging.getLogger(__name__)
KIND = "simulation-job-batch"
Simulate = Callable[[Chunk, Mapping[str, World]], list[EpisodeResult]]


def open_batch(store: Store, plan: BatchPlan, request: dict[str, JsonValue], token: str) -> JobRecord:
    """Returns the batch of the token, in progress unless it has ended.

    Args:
        store: Where the record is kept.
        plan: What the batch runs.
        request: The StartSimulationJobBatch document.
        token: The client request token.

    Raises:
        IdempotentParameterMismatch: The token came with another batch before.
    """
    record = submit(store, KIND, {"request": request, "plan": plan.model_dump(mode="json")}, token)
    return advance(store, KIND, record.id, "InProgress")


def plan_of(record: JobRecord) -> BatchPlan:
    """Returns the plan that a batch was opened with."""
    return BatchPlan.model_validate(record.request["plan"])


def chunks_of(plan: BatchPlan) -> list[Chunk]:
    """Returns the batch's chunks; the same ones at every call."""
    return plan_chunks(list(episodes(plan)), plan.lanes)


def commit_chunk(store: Store, batch: str, chunk: Chunk, simulate: Simulate) -> list[EpisodeResult]:
    """Returns a chunk's results: the committed ones, or new ones, which are committed if no lane was cancelled.

    Raises:
        ObjectNotFound: A world of the chunk is not in the store.
    """
    committed = committed_chunk(store, batch, chunk.number)
    if committed is not None:
        return committed
    results = simulate(chunk, _worlds(store, chunk.requests))
    if any(result.status == "Canceled" for result in results):
        return results
    try:
        store.create(chunk_key(batch, chunk.number), _encoded(results))
    except ObjectExists:
        logger.info("chunk %d of %s was committed by another process", chunk.number, batch)
    return results


def committed_chunk(store: Store, batch: str, number: int) -> list[EpisodeResult] | None:
    """Returns the results of a chunk that was committed, or None."""
    try:
        body = store.get(chunk_key(batch, number)).body
    except ObjectNotFound:
        return None
    return [EpisodeResult.model_validate(row) for row in json.loads(body)]


def canceled_chunk(chunk: Chunk, reason: str) -> Iterator[EpisodeResult]:
    """Yields a Canceled row for each episode of a chunk that was never started."""
    for request in chunk.requests:
        yield unfinished(request.index, "Canceled", failure_code="BatchTimedOut", failure_reason=reason)


def close_batch(
    store: Store, batch: str, status: str, detail: Mapping[str, JsonValue], failure_reason: str = ""
) -> JobRecord:
    """Returns the batch's record in its terminal state (semantics 4): jobs that Failed do not fail the batch."""
    code = "InternalServiceError" if status == "Failed" else ""
    return advance(store, KIND, batch, status, failure_code=code, failure_reason=failure_reason, detail=dict(detail))


def _worlds(store: Store, requests: tuple[EpisodeRequest, ...]) -> dict[str, World]:
    return {reference: read_world(store, reference) for reference in sorted({request.world for request in requests})}


def read_world(store: Store, reference: str) -> World:
    """Returns the world ``<generation>/<world>``.

    Raises:
        ObjectNotFound: It is not in the store.
    """
    generation, _, name = reference.partition("/")
    return World.model_validate_json(store.get(world_key(generation, name)).body)


def _encoded(results: list[EpisodeResult]) -> bytes:
    rows = [result.model_dump(mode="json") for result in results]
    return json.dumps(rows, sort_keys=True, separators=(",", ":")).encode()


def committed_results(store: Store, record: JobRecord) -> list[EpisodeResult]:
    """Returns the results of a batch's committed chunks, by chunk."""
    chunks = chunks_of(plan_of(record))
    return [result for chunk in chunks for result in committed_chunk(store, record.id, chunk.number) or ()]
