"""A process learns of its flow run's cancellation by an event at once, and without events by asking."""

import os
from collections.abc import Generator
from itertools import count
from uuid import UUID, uuid4

import pytest
from prefect import Flow
from prefect.client.orchestration import SyncPrefectClient, get_client
from prefect.settings import PREFECT_API_AUTH_STRING, PREFECT_API_URL, temporary_settings
from prefect.states import Cancelling, Running

from flows.prefect import flow_runs
from flows.prefect.flow_runs import watch_cancellation
from tests.servers.eventually import eventually

FLOW = Flow(lambda: None, name="watched")


@pytest.fixture
def client(prefect_server: str) -> Generator[SyncPrefectClient, None, None]:
    """Yields a client of the tests' server, which this process asks, too, from here on."""
    password = os.environ["PREFECT_API_AUTH_STRING"]
    with (
        temporary_settings({PREFECT_API_URL: prefect_server, PREFECT_API_AUTH_STRING: password}),
        get_client(sync_client=True) as client,
    ):
        yield client


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

        assert eventually(told_after_a_cancellation, timeout_s=60.0)
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
