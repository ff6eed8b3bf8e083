"""Agents in reserve import what they need, do nothing until they are called up, and never outlive who began them."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from specs.errors import StageFailed
from tasks.deploy.kit.local_agents import agent_reserve, local_agents
from tasks.deploy.robot.agent import RESERVE
from tasks.storage.base.store import Store
from tests.deploy.yard import FLEET, STAYS_UP, Yard, command_line, kill
from tests.servers.eventually import eventually

pytestmark = pytest.mark.integration
NAMES = ("couriers-1", "couriers-2")
PARENT = """
import sys, time
from pathlib import Path
from tasks.deploy.kit.local_agents import agent_reserve
from tasks.storage.store_url import open_store
with agent_reserve(open_store(sys.argv[1]), ["couriers-1"], Path(sys.argv[2]), signed=False) as begin:
    begin()
    print("started", flush=True)
    time.sleep(1000)
"""


def test_a_demonstration_takes_the_agents_that_wait_for_it(file_store: Store, tmp_path: Path):
    with agent_reserve(file_store, NAMES, tmp_path, signed=True) as begin:
        begin()
        waiting = _begun(tmp_path)
        with local_agents(file_store, FLEET, 2, tmp_path, grace_s=0.2):
            assert _agents(tmp_path) == waiting
            eventually(lambda: all((tmp_path / name / "agent.lock").exists() for name in NAMES))

    assert len(waiting) == 2
    assert _agents(tmp_path) == []


def test_they_do_nothing_and_end_where_nothing_is_deployed(file_store: Store, tmp_path: Path):
    with agent_reserve(file_store, NAMES, tmp_path, signed=True) as begin:
        begin()
        for pid in _begun(tmp_path):
            eventually(lambda pid=pid: _waits_for_input(pid))

        assert sorted(path.name for path in tmp_path.rglob("*")) == ["agent.log", "agent.log", *NAMES]
        assert {path.read_text() for path in tmp_path.rglob("agent.log")} == {""}

    assert _agents(tmp_path) == []


def test_they_begin_once(file_store: Store, tmp_path: Path):
    with agent_reserve(file_store, NAMES, tmp_path, signed=False) as begin:
        assert _agents(tmp_path) == []
        begin()
        waiting = _begun(tmp_path)
        begin()
        assert _agents(tmp_path) == waiting


def test_they_end_with_a_run_that_breaks_off_before_its_deployment(file_store: Store, tmp_path: Path):
    def break_off() -> None:
        with agent_reserve(file_store, NAMES, tmp_path, signed=True) as begin:
            begin()
            _begun(tmp_path)
            raise StageFailed("GateFailed", "the gate cannot be asked")

    with pytest.raises(StageFailed, match="the gate"):
        break_off()
    assert _agents(tmp_path) == []


def test_of_two_runs_at_a_time_each_robot_has_one_agent_which_ends_with_the_run_that_began_it(
    file_store: Store, tmp_path: Path
):
    with agent_reserve(file_store, NAMES, tmp_path, signed=True) as begin_more:
        with agent_reserve(file_store, NAMES, tmp_path, signed=True) as begin:
            begin()
            waiting = _begun(tmp_path)
            begin_more()
            assert _agents(tmp_path) == waiting

        assert _agents(tmp_path) == []
        with local_agents(file_store, FLEET, 2, tmp_path, grace_s=0.2):
            eventually(lambda: len(_agents(tmp_path)) == 2)

    assert _agents(tmp_path) == []


def test_none_begins_after_its_run(file_store: Store, tmp_path: Path):
    with agent_reserve(file_store, NAMES, tmp_path, signed=True) as begin:
        pass
    begin()
    assert _agents(tmp_path) == []
    assert list(tmp_path.iterdir()) == []


def test_one_that_has_died_is_replaced(file_store: Store, tmp_path: Path):
    with agent_reserve(file_store, NAMES, tmp_path, signed=False) as begin:
        begin()
        waiting = _begun(tmp_path)
        os.kill(waiting[0], signal.SIGKILL)
        # It loses its memory, and so its command line, before it closes its input: until then it takes what it is told.
        os.waitid(os.P_PID, waiting[0], os.WEXITED | os.WNOWAIT)
        with local_agents(file_store, FLEET, 2, tmp_path, grace_s=0.2):
            eventually(lambda: len(_agents(tmp_path)) == 2)
            assert waiting[1] in _agents(tmp_path)


def test_they_end_when_the_process_that_began_them_is_killed(file_store: Store, tmp_path: Path):
    argv = [sys.executable, "-c", PARENT, file_store.url, str(tmp_path)]
    with subprocess.Popen(argv, stdout=subprocess.PIPE) as parent:
        assert parent.stdout
        assert parent.stdout.readline() == b"started\n"
        eventually(lambda: len(_agents(tmp_path)) == 1)
        kill(parent)

    eventually(lambda: _agents(tmp_path) == [])


def test_a_version_is_deployed_by_agents_from_the_reserve(yard: Yard):
    version = yard.publish({"run.sh": STAYS_UP})
    with agent_reserve(yard.store, NAMES, yard.folder / "robots", signed=False) as begin:
        begin()
        waiting = _begun(yard.folder)
        record = yard.deploy(version, "one", agents=2)

    assert (len(waiting), record.status) == (2, "Succeeded")
    assert _agents(yard.folder) == []


@pytest.mark.long
def test_an_agent_in_reserve_that_nobody_calls_up_ends_well(file_store: Store, tmp_path: Path):
    argv = ["-m", "tasks.deploy.robot.agent", RESERVE, f"--root={tmp_path}", f"--store={file_store.url}"]

    ended = subprocess.run([sys.executable, *argv], input=b"", capture_output=True, check=False)

    assert (ended.returncode, ended.stdout, ended.stderr) == (0, b"", b"")


def _begun(folder: Path) -> list[int]:
    """Returns the agents in reserve; at the beginning of a process the kernel shows no command line."""
    eventually(lambda: len(_agents(folder)) == len(NAMES))
    return _agents(folder)


def _agents(folder: Path) -> list[int]:
    lines = {int(process.name): command_line(process) for process in Path("/proc").glob("[0-9]*")}
    found = [pid for pid, line in lines.items() if "tasks.deploy.robot.agent" in line and f"--root={folder}" in line]
    return sorted(found)


def _waits_for_input(pid: int) -> bool:
    """Returns whether a process sleeps in a read of its input, for which it has imported all."""
    return Path(f"/proc/{pid}/wchan").read_text() in {"pipe_read", "pipe_wait", "anon_pipe_read"}
