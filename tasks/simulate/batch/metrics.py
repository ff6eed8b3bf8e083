"""The speed of a batch, for people and for its record; no table, recording or audit has any of it.

A wall clock is never the same twice, so that these figures stand apart from everything whose bytes are.
"""

import time
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from specs.arn import resource_kind, resource_name
from specs.base import Spec
from specs.data.episode import CONTROL_HZ, PHYSICS_HZ
from specs.job_kinds import JobKind
from tasks.simulate.batch.provenance import recorded_gls
from tasks.simulate.chunk.byproducts import ChunkTiming
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, read

METRICS = "metrics"
_KIND: JobKind = "simulation-job-batch"


class ChunkWork(NamedTuple):
    """What a chunk, or several of them, took of the process that simulated it; nothing if others had done it before.

    Attributes:
        chunks: How many were simulated.
        wall_s: From their beginning to their being committed.
        ready_s: Of that, to load applications and worlds, and to place robots.
        compile_s: To compile programs, or to load what was compiled.
        drive_s: For control steps.
        simulated_s: Of all episodes.
        lanes: The most that ran at a time.
    """

    chunks: int = 0
    wall_s: float = 0.0
    ready_s: float = 0.0
    compile_s: float = 0.0
    drive_s: float = 0.0
    simulated_s: float = 0.0
    lanes: int = 0

    def plus(self, other: "ChunkWork") -> "ChunkWork":
        """Returns the sum of both."""
        return ChunkWork(
            chunks=self.chunks + other.chunks,
            wall_s=self.wall_s + other.wall_s,
            ready_s=self.ready_s + other.ready_s,
            compile_s=self.compile_s + other.compile_s,
            drive_s=self.drive_s + other.drive_s,
            simulated_s=self.simulated_s + other.simulated_s,
            lanes=max(self.lanes, other.lanes),
        )


class BatchMetrics(Spec):
    """How fast the process, or the workers, were that ended a batch.

    Attributes:
        workers: Processes that simulated.
        lanes: Episodes that ran at a time in one of them, at most.
        chunks: How many they simulated; fewer than the batch has if it was continued.
        wall_s: From the first chunk's beginning to the last one's end.
        simulated_s: Of those chunks' episodes.
        real_time_factor: Simulated seconds for each second of the wall clock.
        real_time_factor_of_a_lane: The same of one lane.
        control_steps_per_s: Of all lanes.
        physics_steps_per_s: Of all lanes.
        ready_s: Sum over the workers, to load applications and worlds, and to place robots.
        compile_s: Likewise, to compile programs, or to load what was compiled.
        drive_s: Likewise, for control steps.
        store_s: Likewise, for the rest: to read worlds, to write recordings and results.
    """

    workers: int
    lanes: int
    chunks: int
    wall_s: float
    simulated_s: float
    real_time_factor: float
    real_time_factor_of_a_lane: float
    control_steps_per_s: float
    physics_steps_per_s: float
    ready_s: float
    compile_s: float
    drive_s: float
    store_s: float


class BatchMeter:
    """Adds up what the chunks of a batch take."""

    def __init__(self) -> None:
        """Begins now."""
        self._start_s = time.monotonic()
        self._work = ChunkWork()
        self._workers: set[str] = set()

    def add(self, work: ChunkWork, worker: str) -> None:
        """Adds what a worker did; one that found everything done did nothing."""
        if work.chunks:
            self._work = self._work.plus(work)
            self._workers.add(worker)

    def metrics(self) -> BatchMetrics | None:
        """Returns the figures until now; None if nothing was simulated."""
        wall_s = time.monotonic() - self._start_s
        return metrics_of(self._work, wall_s, len(self._workers)) if self._work.chunks else None


def work_of(timings: Sequence[ChunkTiming], *, simulated_s: float, wall_s: float) -> ChunkWork:
    """Returns what a chunk took.

    Args:
        timings: Of its parts that came to their end.
        simulated_s: Of its episodes.
        wall_s: From its beginning to its being committed.
    """
    return ChunkWork(
        chunks=1,
        wall_s=wall_s,
        ready_s=sum(each.ready_s for each in timings),
        compile_s=sum(each.compile_s for each in timings),
        drive_s=sum(each.slices_s for each in timings),
        simulated_s=simulated_s,
        lanes=max((each.lanes for each in timings), default=0),
    )


def metrics_of(work: ChunkWork, wall_s: float, workers: int) -> BatchMetrics:
    """Returns a batch's figures.

    Args:
        work: Of all its chunks.
        wall_s: That passed over them.
        workers: How many simulated.
    """
    factor = work.simulated_s / max(wall_s, 1e-6)
    known_s = work.ready_s + work.compile_s + work.drive_s
    return BatchMetrics(
        workers=workers,
        lanes=work.lanes,
        chunks=work.chunks,
        wall_s=round(wall_s, 3),
        simulated_s=round(work.simulated_s, 3),
        real_time_factor=round(factor, 2),
        real_time_factor_of_a_lane=round(factor / max(1, work.lanes * workers), 3),
        control_steps_per_s=round(factor * CONTROL_HZ, 1),
        physics_steps_per_s=round(factor * PHYSICS_HZ, 1),
        ready_s=round(work.ready_s, 3),
        compile_s=round(work.compile_s, 3),
        drive_s=round(work.drive_s, 3),
        store_s=round(max(0.0, work.wall_s - known_s), 3),
    )


def metric_rows(metrics: BatchMetrics) -> list[Mapping[str, str]]:
    """Returns a line for each figure, for a person."""
    total_s = max(metrics.ready_s + metrics.compile_s + metrics.drive_s + metrics.store_s, 1e-9)
    shares = {
        "making episodes ready": metrics.ready_s,
        "compiling": metrics.compile_s,
        "simulating": metrics.drive_s,
        "reading and writing": metrics.store_s,
    }
    factor, of_a_lane = metrics.real_time_factor, metrics.real_time_factor_of_a_lane
    told = {
        "workers": f"{metrics.workers}",
        "lanes": f"{metrics.lanes}",
        "chunks": f"{metrics.chunks}",
        "simulated": f"{metrics.simulated_s:,.0f} s in {metrics.wall_s:,.1f} s",
        "real time": f"{factor:,.0f} x, {of_a_lane:,.1f} x a lane",
        "control steps": f"{metrics.control_steps_per_s:,.0f} a second",
        "physics steps": f"{metrics.physics_steps_per_s:,.0f} a second",
        **{what: f"{seconds:,.1f} s, {seconds / total_s:.0%}" for what, seconds in shares.items()},
    }
    return [{"figure": figure, "value": value} for figure, value in told.items()]


def recorded_metrics(record: JobRecord) -> BatchMetrics | None:
    """Returns the figures in a batch's record; None of one that has not ended, or had nothing left to simulate."""
    return BatchMetrics.model_validate(record.detail[METRICS]) if METRICS in record.detail else None


def metric_lines(store: Store, arn: str) -> Iterator[str]:
    """Yields a line for each figure of the batch that an ARN names; nothing for what is no batch."""
    if resource_kind(arn) == _KIND:
        record = read(store, _KIND, resource_name(arn))
        metrics = recorded_metrics(record)
        for row in metric_rows(metrics) if metrics else ():
            yield f"{row['figure']:<22} {row['value']}"
        for gl in recorded_gls(record):
            yield f"{'pictures drawn by':<22} {gl}"
