"""Spreads a batch's chunks over the workers of a Dask or Ray cluster, which share nothing but the store.

Chunks are the same as on one machine, and whoever simulates one commits it, so that the tables are the same bytes.
"""

import os
import platform
import time
from collections.abc import Mapping
from typing import Any, NamedTuple

from prefect import task
from prefect.cache_policies import NO_CACHE
from prefect.futures import PrefectFuture

from flows.batch.batch_steps import EPISODES, simulate_chunk
from flows.run.events import announce_changes
from flows.workers.crew import Width, on_workers
from flows.workers.spread import Numbers, PieceOutcome, spread
from specs.field_types import OutputLocation
from specs.settings import Workers
from tasks.progress.listener import Progress
from tasks.progress.step_retry import STORE_RETRY
from tasks.progress.task import named_by, show_progress
from tasks.simulate.batch.chunk_store import chunk_numbers, spent_s, stored_chunk
from tasks.simulate.batch.job import GOING, STOPPING, OpenBatch, load_batch, time_out
from tasks.simulate.batch.metrics import BatchMeter, BatchMetrics, ChunkWork
from tasks.simulate.batch.prepared_chunks import chunks_ahead, forget_chunks
from tasks.simulate.batch.provenance import note_machine
from tasks.simulate.batch.result_stream import give_up
from tasks.storage.jobs.voucher import Voucher
from tasks.storage.store_url import open_store


class ChunksDone(NamedTuple):
    """What a worker did: episodes of the chunks that it came to, the seconds that it took, and what they went into."""

    episodes: int
    wall_s: float
    work: ChunkWork = ChunkWork()
    worker: str = ""


def spread_batch(batch: OpenBatch, location: OutputLocation, workers: Workers) -> BatchMetrics | None:
    """Commits all chunks of a batch, or those before it is cancelled or its time is over; returns its speed.

    Raises:
        StageFailed: A chunk was lost several times.
    """
    meter = BatchMeter()

    def episodes(width: Width) -> None:
        with show_progress(EPISODES, "episodes-progress") as progress:
            work = _Spread(batch, location, progress, meter)
            spread(
                work.left,
                work.hand_out,
                width=width,
                going=work.going,
                missing=work.missing,
                on_end=work.on_end,
            )
            progress(work.done, batch.layout.episodes)

    on_workers(workers, "episodes", batch.id, episodes)
    if batch.record().status in STOPPING:
        give_up(batch)  # the chunks of workers that are gone; a worker that comes back is too late
    return meter.metrics()


class _Spread:
    """A batch that is being handed out."""

    def __init__(self, batch: OpenBatch, location: OutputLocation, progress: Progress, meter: BatchMeter) -> None:
        committed = [number for number in chunk_numbers(batch.store, batch.id).committed if _is_vouched(batch, number)]
        self.left = [number for number in range(batch.layout.chunks) if number not in committed]
        self.done = sum(map(batch.layout.chunk_size, committed))
        self._batch, self._location, self._progress, self._meter = batch, location, progress, meter
        self._before_s, self._start_s = spent_s(batch.store, batch.id), time.monotonic()

    def hand_out(self, numbers: Numbers) -> PrefectFuture[Any]:
        batch, worked_s = self._batch, self._worked_s()
        return simulate_chunks.submit(
            batch.store.url,
            batch.id,
            numbers,
            location=self._location,
            left_s=batch.plan.timeout_s - worked_s,
            spent_s=worked_s,
            voucher=self._batch.voucher,
        )

    def going(self) -> bool:
        """Returns whether more chunks are wanted; workers find the batch's end in its record, too."""
        over = self._worked_s() >= self._batch.plan.timeout_s
        now = time_out(self._batch) if over else self._batch.record()
        return now.status in GOING

    def missing(self, numbers: Numbers) -> Numbers:
        return tuple(number for number in numbers if not _is_vouched(self._batch, number))

    def on_end(self, end: PieceOutcome) -> float:
        piece: ChunksDone = end.result
        self.done += piece.episodes
        self._meter.add(piece.work, piece.worker)
        self._progress(self.done, self._batch.layout.episodes)
        return piece.wall_s

    def _worked_s(self) -> float:
        return self._before_s + time.monotonic() - self._start_s


def chunks_name(parameters: Mapping[str, Any]) -> str:
    """Returns what Prefect's pages call the task run of some chunks, such as ``chunks 3-5``."""
    first, last = parameters["numbers"][0] + 1, parameters["numbers"][-1] + 1
    return f"chunk {first}" if first == last else f"chunks {first}-{last}"


@task(
    name="simulate-chunks",
    task_run_name=named_by(chunks_name),
    cache_policy=NO_CACHE,
    persist_result=False,
    **STORE_RETRY,
)
def simulate_chunks(
    store_url: str,
    batch: str,
    numbers: Numbers,
    *,
    location: OutputLocation,
    left_s: float,
    spent_s: float,
    voucher: Voucher,
) -> ChunksDone:
    """Returns what was done of some chunks, one after the other; runs on a worker, which may be another machine.

    Args:
        store_url: Where the batch's record, worlds, bundles and chunks are.
        batch: The batch's id.
        numbers: The chunks'.
        location: The batch's output location.
        left_s: Wall seconds that the batch has left.
        spent_s: Wall seconds that were spent on the batch before.
        voucher: Vouches for the results, under a key of the batch that the store does not have.
    """
    with announce_changes():  # a worker may be the first to see that time is up
        return _simulate_numbers(
            load_batch(open_store(store_url), batch, voucher), numbers, location, left_s=left_s, spent_s=spent_s
        )


def _simulate_numbers(
    work: OpenBatch, numbers: Numbers, location: OutputLocation, *, left_s: float, spent_s: float
) -> ChunksDone:
    store_url, batch = work.store.url, work.id
    start_s, episodes, done = time.monotonic(), 0, ChunkWork()
    note_machine(work)
    lanes = work.plan.lanes
    try:
        for place, number in enumerate(numbers):
            if work.record().status not in GOING:
                break
            took_s = time.monotonic() - start_s
            ended = simulate_chunk(
                store_url,
                batch,
                number,
                location=location,
                lanes=lanes,
                left_s=left_s - took_s,
                spent_s=spent_s + took_s,
                ahead=chunks_ahead(numbers[place + 1 :]),
                voucher=work.voucher,
            )
            lanes, episodes, done = ended.lanes, episodes + ended.episodes, done.plus(ended.work)
    finally:
        forget_chunks(work)
    return ChunksDone(episodes, time.monotonic() - start_s, done, f"{platform.node()} {os.getpid()}")


def _is_vouched(batch: OpenBatch, number: int) -> bool:
    found = stored_chunk(batch.store, batch.id, number, batch.voucher)
    return found is not None and found.vouched
