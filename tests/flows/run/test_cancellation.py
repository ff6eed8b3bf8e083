"""What Prefect cancels is cancelled in the store, and what was cancelled there is called so in Prefect."""

from pathlib import Path
from typing import Any, cast
from uuid import uuid4

import pytest
from prefect.client.schemas.objects import FlowRun
from prefect.states import Cancelling
from pydantic import JsonValue

from flows.pipeline import run_turns
from flows.prefect.flow_runs import cancel_with_flow_run, canceled_state
from specs.errors import StageFailed
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance, read
from tasks.storage.jobs.runs import KIND, begin_run

IDENTITY: dict[str, JsonValue] = {"flow": "world-export", "spec": {}}


def status(store: Store, run: JobRecord) -> str:
    return read(store, KIND, run.id).status


def test_a_flow_run_whose_process_was_killed_is_cancelled_by_its_worker(file_store: Store) -> None:
    own = uuid4()
    with begin_run(file_store, IDENTITY) as run:
        advance(file_store, KIND, run.id, "Running", detail={run_turns.FLOW_RUN: str(own)})
    with begin_run(file_store, {"flow": "world-export", "spec": {"other": 1}}) as other:
        advance(file_store, KIND, other.id, "Running", detail={run_turns.FLOW_RUN: str(uuid4())})
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
