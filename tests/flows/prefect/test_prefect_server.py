"""A program that opens a server for itself leaves nothing unsent on it, however its block ends."""

import os
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from flows.prefect.prefect_server import prefect_server
from tests.factories.gateway.answering_server import answering
from tests.repository import ROOT

PROGRAM = """
import asyncio, sys
from flows.prefect.prefect_server import prefect_server

async def main():
    with prefect_server():
        from prefect import flow
        from prefect.events import emit_event

        @flow
        def speak():
            for number in range(50):
                emit_event(f"spoke.{number}", resource={"prefect.resource.id": "here"})

        await asyncio.to_thread(speak)
        if sys.argv[1] == "raises":
            raise ValueError("last words")

asyncio.run(main())
"""


@pytest.mark.integration
@pytest.mark.long
@pytest.mark.parametrize("end", ["raises", pytest.param("ends well", marks=pytest.mark.soak)])
def test_a_program_that_ends_its_server_has_sent_its_events_and_log_before(tmp_path: Path, end: str):
    told = {name: value for name, value in os.environ.items() if not name.startswith("PREFECT_")}
    ended = subprocess.run(
        [sys.executable, "-c", PROGRAM, end],
        env={**told, "PREFECT_HOME": str(tmp_path), "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ("ValueError: last words" in ended.stderr) == (end == "raises")
    assert "Error logging to API" not in ended.stderr
    assert "failed to process" not in ended.stderr
    with closing(sqlite3.connect(tmp_path / "prefect.db")) as database:
        logged = {text for (text,) in database.execute("SELECT message FROM log")}
        spoken = {name for (name,) in database.execute("SELECT event FROM events")}
    assert "Finished in state Completed()" in logged
    assert {f"spoke.{number}" for number in range(50)} <= spoken


def test_a_server_that_has_gone_away_is_sent_nothing(monkeypatch: pytest.MonkeyPatch):
    sent: list[str] = []
    monkeypatch.setattr("flows.prefect.prefect_server.flush_prefect", lambda: sent.append("all"))
    with answering() as api_url:
        monkeypatch.setenv("PREFECT_API_URL", api_url)
        with prefect_server():
            assert sent == []
        assert sent == ["all"]
        gone = prefect_server()
        gone.__enter__()
    gone.__exit__(None, None, None)
    assert sent == ["all"]


def test_a_server_that_is_too_busy_to_answer_at_first_is_used(monkeypatch: pytest.MonkeyPatch):
    """On 214f82e9 a run was refused where the server that the user chose had been silent for some seconds."""
    looks = iter([False, False, True])
    monkeypatch.setattr("flows.prefect.prefect_server.is_answering", lambda _: next(looks))
    monkeypatch.setattr(
        "flows.prefect.prefect_server.succeeds_within", lambda question, *for_s: _tries(question, for_s)
    )
    with answering() as api_url:
        monkeypatch.setenv("PREFECT_API_URL", api_url)
        with prefect_server() as chosen:
            assert chosen.api_url == api_url


def test_where_prefect_was_imported_before_no_second_server_starts(monkeypatch: pytest.MonkeyPatch):
    """On 214f82e9 each ``simyard.run`` of such a program began a server of Prefect's beside the one that it used."""
    from prefect.settings import PREFECT_API_URL, get_current_settings, temporary_settings  # noqa: PLC0415 - slow

    known: list[str | None] = []
    client = "prefect.client.orchestration.get_client"  # which starts one where it knows none
    monkeypatch.setattr(client, lambda **_: known.append(get_current_settings().api.url))  # pyright: ignore[reportUnknownLambdaType]
    with answering() as api_url, temporary_settings(restore_defaults={PREFECT_API_URL}):
        monkeypatch.setenv("PREFECT_API_URL", api_url)
        with prefect_server():
            assert known == [api_url]


def _tries(question: Callable[[], bool], for_s: tuple[float, ...]) -> bool:
    """Asks once, and often only where it is told for how long."""
    return any(question() for _ in range(10 if for_s else 1))
