"""Takes the times of a batch while it runs, and remembers them when it has come to its end."""

import time
from collections.abc import Sequence

from tasks.progress.durations import taken_s
from tasks.simulate.batch.job import OpenBatch
from tasks.simulate.batch.metrics import recorded_metrics, work_of
from tasks.simulate.chunk.timings import ChunkTiming
from tasks.simulate.forecast.run_memory import BatchTiming, process_age_s, remember_batch, worlds_of
from tasks.storage.jobs.records import JobRecord

# Steps before the first chunk that a run pays again for its worlds, and those that only a first run pays: Prefect's
# database is there the next time, and so are the files of applications.
_OF_WORLDS = ("generate_worlds", "draw_worlds")
_ONCE = ("make_server_database", "unpack_application")


class _Process:
    batches, worlds_s = 0, 0.0


class BatchWatch:
    """Takes the times of a batch."""

    def __init__(self) -> None:
        """Begins before the first chunk."""
        self._before_s = None if _Process.batches else process_age_s()
        worlds_s, self._once_s = taken_s(*_OF_WORLDS), taken_s(*_ONCE)
        self._worlds_s = worlds_s - _Process.worlds_s  # since the batch before
        _Process.batches, _Process.worlds_s = _Process.batches + 1, worlds_s
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
        chunks_s, after_s = self._driven_s - self._began_s, time.monotonic() - self._driven_s
        remember_batch(
            batch.plan,
            BatchTiming(
                episodes=batch.layout.episodes,
                worlds=worlds_of(batch.plan),
                before_s=self._before_s,
                worlds_s=self._worlds_s,
                once_s=self._once_s,
                chunks_s=chunks_s,
                compile_s=min(metrics.compile_s, chunks_s),
                after_s=after_s,
                audit_compile_s=min(
                    work_of(audited, simulated_s=0.0, wall_s=0.0).compile_s, after_s - _rest_s(audited, after_s)
                ),
            ),
        )


def _rest_s(audited: Sequence[ChunkTiming], most_s: float) -> float:
    """Returns what an audit takes at least when its programs are there: its parts drive while others compile.

    Args:
        audited: What its chunks took.
        most_s: What it took.
    """
    return min(most_s, max((each.ready_s + each.slices_s for each in audited), default=0.0))
