"""One server at a time starts on a database."""

import subprocess
import sys
import threading
from pathlib import Path

import pytest

from tasks.server import process
from tasks.server.process import Server, end_turn_when, take_turn
from tests.factories.gateway.answering_server import NOBODY
from tests.servers.eventually import eventually

_TRY = """
import fcntl, sys
with open(sys.argv[1], "ab") as lock:
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        sys.exit(7)
"""


def test_a_turn_excludes_other_processes_until_it_is_closed(tmp_path: Path):
    with take_turn(tmp_path, timeout_s=0.0):
        assert _is_starting(tmp_path)
    assert not _is_starting(tmp_path)


def test_a_start_that_takes_too_long_blocks_nobody(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    with take_turn(tmp_path, timeout_s=0.0), take_turn(tmp_path, timeout_s=0.0):
        assert "starting beside it" in caplog.text


def test_a_turn_ends_with_the_start(tmp_path: Path):
    answers = iter([False, True])
    end_turn_when(take_turn(tmp_path, 0.0), lambda: next(answers), timeout_s=60.0)
    assert eventually(lambda: not _is_starting(tmp_path))


def test_a_turn_ends_with_its_time(tmp_path: Path):
    end_turn_when(take_turn(tmp_path, 0.0), lambda: False, timeout_s=0.0)
    assert eventually(lambda: not _is_starting(tmp_path))


def test_a_server_holds_its_turn_until_it_is_healthy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    healthy = threading.Event()
    monkeypatch.setattr(process, "is_healthy", lambda _: healthy.is_set())
    monkeypatch.setattr(process, "launch", _pretended)
    with process.run_server(tmp_path):
        assert _is_starting(tmp_path)
        healthy.set()
        assert eventually(lambda: not _is_starting(tmp_path))


def test_a_server_that_died_frees_its_turn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(process, "launch", _pretended)
    with process.run_server(tmp_path) as (_, child):
        assert _is_starting(tmp_path)
        child.kill()
        assert eventually(lambda: not _is_starting(tmp_path))


def test_a_launch_that_fails_frees_its_turn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def fails(home: Path, *, bound: bool) -> None:
        raise OSError("no such program")

    monkeypatch.setattr(process, "launch", fails)
    with pytest.raises(OSError, match="no such program"), process.run_server(tmp_path):
        pass
    assert not _is_starting(tmp_path)


def _pretended(home: Path, *, bound: bool) -> tuple[Server, subprocess.Popen[bytes]]:
    child = subprocess.Popen(["sleep", "600"])
    return Server(api_url=NOBODY, pid=child.pid, log=""), child


def _is_starting(home: Path) -> bool:
    """Returns whether another process would have to wait."""
    tried = subprocess.run([sys.executable, "-S", "-c", _TRY, str(home / "starting.lock")], check=False)
    assert tried.returncode in (0, 7)
    return tried.returncode == 7
