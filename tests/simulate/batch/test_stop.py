"""A chunk stops when its batch is cancelled or its time is over, and asks the store no more than once a second."""

import pytest

from tasks.simulate.batch.batch_jobs import cancel_batch, cancel_job
from tasks.simulate.batch.batch_record import OpenBatch, StopWatch
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord
from tests.factories.planned_batches import begun


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
