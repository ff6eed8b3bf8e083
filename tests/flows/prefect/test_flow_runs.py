"""What Prefect cancels is cancelled in the store, and what was cancelled there is called so in Prefect."""

from itertools import count
from pathlib import Path
from typing import Any, cast
from uuid import UUID, uuid4

import pytest
from prefect import Flow
from prefect.client.orchestration import SyncPrefectClient
from prefect.client.schemas.objects import FlowRun
from prefect.states import Cancelling, Running
from pydantic import JsonValue

from flows.pipeline import run_turns
from flows.prefect import flow_runs
from flows.prefect.flow_runs import cancel_with_flow_run, canceled_state, watch_cancellation
from specs.errors import StageFailed
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance, read
from tasks.storage.jobs.runs import KIND, begin_run
from tests.servers.eventually import eventually

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


FLOW = Flow(lambda: None, name="watched")


def refuse(**_arguments: object) -> None:
    raise ConnectionError("no WebSocket here")


@pytest.mark.integration
def test_an_event_tells_where_nobody_asks(client: SyncPrefectClient, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flow_runs, "is_cancelling", lambda _flow_run: False)
    flow_run = client.create_flow_run(FLOW, state=Running()).id
    other = client.create_flow_run(FLOW, state=Running()).id
    with watch_cancellation(str(flow_run)) as is_canceled, watch_cancellation(str(other)) as other_is_canceled:

        def told_after_a_cancellation() -> bool:
            # An event from before the process listens is lost, which is what the questions are for.
            client.set_flow_run_state(flow_run, Running(), force=True)
            client.set_flow_run_state(flow_run, Cancelling(), force=True)
            return is_canceled()

        assert eventually(told_after_a_cancellation)
        assert not other_is_canceled()


@pytest.mark.integration
def test_a_question_tells_where_events_are_refused(
    client: SyncPrefectClient, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO")
    monkeypatch.setattr(flow_runs, "get_events_subscriber", refuse)
    flow_run: UUID = client.create_flow_run(FLOW, state=Running()).id
    with watch_cancellation(str(flow_run), count(0, 10).__next__) as is_canceled:
        assert not is_canceled()
        client.set_flow_run_state(flow_run, Cancelling())
        assert is_canceled()
        assert eventually(lambda: "no WebSocket here" in caplog.text)


def test_prefect_is_asked_once_in_ten_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    questions: list[str] = []
    monkeypatch.setattr(flow_runs, "is_cancelling", lambda flow_run: bool(questions.append(flow_run)))
    monkeypatch.setattr(flow_runs, "get_events_subscriber", refuse)
    with watch_cancellation(str(uuid4()), count().__next__) as is_canceled:  # a second passes at each look
        assert not any(is_canceled() for _ in range(60))
    assert 5 <= len(questions) <= 6


def test_a_process_without_a_flow_run_asks_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flow_runs, "is_cancelling", lambda flow_run: pytest.fail(f"asked of {flow_run!r}"))
    with watch_cancellation("") as is_canceled:
        assert not is_canceled()
