"""The server of a run: checked before the run begins, and reached past proxies."""

import os
from pathlib import Path

import pytest

from flows.cli import run_command
from flows.cli.run_command import prefect_server
from specs.errors import StageFailed
from tasks.server.health import succeeds_within
from tests.factories.answering_server import NOBODY, answering


@pytest.fixture(autouse=True)
def _impatient(monkeypatch: pytest.MonkeyPatch) -> None:  # pyright: ignore[reportUnusedFunction] - used by every test
    monkeypatch.setattr(run_command, "succeeds_within", lambda question: succeeds_within(question, for_s=0.0))


def test_a_server_that_does_not_answer_is_told_before_anything_runs(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("PREFECT_API_URL", NOBODY)
    with pytest.raises(StageFailed, match=f"no Prefect server answers at PREFECT_API_URL={NOBODY}; unset it"):
        prefect_server().__enter__()


def test_a_local_server_is_reached_past_the_proxy(monkeypatch: pytest.MonkeyPatch):
    for name in ("no_proxy", "NO_PROXY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("http_proxy", NOBODY)
    with answering() as api_url:
        monkeypatch.setenv("PREFECT_API_URL", api_url)
        with prefect_server() as used:
            assert used.api_url == api_url
            assert os.environ["no_proxy"] == os.environ["NO_PROXY"] == "127.0.0.1,localhost"
    assert "no_proxy" not in os.environ


def test_a_chosen_server_wins_over_the_kept_one(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path))
    monkeypatch.setattr(run_command, "kept_server", pytest.fail)
    with answering() as api_url:
        monkeypatch.setenv("PREFECT_API_URL", api_url)
        with prefect_server() as used:
            assert used.api_url == api_url


def test_the_client_asks_for_longer_than_a_server_is_waited_for(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("PREFECT_CLIENT_MAX_RETRIES", raising=False)
    with answering() as api_url:
        monkeypatch.setenv("PREFECT_API_URL", api_url)
        with prefect_server() as used:
            shortest_s = sum(0.8 * 2**pause for pause in range(1, int(os.environ["PREFECT_CLIENT_MAX_RETRIES"]) + 1))
            assert shortest_s >= used.wait_s == 90
        monkeypatch.setenv("PREFECT_CLIENT_MAX_RETRIES", "1")
        with prefect_server():
            assert os.environ["PREFECT_CLIENT_MAX_RETRIES"] == "1"
