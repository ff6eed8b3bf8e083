"""A cancelled export job ends Canceled and leaves nothing in its bucket, whenever it was cancelled."""

from pathlib import Path

import pytest

from tasks.export.job.export_job import run_export_job
from tasks.storage.base.store import Store
from tasks.storage.buckets import open_bucket
from tests.export.export_jobs import TOKEN, CancelingBucket, break_bucket, cancel, request, run, store_of_worlds


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Store:
    monkeypatch.delenv("SIMYARD_BUCKETS", raising=False)
    return store_of_worlds(tmp_path / "store")


def test_a_job_that_is_being_canceled_ends_canceled_and_uploads_nothing(store: Store):
    cancel(store)
    assert run(store).status == "Canceled"
    assert open_bucket(store, "worlds").keys("") == []


def test_a_job_that_is_canceled_among_its_worlds_stops_there_and_uploads_nothing(store: Store):
    def cancel_after_one(done: int, _total: int) -> None:
        assert done == 1
        cancel(store)

    record = run_export_job(store, request(), formats=("mjcf", "svg"), token=TOKEN, progress=cancel_after_one)
    assert record.status == "Canceled"
    assert open_bucket(store, "worlds").keys("") == []


@pytest.mark.parametrize("status", ["Canceling", "Canceled"])  # the latter by another, who took this run for dead
@pytest.mark.parametrize("at", [1, 2, 3])  # two plans, the zip
def test_a_job_that_is_canceled_among_its_uploads_stops_there_and_leaves_nothing(
    store: Store, monkeypatch: pytest.MonkeyPatch, at: int, status: str
):
    bucket = CancelingBucket(store, at, status=status)
    monkeypatch.setattr("tasks.export.job.export_job.open_bucket", lambda _store, _name: bucket)
    assert run(store).status == "Canceled"
    assert bucket.writes == at
    assert open_bucket(store, "worlds").keys("") == []


def test_a_canceled_job_ends_canceled_where_nothing_may_be_removed_and_says_so(
    store: Store, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    bucket = CancelingBucket(store, 1, removes=False)
    monkeypatch.setattr("tasks.export.job.export_job.open_bucket", lambda _store, _name: bucket)
    assert run(store).status == "Canceled"
    assert "no removing" in caplog.text


def test_a_canceled_job_leaves_nothing_of_a_run_that_was_killed_either(store: Store, monkeypatch: pytest.MonkeyPatch):
    with monkeypatch.context() as broken:
        break_bucket(broken, KeyboardInterrupt(), writes=2)
        with pytest.raises(KeyboardInterrupt):
            run(store)
    assert len(open_bucket(store, "worlds").keys("")) == 2

    def cancel_after_one(_done: int, _total: int) -> None:
        cancel(store)

    record = run_export_job(store, request(), formats=("mjcf", "svg"), token=TOKEN, progress=cancel_after_one)
    assert record.status == "Canceled"
    assert open_bucket(store, "worlds").keys("") == []
