"""The rest of a batch that nobody needs any more: its episodes are Canceled, as RoboMaker calls jobs that never ran."""

from collections.abc import Sequence

from specs.episode import EpisodeResult, unfinished
from tasks.simulate.batch import OpenBatch
from tasks.simulate.chunk_store import commit

LEFT_OUT = "the batch was ended before it began: the gate was certain"


def leave_out(batch: OpenBatch, first: int) -> int:
    """Commits all chunks from the one with that number on with Canceled episodes; returns how many those are.

    Doing it again changes nothing, so that a process that dies over it is simply followed by another.
    """
    left_out = 0
    for number in range(first, batch.layout.chunks):
        indices = [request.index for request in batch.layout.chunk(number).requests]
        rows = [unfinished(index, "Canceled", failure_code="", failure_reason=LEFT_OUT) for index in indices]
        commit(batch.store, batch.id, number, rows)
        left_out += len(rows)
    return left_out


def was_left_out(rows: Sequence[EpisodeResult]) -> bool:
    """Returns whether a chunk's rows are those of one that was left out."""
    return bool(rows) and rows[0].failure_reason == LEFT_OUT
