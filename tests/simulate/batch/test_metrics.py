"""A batch's speed: what its chunks took, added up, and told; never part of a result."""

from specs.data.episode import EpisodeResult
from tasks.simulate.batch.batch_record import close_batch, complete
from tasks.simulate.batch.chunk_run import ChunkPart, run_chunk
from tasks.simulate.batch.chunk_store import committed_chunk
from tasks.simulate.batch.metrics import METRICS, BatchMeter, ChunkWork, metric_lines, metric_rows, metrics_of, work_of
from tasks.simulate.chunk.byproducts import ChunkTiming, collect_timings, note_timing
from tasks.storage.base.store import Store
from tests.factories.planned_batches import all_pass, begun

TIMING = ChunkTiming(lanes=16, ready_s=2.0, compile_s=5.0, slices=4, slices_s=4.0, peak_bytes=1)


def timed(part: ChunkPart) -> list[EpisodeResult]:
    note_timing(TIMING)
    return all_pass(part)


def test_compiling_is_told_apart_from_driving():
    work = work_of([TIMING, TIMING], simulated_s=60.0, wall_s=12.0)
    assert (work.ready_s, work.compile_s, work.drive_s) == (4.0, 10.0, 8.0)
    assert (work.chunks, work.lanes, work.wall_s) == (1, 16, 12.0)


def test_figures_are_of_all_workers_and_of_a_lane():
    metrics = metrics_of(ChunkWork(2, 24.0, 4.0, 8.0, 10.0, 640.0, 16), 20.0, 2)
    assert metrics.real_time_factor == 32.0
    assert metrics.real_time_factor_of_a_lane == 1.0
    assert (metrics.control_steps_per_s, metrics.physics_steps_per_s) == (640.0, 6400.0)
    assert (metrics.ready_s, metrics.compile_s, metrics.drive_s, metrics.store_s) == (4.0, 8.0, 10.0, 2.0)


def test_workers_are_counted_once_and_only_those_that_simulated():
    meter = BatchMeter()
    assert meter.metrics() is None
    for work, worker in (
        (ChunkWork(chunks=1), "a"),
        (ChunkWork(chunks=2), "b"),
        (ChunkWork(), "c"),
        (ChunkWork(3), "a"),
    ):
        meter.add(work, worker)
    metrics = meter.metrics()
    assert metrics is not None
    assert (metrics.workers, metrics.chunks) == (2, 6)


def test_every_share_of_the_time_is_told():
    rows = {
        row["figure"]: row["value"]
        for row in metric_rows(metrics_of(ChunkWork(1, 20.0, 2.0, 4.0, 10.0, 5.0, 8), 20.0, 1))
    }
    assert rows["compiling"] == "4.0 s, 20%"
    assert rows["simulating"] == "10.0 s, 50%"
    assert rows["reading and writing"] == "4.0 s, 20%"


def test_a_timing_is_collected_inside_the_block_only():
    with collect_timings() as inside:
        note_timing(TIMING)
        with collect_timings() as within:
            note_timing(TIMING)
    note_timing(TIMING)
    assert (inside, within) == ([TIMING, TIMING], [TIMING])


def test_a_chunk_tells_what_it_took_and_one_that_was_committed_nothing(file_store: Store):
    batch = begun(file_store)
    work = run_chunk(batch, 0, timed, lanes=4, left_s=3600.0).work
    rows = committed_chunk(file_store, batch.id, 0) or ()
    assert (work.chunks, work.ready_s, work.compile_s) == (1, 2.0, 5.0)
    assert work.simulated_s == sum(row.simulated_s for row in rows) > 0.0
    assert run_chunk(batch, 0, timed, lanes=4, left_s=3600.0).work == ChunkWork()


def test_describe_tells_the_figures_of_a_batch(file_store: Store):
    batch = begun(file_store)
    record = complete(batch)
    assert list(metric_lines(file_store, record.arn)) == []
    metrics = metrics_of(ChunkWork(2, 24.0, 4.0, 8.0, 10.0, 640.0, 16), 20.0, 2)
    close_batch(file_store, batch.id, "Completed", {METRICS: metrics.model_dump(mode="json")})
    told = list(metric_lines(file_store, record.arn))
    assert [line.split()[0] for line in told][:3] == ["workers", "lanes", "chunks"]
    assert list(metric_lines(file_store, "arn:simyard:world:0:g/w")) == []
