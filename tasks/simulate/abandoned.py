"""A batch that is being stopped while nobody works on it."""

from specs.episode import EpisodeResult, unfinished
from tasks.simulate.batch import OpenBatch, canceled_jobs
from tasks.simulate.chunk_store import chunk_numbers, commit
from tasks.simulate.stopping import canceled_row
from tasks.simulate.streaming import STOP_CODES


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
        commit(batch.store, batch.id, number, rows)


def _row(index: int, code: str, alone: frozenset[int]) -> EpisodeResult:
    if index in alone:
        return unfinished(index, "Canceled", failure_code="", failure_reason="the job was canceled")
    return canceled_row(index, code)
