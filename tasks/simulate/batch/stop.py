"""The early end of a chunk or a batch: a watch that tells a chunk to stop, and the rows of what was not simulated.

The watch is asked between slices, and asks the store once a second. Episodes that never ran are Canceled, as RoboMaker
calls such jobs.
"""

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Literal

from specs.data.episode import WITHDRAWN, EpisodeResult, unfinished_result
from tasks.simulate.batch.chunk_store import commit
from tasks.simulate.batch.job import OpenBatch, canceled_jobs
from tasks.storage.jobs.records import JobRecord

StopCode = Literal["", "BatchTimedOut", "BatchCanceled"]
STOP_CODES: Mapping[str, StopCode] = {
    "Canceling": "BatchCanceled",
    "Canceled": "BatchCanceled",
    "TimingOut": "BatchTimedOut",
    "TimedOut": "BatchTimedOut",
}
"""Why the episodes of a batch in such a state are Canceled."""
_POLL_S = 1.0
LEFT_OUT = "the batch was ended before it began: the gate was certain"


class StopWatch:
    """Whether the work on a chunk shall end.

    Attributes:
        code: Why it shall, as RoboMaker's failure code; empty as long as it shall not.
        canceled: The jobs that were cancelled by themselves, as last seen.
    """

    def __init__(
        self, batch: OpenBatch, jobs: Collection[int], left_s: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Begins to watch.

        Args:
            batch: Whose record is looked at.
            jobs: Indices of the chunk's jobs; when all of them are cancelled, nothing is left to do.
            left_s: Wall seconds that the batch has left.
            clock: Seconds that never go back.
        """
        self.code: StopCode = ""
        self.canceled: frozenset[int] = frozenset()
        self._batch = batch
        self._jobs = frozenset(jobs)
        self._clock = clock
        self._deadline_s = clock() + left_s
        self._next_look_s = clock()

    def __call__(self) -> bool:
        """Returns whether the work shall end now."""
        now_s = self._clock()
        if now_s >= self._next_look_s:
            self._next_look_s = now_s + _POLL_S
            self.look(self._batch.record())
        if not self.code and now_s >= self._deadline_s:
            self.code = "BatchTimedOut"
        return bool(self.code) or self._jobs <= self.canceled

    def look(self, record: JobRecord) -> None:
        """Notes what the batch's record says now; for who has read it anyway, or must not wait for the next look."""
        self.canceled = canceled_jobs(record)
        if record.status == "Canceling":
            self.code = "BatchCanceled"
        elif record.status == "TimingOut":  # as whoever hands out chunks to many workers finds first
            self.code = "BatchTimedOut"

    def settled(self, row: EpisodeResult) -> EpisodeResult:
        """Returns a row as it stands after what was cancelled: the batch, or this job alone."""
        if row.index in self.canceled:
            return unfinished_result(row.index, "Canceled", failure_code="", failure_reason="the job was canceled")
        if row.status == "Canceled" and row.failure_reason != WITHDRAWN:
            return canceled_row(row.index, self.code)
        return row


def canceled_row(index: int, code: StopCode) -> EpisodeResult:
    """Returns the row of an episode that was not ended because its batch was: BatchTimedOut or BatchCanceled."""
    why = "the batch was canceled" if code == "BatchCanceled" else "the batch's time was over"
    return unfinished_result(index, "Canceled", failure_code=code, failure_reason=why)


def leave_out(batch: OpenBatch, first: int) -> int:
    """Commits all chunks from the one with that number on with Canceled episodes; returns how many those are.

    Doing it again changes nothing, so that a process that dies over it is simply followed by another.
    """
    left_out = 0
    for number in range(first, batch.layout.chunks):
        indices = [request.index for request in batch.layout.chunk(number).requests]
        rows = [unfinished_result(index, "Canceled", failure_code="", failure_reason=LEFT_OUT) for index in indices]
        commit(batch.store, batch.id, number, rows, batch.voucher)
        left_out += len(rows)
    return left_out


def was_left_out(rows: Sequence[EpisodeResult]) -> bool:
    """Returns whether a chunk's rows are those of one that was left out."""
    return bool(rows) and rows[0].failure_reason == LEFT_OUT
