"""Prefect server processes: chosen, and bound to their parent."""

import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path
from types import SimpleNamespace

import pytest

from tasks.server import process
from tests.servers.eventually import eventually


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
    eventually(lambda: "sleep" in Path(f"/proc/{child}/cmdline").read_text())
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    assert eventually(lambda: not _alive(child))


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return Path(f"/proc/{pid}/stat").read_text().split(")")[1].split()[0] != "Z"
