"""What a batch took is remembered in parts: what each run pays for, and what only a first one does."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from tasks.progress.log_lines import log_duration
from tasks.simulate.batch.metrics import METRICS, metrics_of, work_of
from tasks.simulate.chunk.byproducts import ChunkTiming
from tasks.simulate.forecast import batch_timing
from tasks.simulate.forecast.batch_timing import BatchTiming, BatchWatch, recall_batches
from tasks.storage.base.store import Store
from tests.factories.planned_batches import begun

DROVE = ChunkTiming(
    engine="mujoco",
    device="cpu",
    lanes=4,
    episodes=4,
    ready_s=1.0,
    compile_s=2.5,
    slices=3,
    slices_s=2.0,
    most_slices=3,
    peak_bytes=1,
)


@pytest.fixture(autouse=True)
def clock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """A cache of its own, and a clock that a test sets."""
    now_s = [100.0]
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(batch_timing, "time", SimpleNamespace(monotonic=lambda: now_s[0]))
    return now_s


def kept(store: Store, clock: list[float], *audited: ChunkTiming) -> BatchTiming:
    """Returns what is remembered of a batch that drove for 10 s, and was audited for 4 s."""
    batch = begun(store)
    watch = BatchWatch()
    clock[0] += 10.0
    watch.drove()
    clock[0] += 4.0
    metrics = metrics_of(
        work_of([DROVE] * 3, simulated_s=1.0, wall_s=10.0)._replace(chunks=batch.layout.chunks), 10.0, 1
    )
    detail = {**batch.record().detail, METRICS: metrics.model_dump(mode="json")}
    watch.keep(batch, batch.record().model_copy(update={"status": "Completed", "detail": detail}), audited)
    return recall_batches(batch.plan)[-1]


def test_the_worlds_of_a_batch_are_those_made_since_the_batch_before(file_store: Store, clock: list[float]):
    BatchWatch()
    with log_duration("generate_worlds"):
        pass
    first, second = kept(file_store, clock), kept(file_store, clock)
    assert first.worlds_s > 0.0 == second.worlds_s


def test_making_prefects_database_is_paid_once(file_store: Store, clock: list[float]):
    before_s = kept(file_store, clock).once_s
    with log_duration("make_server_database"):
        pass
    assert kept(file_store, clock).once_s > before_s


def test_what_an_audit_compiled_while_it_drove_is_no_part_of_what_its_driving_took(
    file_store: Store, clock: list[float]
):
    timing = kept(file_store, clock, DROVE, DROVE)
    assert (timing.chunks_s, timing.compile_s, timing.after_s) == (10.0, 7.5, 4.0)
    assert timing.after_s - timing.audit_compile_s == DROVE.ready_s + DROVE.slices_s
