"""Heartbeats of flow runs: sent, and not waited for."""

from threading import Event, Thread
from types import SimpleNamespace

import pytest
from prefect import flow_engine
from prefect.logging import get_logger

from flows.prefect.flow_calls import leave_heartbeats


@pytest.fixture
def joined(monkeypatch: pytest.MonkeyPatch) -> list[Thread]:
    """Returns the threads that somebody has waited for since; restores what Prefect does at the end."""
    threads: list[Thread] = []
    monkeypatch.setattr(Thread, "join", lambda thread, **_: threads.append(thread))
    monkeypatch.setattr(flow_engine, "_send_heartbeats", flow_engine._send_heartbeats)
    return threads


def run_flow() -> None:
    """Runs the block in which an engine sends heartbeats, until the first was sent."""
    sent = Event()
    engine = SimpleNamespace(
        heartbeat_seconds=30,
        flow_run=None,
        logger=get_logger("test"),
        _build_heartbeat_event_template=lambda: ({}, []),
        _emit_flow_run_heartbeat=lambda *_: sent.set(),
    )
    with flow_engine._send_heartbeats(engine):  # pyright: ignore[reportArgumentType]
        assert sent.wait(30)


def test_a_flow_waits_for_its_heartbeats_as_prefect_has_it(joined: list[Thread]):
    run_flow()
    assert len(joined) == 1


def test_a_flow_does_not_wait_for_heartbeats_that_it_leaves(joined: list[Thread]):
    leave_heartbeats()
    leave_heartbeats()
    run_flow()
    assert joined == []
