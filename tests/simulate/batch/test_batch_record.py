"""A batch goes through RoboMaker's states, and what it holds does not grow with its jobs.

See docs/reference/robomaker.md, section 4.
"""

from collections.abc import Callable

import pytest

from specs.data.episode import EpisodeResult
from specs.errors import IdempotentParameterMismatch
from tasks.simulate.batch.batch_jobs import cancel_batch, cancel_job, restart_job
from tasks.simulate.batch.batch_record import (
    OpenBatch,
    StopWatch,
    close_batch,
    complete,
    open_batch,
    terminal_state,
    time_out,
)
from tasks.simulate.batch.chunk_run import ChunkPart, WriteRecordings, run_chunk
from tasks.simulate.batch.chunk_store import committed_chunk
from tasks.simulate.plan.batch_plan import JobTemplate
from tasks.storage.base.store import Store, encode_document
from tasks.storage.jobs.records import JobRecord
from tests.factories.planned_batches import begun, plan, put_world, request, template
from tests.factories.simulations import ENDLESS, FOLDERS, PUSHER, simulate_lanes
from tests.simulate.conftest import PUSHER_LANES


def test_a_batch_is_opened_once_and_found_again(file_store: Store):
    first, again = begun(file_store), begun(file_store)
    assert (first.id, first.record().status) == (again.id, "InProgress")
    with pytest.raises(IdempotentParameterMismatch):
        begun(file_store, plan(file_store, seeds=(5,)))


@pytest.mark.parametrize(("stop", "status"), [("Canceling", "Canceled"), ("TimingOut", "TimedOut")])
def test_a_batch_that_is_being_stopped_does_not_go_on_by_being_opened_again(file_store: Store, stop: str, status: str):
    batch = begun(file_store)
    if stop == "Canceling":
        cancel_batch(file_store, batch.id)
    else:
        time_out(batch)
    assert open_batch(file_store, batch.plan, request(batch.plan), "tok").status == stop
    assert complete(batch).status == stop
    assert terminal_state(batch.record(), 0)[0] == status


def test_a_cancelled_batch_does_not_time_out_and_the_other_way_round(file_store: Store):
    cancelled, late = begun(file_store, name="a"), begun(file_store, name="b")
    cancel_batch(file_store, cancelled.id)
    time_out(late)
    assert time_out(cancelled).status == "Canceling"
    assert late.record().status == "TimingOut"


def test_jobs_that_failed_do_not_fail_the_batch_unless_it_was_our_fault(file_store: Store):
    batch = begun(file_store)
    record = complete(batch)
    assert terminal_state(record, 0) == ("Completed", "")
    assert terminal_state(record, 2)[0] == "Failed"
    failed = close_batch(file_store, batch.id, *("Failed", {}, "no memory"))
    assert (failed.status, failed.failure_code) == ("Failed", "InternalServiceError")


def test_a_cancelled_batch_is_canceled_and_a_late_one_failed_if_jobs_failed_by_our_fault(file_store: Store):
    cancelled, late = begun(file_store, name="a"), begun(file_store, name="b")
    assert terminal_state(cancel_batch(file_store, cancelled.id), 1)[0] == "Canceled"
    assert terminal_state(time_out(late), 1)[0] == "Failed"


def test_a_record_does_not_grow_with_worlds_times_requests_times_seeds(file_store: Store):
    worlds = tuple(f"g/w{number}" for number in range(100))
    few = plan(file_store, worlds=worlds, templates=(template(),) * 2, seeds=tuple(range(2)))
    many = plan(file_store, worlds=worlds, templates=(template(),) * 20, seeds=tuple(range(500)))
    sizes = [len(encode_document(begun(file_store, made, token).record())) for made, token in ((few, "a"), (many, "b"))]
    assert begun(file_store, many, "b").layout.episodes == 1_000_000
    assert sizes[1] - sizes[0] < 20_000


class Clock:
    now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Clock:
    return Clock()


def test_time_that_is_over_stops_it(file_store: Store, clock: Clock):
    watch = StopWatch(begun(file_store), [0, 1], 5.0, clock)
    assert not watch()
    clock.now_s += 5.0
    assert watch()
    assert watch.code == "BatchTimedOut"


def test_a_cancelled_batch_is_noticed_within_a_second(file_store: Store, clock: Clock):
    batch = begun(file_store)
    watch = StopWatch(batch, [0, 1], 50.0, clock)
    assert not watch()
    cancel_batch(file_store, batch.id)
    clock.now_s += 1.0
    assert watch()
    assert watch.code == "BatchCanceled"


def test_one_cancelled_job_does_not_stop_the_others_and_the_last_one_does(file_store: Store, clock: Clock):
    batch = begun(file_store)
    watch = StopWatch(batch, [0, 1], 50.0, clock)
    cancel_job(file_store, f"{batch.id}/1")
    assert not watch()
    assert watch.canceled == {1}
    cancel_job(file_store, f"{batch.id}/0")
    clock.now_s += 1.0
    assert watch()
    assert watch.code == ""


def test_the_store_is_asked_once_a_second(file_store: Store, clock: Clock, monkeypatch: pytest.MonkeyPatch):
    batch, asked = begun(file_store), list[float]()
    read = OpenBatch.record

    def counted(self: OpenBatch) -> JobRecord:
        asked.append(clock.now_s)
        return read(self)

    monkeypatch.setattr(OpenBatch, "record", counted)
    watch = StopWatch(batch, [0], 50.0, clock)
    for _ in range(30):
        watch()
        clock.now_s += 0.1
    assert len(asked) == 3


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

    run_chunk(batch, 0, simulate, record, lanes=PUSHER_LANES, left_s=3600.0)
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
