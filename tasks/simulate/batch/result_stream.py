"""The results of a batch in the order of its jobs, some at a time, so that a large batch fits into memory.

A batch that is stopped while nobody works on it is given up here: its unfinished chunks are committed as Canceled.
"""

from collections.abc import Iterator, Mapping

from specs.data.episode import EpisodeRequest, EpisodeResult, unfinished_result
from specs.errors import ObjectNotFound
from tasks.simulate.batch.chunk_store import chunk_numbers, commit_missing, committed_chunk, counted_chunk
from tasks.simulate.batch.job import OpenBatch, canceled_jobs
from tasks.simulate.batch.stop import StopCode, canceled_row

# Some 40 MB if all of them failed and left long trajectories.
PART_EPISODES = 2048
# Each part of a shuffled batch is spread over all of its chunks, which are read again for the next one.
SHUFFLED_PART_EPISODES = 16_384
STOP_CODES: Mapping[str, StopCode] = {
    "Canceling": "BatchCanceled",
    "Canceled": "BatchCanceled",
    "TimingOut": "BatchTimedOut",
    "TimedOut": "BatchTimedOut",
}


def result_parts(batch: OpenBatch, status: str) -> Iterator[tuple[list[EpisodeRequest], list[EpisodeResult]]]:
    """Yields a batch's episodes by index, some at a time, and a result for each.

    Episodes of a batch that was stopped before they began are Canceled.

    Args:
        batch: The batch.
        status: Its status; a batch that was stopped is not judged, so that its chunks are taken as they are.

    Raises:
        ObjectNotFound: A chunk of a batch that was not stopped is not committed.
        StageFailed: Nobody vouches for a chunk of a batch that was not stopped.
    """
    code = STOP_CODES.get(status, "")
    size = SHUFFLED_PART_EPISODES if batch.plan.shuffled else PART_EPISODES
    for first in range(0, batch.layout.episodes, size):
        end = min(first + size, batch.layout.episodes)
        requests = list(batch.layout.requests(first, end))
        yield requests, _results(batch, first, end, code)


def _results(batch: OpenBatch, first: int, end: int, code: StopCode) -> list[EpisodeResult]:
    found: dict[int, EpisodeResult] = {}
    for number in batch.layout.chunks_between(first, end):
        rows = _rows(batch, number, code)
        if rows is None and not code:
            raise ObjectNotFound(f"{batch.store.url}: chunk {number} of {batch.id} is not committed")
        found.update((row.index, row) for row in rows or () if first <= row.index < end)
    return [found.get(index) or canceled_row(index, code) for index in range(first, end)]


def _rows(batch: OpenBatch, number: int, code: StopCode) -> list[EpisodeResult] | None:
    if code:
        return committed_chunk(batch.store, batch.id, number)
    return counted_chunk(batch.store, batch.id, number, batch.voucher)


def give_up(batch: OpenBatch) -> None:
    """Commits the chunks that were begun and have no end: their episodes are Canceled.

    From then on a process that was only paused, and still simulates one of them, comes too late: a chunk is committed
    once. What was never begun needs no row, for who looks at the batch's record begins nothing any more.

    Args:
        batch: In a state that stops it; its claim is held.
    """
    record = batch.record()
    code, alone = STOP_CODES[record.status], canceled_jobs(record)
    chunks = chunk_numbers(batch.store, batch.id)
    for number in sorted(chunks.begun - chunks.committed):
        rows = [_row(request.index, code, alone) for request in batch.layout.chunk(number).requests]
        commit_missing(batch.store, batch.id, number, rows, batch.voucher)


def _row(index: int, code: StopCode, alone: frozenset[int]) -> EpisodeResult:
    if index in alone:
        return unfinished_result(index, "Canceled", failure_code="", failure_reason="the job was canceled")
    return canceled_row(index, code)
