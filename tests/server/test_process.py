"""Servers as child processes: prestarted, started one at a time, logged, ended."""

import os
import signal
import subprocess
import sys
import textwrap
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest

from tasks.server import process
from tasks.server.process import Server, end_turn_when, new_log, rename_log, take_turn
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


_NO_PROCESS = 1 << 30


def test_each_server_has_a_log_of_its_own(tmp_path: Path):
    for pid in (_NO_PROCESS, _NO_PROCESS + 1):
        with new_log(tmp_path) as output:
            output.write(b"of %d" % pid)
            assert rename_log(output, pid) == tmp_path / f"server-{pid}.log"
    assert (tmp_path / f"server-{_NO_PROCESS}.log").read_text() == f"of {_NO_PROCESS}"
    assert len([*tmp_path.iterdir()]) == 2


def test_only_the_newest_logs_of_ended_servers_stay(tmp_path: Path):
    for age in range(9):
        log = tmp_path / f"server-{_NO_PROCESS + age}.log"
        log.touch()
        os.utime(log, (1000.0 - age, 1000.0 - age))
    running = tmp_path / f"server-{os.getpid()}.log"
    running.touch()
    os.utime(running, (1.0, 1.0))
    with new_log(tmp_path) as output:
        rename_log(output, 1)
    left = {log.name for log in tmp_path.iterdir()}
    newest = {f"server-{_NO_PROCESS + age}.log" for age in range(5)}
    assert left == {*newest, running.name, "server-1.log"}


def test_the_environment_variable_wins_over_the_profile(tmp_path: Path):
    (tmp_path / "profiles.toml").write_text(
        'active = "work"\n[profiles.work]\nPREFECT_API_URL = "http://127.0.0.1:1/api"\n'
    )
    environment = {"PREFECT_HOME": str(tmp_path), "PREFECT_API_URL": "http://127.0.0.1:2/api"}
    assert process.configured(environment, "PREFECT_API_URL") == "http://127.0.0.1:2/api"


def test_the_active_profile_is_read_when_no_variable_is_set(tmp_path: Path):
    (tmp_path / "profiles.toml").write_text(
        'active = "work"\n[profiles.work]\nPREFECT_API_URL = "http://127.0.0.1:1/api"\n[profiles.other]\n'
    )
    assert process.configured({"PREFECT_HOME": str(tmp_path)}, "PREFECT_API_URL") == "http://127.0.0.1:1/api"
    assert process.configured({"PREFECT_HOME": str(tmp_path), "PREFECT_PROFILE": "other"}, "PREFECT_API_URL") == ""


def test_no_profile_means_no_server(tmp_path: Path):
    assert process.configured({"PREFECT_HOME": str(tmp_path)}, "PREFECT_API_URL") == ""


def test_a_folder_has_a_database_once_a_server_has_made_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(process.subprocess, "Popen", lambda *_, **__: SimpleNamespace(pid=os.getpid()))
    home = tmp_path / "prefect"
    assert not process.has_database(home)
    process.launch(home, bound=True)
    assert not process.has_database(home)
    (home / "prefect.db").write_bytes(b"SQLite format 3")
    assert process.has_database(home)


@pytest.mark.parametrize("bound", [True, False])
def test_only_a_server_that_stays_lists_the_types_of_blocks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, bound: bool
):
    environments: list[dict[str, str]] = []

    def started(command: list[str], *, env: dict[str, str], **_: object) -> SimpleNamespace:
        environments.append(env)
        return SimpleNamespace(pid=os.getpid())

    monkeypatch.setattr(process.subprocess, "Popen", started)
    process.launch(tmp_path / "prefect", bound=bound)
    listed = environments[0].get("PREFECT_SERVER_REGISTER_BLOCKS_ON_START")
    assert listed == ("false" if bound else None)


def test_a_bound_child_ends_when_its_parent_is_killed(tmp_path: Path):
    pid_file = tmp_path / "pid"
    parent = subprocess.Popen(
        [
            sys.executable,
            "-c",
            textwrap.dedent(f"""
                import os, pathlib, subprocess, sys, time
                child = subprocess.Popen([sys.executable, "-m", "tasks.server.bound_child", str(os.getpid()),
                                          "/bin/sleep", "600"])
                pathlib.Path({str(pid_file)!r}).write_text(str(child.pid))
                time.sleep(600)
            """),
        ]
    )
    child = int(eventually(lambda: pid_file.exists() and pid_file.read_text()))
    assert eventually(lambda: Path(f"/proc/{child}/cmdline").read_text().startswith("/bin/sleep"))
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    assert eventually(lambda: not _alive(child))


def _alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().split(")")[1].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):  # it is gone, or went while it was read
        return False


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
        assert eventually(lambda: Path(f"/proc/{child.pid}/cmdline").read_bytes().startswith(b"sleep"))
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
    monkeypatch.setattr(process, "is_port_free", lambda _: False)
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
