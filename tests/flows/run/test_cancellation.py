"""A run that is worked on is cancelled by its record, or by Prefect; what only interrupts it leaves it open."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast
from uuid import uuid4

import pytest
from prefect.client.schemas.objects import FlowRun
from prefect.states import Cancelling
from pydantic import JsonValue

from flows.run import cancellation
from flows.run.cancellation import cancel_with_flow_run, cancelable_run, canceled_state
from specs.errors import StageFailed, StoreError
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance, read, submit
from tasks.storage.jobs.runs import KIND, begin_run, stage_token
from tests.servers.eventually import eventually

IDENTITY: dict[str, JsonValue] = {"flow": "world-export", "spec": {}}


@pytest.fixture(autouse=True)
def _soon(monkeypatch: pytest.MonkeyPatch) -> None:  # pyright: ignore[reportUnusedFunction] - used by every test
    monkeypatch.setattr(cancellation, "_LOOK_S", 0.01)


def status(store: Store, run: JobRecord) -> str:
    return read(store, KIND, run.id).status


def _work_until_canceled(store: Store, run: JobRecord, job: JobRecord) -> None:
    advance(store, KIND, run.id, "Canceling")
    eventually(lambda: read(store, job.kind, job.id).status == "Canceled")
    raise StageFailed("Canceled", "canceled on request", job.arn)


def test_the_job_under_way_is_cancelled_as_soon_as_its_run_is(file_store: Store) -> None:
    with begin_run(file_store, IDENTITY) as run:
        job = submit(file_store, "world-export-job", {}, stage_token(run, "world-export"))
        with pytest.raises(StageFailed, match="Canceled"), cancelable_run(file_store, run):
            _work_until_canceled(file_store, run, job)
        assert status(file_store, run) == "Canceled"


def test_a_run_that_was_cancelled_before_it_is_worked_on_begins_nothing(file_store: Store) -> None:
    with begin_run(file_store, IDENTITY) as run:
        advance(file_store, KIND, run.id, "Canceling")
        with pytest.raises(StageFailed, match="canceled on request"), cancelable_run(file_store, run):
            pytest.fail("it began")
        assert status(file_store, run) == "Canceled"


@pytest.mark.parametrize("exc", [KeyboardInterrupt, SystemExit, StoreError])
def test_what_only_interrupts_a_run_leaves_it_to_be_continued(file_store: Store, exc: type[BaseException]) -> None:
    with begin_run(file_store, IDENTITY) as run:
        with pytest.raises(exc), cancelable_run(file_store, run):
            raise exc
        assert status(file_store, run) == "Running"


def test_a_signal_that_prefect_sent_to_cancel_cancels_the_run(
    file_store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cancellation, "this_flow_run", SimpleNamespace(id="prefects"))
    monkeypatch.setattr(cancellation, "_is_cancelling", lambda own: own == "prefects")
    with begin_run(file_store, IDENTITY) as run:
        with pytest.raises(SystemExit), cancelable_run(file_store, run):
            raise SystemExit(143)
        assert status(file_store, run) == "Canceled"


def test_prefects_cancel_reaches_a_flow_run_that_no_worker_started(
    file_store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cancellation, "this_flow_run", SimpleNamespace(id="prefects"))
    monkeypatch.setattr(cancellation, "_is_cancelling", lambda own: own == "prefects")
    with begin_run(file_store, IDENTITY) as run, cancelable_run(file_store, run):
        assert eventually(lambda: status(file_store, run) == "Canceling")


def test_a_flow_run_whose_process_was_killed_is_cancelled_by_its_worker(file_store: Store) -> None:
    own = uuid4()
    with begin_run(file_store, IDENTITY) as run:
        advance(file_store, KIND, run.id, "Running", detail={cancellation.FLOW_RUN: str(own)})
    with begin_run(file_store, {"flow": "world-export", "spec": {"other": 1}}) as other:
        advance(file_store, KIND, other.id, "Running", detail={cancellation.FLOW_RUN: str(uuid4())})
    stopped = FlowRun(id=own, flow_id=uuid4(), parameters={"store": file_store.url})
    cancel_with_flow_run(cast("Any", None), stopped, Cancelling())
    assert (status(file_store, run), status(file_store, other)) == ("Canceled", "Running")


def test_a_worker_that_does_not_know_the_store_of_a_flow_run_says_so_and_makes_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("SIMYARD_STORE", raising=False)
    stopped = FlowRun(id=uuid4(), flow_id=uuid4(), parameters={})
    cancel_with_flow_run(cast("Any", None), stopped, Cancelling())
    assert "no SIMYARD_STORE" in caplog.text
    assert [*tmp_path.iterdir()] == []


def test_prefect_calls_only_that_cancelled_which_was() -> None:
    state = canceled_state(StageFailed("Canceled", "canceled on request", "arn:x"))
    assert (state.is_cancelled(), state.message) == (True, "canceled on request (arn:x)")
    with pytest.raises(StageFailed, match="because"):
        canceled_state(StageFailed("InternalServiceError", "because"))
