"""Prefect server processes: chosen, started, bound to their parent, kept and ended."""

import os
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import pytest

from tasks.server import process

T = TypeVar("T")


def test_the_environment_variable_wins_over_the_profile(tmp_path: Path):
    (tmp_path / "profiles.toml").write_text(
        'active = "work"\n[profiles.work]\nPREFECT_API_URL = "http://127.0.0.1:1/api"\n'
    )
    environment = {"PREFECT_HOME": str(tmp_path), "PREFECT_API_URL": "http://127.0.0.1:2/api"}
    assert process.configured_api_url(environment) == "http://127.0.0.1:2/api"


def test_the_active_profile_is_read_when_no_variable_is_set(tmp_path: Path):
    (tmp_path / "profiles.toml").write_text(
        'active = "work"\n[profiles.work]\nPREFECT_API_URL = "http://127.0.0.1:1/api"\n[profiles.other]\n'
    )
    assert process.configured_api_url({"PREFECT_HOME": str(tmp_path)}) == "http://127.0.0.1:1/api"
    assert process.configured_api_url({"PREFECT_HOME": str(tmp_path), "PREFECT_PROFILE": "other"}) is None


def test_no_profile_means_no_server(tmp_path: Path):
    assert process.configured_api_url({"PREFECT_HOME": str(tmp_path)}) is None


def test_nothing_listening_is_not_healthy():
    assert not process.is_healthy("http://127.0.0.1:9/api")


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
    child = int(_eventually(lambda: pid_file.exists() and pid_file.read_text()))
    _eventually(lambda: "sleep" in Path(f"/proc/{child}/cmdline").read_text())
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    assert _eventually(lambda: not _alive(child))


@pytest.mark.integration
def test_a_kept_server_is_found_again_and_ended(tmp_path: Path):
    server = process.keep(tmp_path)
    try:
        assert process.keep(tmp_path) == server
    finally:
        ended = process.end_kept(tmp_path)
    assert ended == server
    assert process.kept_server(tmp_path) is None
    assert not process.is_healthy(server.api_url)


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return Path(f"/proc/{pid}/stat").read_text().split(")")[1].split()[0] != "Z"


def _eventually(holds: Callable[[], T], timeout_s: float = 20.0) -> T:
    deadline = time.monotonic() + timeout_s
    while not (value := holds()):
        assert time.monotonic() < deadline, "it never held"
        time.sleep(0.05)
    return value
