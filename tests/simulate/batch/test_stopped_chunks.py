"""A chunk that is stopped while the engine runs it: what had ended keeps its row, bit for bit."""

from collections.abc import Callable, Iterable

import numpy as np
import pytest

from specs.data.episode import EpisodeResult
from tasks.simulate.batch.batch_jobs import cancel_batch, cancel_job, restart_job
from tasks.simulate.batch.batch_record import OpenBatch
from tasks.simulate.batch.chunk_run import ChunkPart, WriteRecordings, run_chunk
from tasks.simulate.batch.chunk_store import committed_chunk
from tasks.simulate.lane.recording import Columns
from tasks.simulate.plan.batch_plan import JobTemplate
from tasks.storage.base.store import Store
from tests.factories.planned_batches import begun, plan, put_world
from tests.factories.simulations import ENDLESS, FOLDERS, PUSHER, simulate_lanes
from tests.simulate.conftest import PUSHER_LANES

SHORT_S, ENDLESS_S = 1.0, 600.0
Act = Callable[[OpenBatch, ChunkPart], None]


def _entry(duration_s: float) -> JobTemplate:
    return JobTemplate(
        robot=PUSHER,
        scenario=ENDLESS,
        environment={"FAULT": "0"},
        duration_s=duration_s,
        failure_behavior="Fail",
        record=True,
    )


def _batch(store: Store, *durations_s: float, name: str = "tok") -> OpenBatch:
    digests = {"g/w0": put_world(store, "g/w0")}
    entries = tuple(map(_entry, durations_s))
    made = plan(store, templates=entries, worlds=("g/w0",), seeds=(3,), lanes=PUSHER_LANES, world_digests=digests)
    return begun(store, made, name)


def _nothing(batch: OpenBatch, part: ChunkPart) -> None:
    pass


def _rows(batch: OpenBatch, act: Act = _nothing, record: WriteRecordings | None = None) -> list[EpisodeResult]:
    """Returns the chunk's rows; something happens when the first lane has ended."""
    happened: list[None] = []

    def simulate(part: ChunkPart) -> list[EpisodeResult]:
        def progress(done: int) -> None:
            if done and not happened:
                happened.append(None)
                act(batch, part)
                part.watch._next_look_s = 0.0  # as if a second had passed

        return simulate_lanes(
            part.chunk,
            part.worlds,
            FOLDERS,
            lanes=part.lanes,
            should_stop=part.watch,
            progress=progress,
            recorder=part.recorder,
        )

    run_chunk(batch, 0, simulate, record, lanes=PUSHER_LANES, left_s=999.0)
    return committed_chunk(batch.store, batch.id, 0) or []


def _time_is_over(batch: OpenBatch, part: ChunkPart) -> None:
    part.watch._deadline_s = 0.0


def _cancel(batch: OpenBatch, part: ChunkPart) -> None:
    cancel_batch(batch.store, batch.id)


@pytest.mark.parametrize(
    ("act", "code", "status"),
    [(_time_is_over, "BatchTimedOut", "TimingOut"), (_cancel, "BatchCanceled", "Canceling")],
)
def test_a_batch_that_is_stopped_keeps_the_rows_of_the_lanes_that_had_ended(
    file_store: Store, act: Act, code: str, status: str
):
    (alone,) = _rows(_batch(file_store, SHORT_S, name="alone"))
    batch = _batch(file_store, SHORT_S, ENDLESS_S)
    ended, stopped = _rows(batch, act)
    assert ended == alone
    assert (stopped.status, stopped.failure_code, stopped.simulated_s) == ("Canceled", code, 0.0)
    assert batch.record().status == status


def test_a_cancelled_job_leaves_the_lanes_beside_it_as_they_were(file_store: Store):
    before = _rows(_batch(file_store, SHORT_S, 4 * SHORT_S, 5 * SHORT_S, name="before"))
    batch = _batch(file_store, SHORT_S, 4 * SHORT_S, 5 * SHORT_S)
    rows = _rows(batch, lambda batch, _: cancel_job(batch.store, f"{batch.id}/1"))
    assert rows[1].status == "Canceled"
    assert [rows[0], rows[2]] == [before[0], before[2]]


def test_a_restarted_job_ends_with_the_same_bits(file_store: Store):
    before = _rows(_batch(file_store, SHORT_S, 4 * SHORT_S, 5 * SHORT_S, name="before"))
    batch = _batch(file_store, SHORT_S, 4 * SHORT_S, 5 * SHORT_S)
    assert _rows(batch, lambda batch, _: restart_job(batch.store, f"{batch.id}/1")) == before


class Recorded:
    """Keeps what is recorded."""

    def __init__(self) -> None:
        self.columns: list[dict[str, list[object]]] = []

    def __call__(self, number: int, parts: Iterable[Columns]) -> str:
        self.columns = [{name: np.asarray(column).tolist() for name, column in part.items()} for part in parts]
        return f"{number}.parquet"


def test_a_restarted_job_is_recorded_once(file_store: Store):
    recorded, again = Recorded(), Recorded()
    before = _rows(_batch(file_store, SHORT_S, 4 * SHORT_S, name="before"), record=recorded)
    batch = _batch(file_store, SHORT_S, 4 * SHORT_S)
    assert _rows(batch, lambda batch, _: restart_job(batch.store, f"{batch.id}/1"), again) == before
    assert {row.recording for row in before} == {"0.parquet"}
    assert again.columns == recorded.columns
    assert recorded.columns
