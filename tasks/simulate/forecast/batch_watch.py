"""Takes the times of a batch while it runs, and remembers them when it has come to its end."""

import time
from collections.abc import Sequence

from tasks.simulate.batch.job import OpenBatch
from tasks.simulate.batch.metrics import recorded_metrics, work_of
from tasks.simulate.chunk.timings import ChunkTiming
from tasks.simulate.forecast.run_memory import BatchTiming, process_age_s, remember_batch, worlds_of
from tasks.storage.jobs.records import JobRecord


class _Process:
    batches = 0


class BatchWatch:
    """Takes the times of a batch."""

    def __init__(self) -> None:
        """Begins before the first chunk."""
        self._before_s = None if _Process.batches else process_age_s()
        _Process.batches += 1
        self._began_s = self._driven_s = time.monotonic()

    def drove(self) -> None:
        """Notes that all chunks are committed."""
        self._driven_s = time.monotonic()

    def keep(self, batch: OpenBatch, record: JobRecord, audited: Sequence[ChunkTiming]) -> None:
        """Remembers what a batch took, if this process simulated all of it.

        Args:
            batch: The batch.
            record: Its record at its end.
            audited: What its audit's chunks took.
        """
        metrics = recorded_metrics(record)
        whole = metrics is not None and metrics.chunks == batch.layout.chunks and metrics.workers == 1
        if metrics is None or not whole or record.status != "Completed":
            return
        audit = work_of(audited, simulated_s=0.0, wall_s=0.0)
        remember_batch(
            batch.plan,
            BatchTiming(
                episodes=batch.layout.episodes,
                worlds=worlds_of(batch.plan),
                before_s=self._before_s,
                chunks_s=self._driven_s - self._began_s,
                compile_s=min(metrics.compile_s, self._driven_s - self._began_s),
                after_s=time.monotonic() - self._driven_s,
                audit_compile_s=min(audit.compile_s, time.monotonic() - self._driven_s),
            ),
        )
