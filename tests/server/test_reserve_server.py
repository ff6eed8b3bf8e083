"""A server in reserve: it imports before anybody knows whether it is needed, and does nothing else."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tasks.server import process
from tasks.server.process import Server
from tests.servers.eventually import eventually


class Launches:
    """Processes in place of servers: each ends when its input does, or has read a line."""

    def __init__(self, home: Path) -> None:
        self.home, self.begun = home, list[subprocess.Popen[bytes]]()
        self.reserved: list[bool] = []

    def __call__(self, home: Path, *, bound: bool, in_reserve: bool = False) -> tuple[Server, subprocess.Popen[bytes]]:
        assert bound
        given = subprocess.PIPE if in_reserve else subprocess.DEVNULL
        script = "read line && exec sleep 600" if in_reserve else "exec sleep 600"
        child = subprocess.Popen(["/bin/sh", "-c", script], stdin=given)
        log = home / f"server-{child.pid}.log"
        log.touch()
        self.begun.append(child)
        self.reserved.append(in_reserve)
        return Server("http://127.0.0.1:1/api", child.pid, str(log)), child


@pytest.fixture
def launches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Launches:
    found = Launches(tmp_path)
    monkeypatch.setattr(process, "launch", found)
    return found


def test_a_run_calls_up_the_server_in_reserve(launches: Launches):
    with process.reserve_server(launches.home), process.run_server(launches.home) as (server, child):
        assert (server.pid, launches.begun) == (child.pid, [child])
        assert eventually(lambda: b"sleep" in Path(f"/proc/{child.pid}/cmdline").read_bytes())
    assert launches.reserved == [True]
    assert child.poll() is not None


def test_a_server_that_nobody_calls_up_ends_with_the_block_and_leaves_no_log(launches: Launches):
    with process.reserve_server(launches.home):
        (child,) = launches.begun
        assert child.poll() is None
    assert child.poll() is not None
    assert list(launches.home.glob("*.log")) == []


def test_a_server_that_ended_in_reserve_is_followed_by_another(launches: Launches):
    with process.reserve_server(launches.home):
        launches.begun[0].kill()
        launches.begun[0].wait()
        with process.run_server(launches.home) as (_, child):
            assert child is launches.begun[1]
    assert launches.reserved == [True, False]


def test_a_server_in_reserve_whose_port_was_taken_is_followed_by_another(
    launches: Launches, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(process, "is_free", lambda _: False)
    with process.reserve_server(launches.home), process.run_server(launches.home) as (_, child):
        assert child is launches.begun[1]
        assert launches.begun[0].poll() is not None
    assert launches.reserved == [True, False]


def test_a_server_in_reserve_ends_where_the_database_cannot_be_closed(
    launches: Launches, monkeypatch: pytest.MonkeyPatch
):
    def fails(_: object) -> None:
        raise OSError("no rights")

    monkeypatch.setattr(process, "_close_database", fails)
    with (
        pytest.raises(OSError, match="no rights"),
        process.reserve_server(launches.home),
        process.run_server(launches.home),
    ):
        pass
    assert launches.begun[0].poll() is not None


def test_a_reserve_of_another_folder_is_left_alone(launches: Launches):
    with process.reserve_server(launches.home), process.run_server(launches.home / "other") as (_, child):
        assert child is launches.begun[1]


def test_a_run_whose_reserve_cannot_begin_runs_a_server_of_its_own(launches: Launches, monkeypatch: pytest.MonkeyPatch):
    def fails(*_: object, **__: object) -> None:
        raise OSError("no such program")

    monkeypatch.setattr(process, "launch", fails)
    with process.reserve_server(launches.home):
        monkeypatch.setattr(process, "launch", launches)
        with process.run_server(launches.home):
            assert launches.reserved == [False]


@pytest.mark.long
def test_a_server_in_reserve_whose_input_ends_has_touched_nothing(tmp_path: Path):
    command = [sys.executable, "-m", "tasks.server.guarded_server", "1", process.PRESTARTED]
    environment = {**os.environ, "PREFECT_HOME": str(tmp_path), "PREFECT_SERVER_ANALYTICS_ENABLED": "false"}
    ended = subprocess.run(command, stdin=subprocess.DEVNULL, env=environment, capture_output=True, check=False)
    assert (ended.returncode, ended.stderr) == (0, b"")
    assert list(tmp_path.glob("*.db*")) == []
