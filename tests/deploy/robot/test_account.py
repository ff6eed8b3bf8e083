"""The account of a robot's programs, and the rights of an agent that is not the store's owner."""

import ctypes
import os
import pwd
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from specs.errors import DocumentError
from tasks.deploy.fleet.fleet_registry import create_robot
from tasks.deploy.robot.account import Account, chosen_account, hide_memory, make_home, missing_rights, silence_note
from tasks.deploy.robot.processes import end_all
from tasks.deploy.rollout.controller import ask_robot
from tasks.storage.base.store import Store
from tasks.storage.store_url import open_store
from tests.deploy.one_robot import GOOD, desired, scripted
from tests.deploy.reach import open_folder
from tests.deploy.yard import Yard, kill, programs_of, wait_for_report
from tests.storage.two_accounts import as_two_accounts

# Other tests of this process may have imported JAX, which has threads; no agent has.
pytestmark = pytest.mark.filterwarnings("ignore:os.fork:RuntimeWarning")
_NOBODY = 65534
_STEAL = (
    "#!/bin/sh\nid -u\nhead -c 100 /proc/$PPID/environ && echo read-environment\n"
    "head -c 1 /proc/$PPID/mem 2>&1 | grep -q denied || echo read-memory\nexit 0\n"
)
as_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root gives programs another account")
AS_NOBODY = """
import os, sys
from tasks.deploy.robot.account import missing_rights
from tasks.storage.store_url import connect
store = connect(sys.argv[1])
os.setgroups([])
os.setgid(65534)
os.setuid(65534)
print(*missing_rights(store, "r1"), sep="\\n")
"""


@pytest.fixture
def open_yard(file_store: Store) -> Iterator[Yard]:
    with open_folder() as folder:
        yield Yard(file_store, folder)


@pytest.fixture
def agent(open_yard: Yard) -> Iterator[Callable[..., Yard]]:
    """Starts an agent with options."""
    started: list[subprocess.Popen[bytes]] = []
    yard = open_yard

    def start(*options: str) -> Yard:
        root = yard.root("r1")
        root.mkdir(parents=True, exist_ok=True)
        argv = [f"--root={root}", f"--store={yard.store.url}", "--unsigned", "--poll-s=0.05", "--grace-s=0.1", *options]
        with (root / "agent.log").open("ab") as log:
            argv = [sys.executable, "-m", "tasks.deploy.robot.agent", "--robot=r1", *argv]
            started.append(subprocess.Popen(argv, stdout=log, stderr=log))
        return yard

    yield start
    for each in started:
        kill(each)
    end_all(yard.root("r1"))


def _stolen(yard: Yard) -> str:
    """Returns what a script of a bundle has read of its agent, after the user's number."""
    version = yard.publish({**GOOD, "steal.sh": _STEAL})
    wanted = ask_robot(yard.store, desired(version, 1, launch=scripted(preLaunchFile="steal.sh"), timeout_s=60.0))
    wait_for_report(yard, "r1", lambda told: told.sequence == wanted.sequence and told.status == "InSync")
    return (yard.root("r1") / "logs" / f"{wanted.sequence:06d}-pre-launch.log").read_text()


@as_root
@pytest.mark.integration
def test_a_program_of_roots_agent_runs_as_nobody_and_reads_nothing_of_it(agent: Callable[..., Yard]) -> None:
    yard = agent("--user=nobody")

    seen = _stolen(yard)

    assert seen.splitlines()[0] == str(pwd.getpwnam("nobody").pw_uid)
    assert "read-" not in seen
    home = (yard.root("r1") / "home").stat()
    assert (home.st_uid, home.st_mode & 0o777) == (pwd.getpwnam("nobody").pw_uid, 0o700)
    assert programs_of(yard.root("r1")) == ["sleep 1000"]
    assert (yard.root("r1") / "home" / "launches").read_text() == "up\n"


@as_root
@pytest.mark.integration
def test_a_program_adds_files_where_it_works_and_changes_nothing_that_is_installed(agent: Callable[..., Yard]) -> None:
    yard = agent("--user=nobody")
    spoil = "#!/bin/sh\necho beat > heartbeat\necho x >> courier/run.sh\nmv courier other\nrm -r courier\nexit 0\n"
    version = yard.publish({**GOOD, "spoil.sh": spoil})
    ask_robot(yard.store, desired(version, 1, launch=scripted(preLaunchFile="spoil.sh"), timeout_s=60.0))
    wait_for_report(yard, "r1", lambda told: told.status == "InSync")

    installed = yard.root("r1") / "current"
    assert (installed / "heartbeat").read_text() == "beat\n"
    assert (installed / "courier" / "run.sh").read_text() == GOOD["run.sh"]


@as_root
@pytest.mark.integration
def test_a_program_that_runs_as_root_reads_its_agents_environment_and_the_log_warns_of_it(
    agent: Callable[..., Yard],
) -> None:
    yard = agent("--user=root")

    assert "read-environment" in _stolen(yard)
    assert "they can read its credentials" in (yard.root("r1") / "agent.log").read_text()


def _as_nobody(work: Callable[[], object]) -> int:
    """Returns the exit code of a process without rights that does the work, whose result it is."""
    child = os.fork()
    if child == 0:
        code = 99
        try:
            if os.geteuid() == 0:
                os.setgroups([])
                os.setgid(_NOBODY)
                os.setuid(_NOBODY)
            code = int(bool(work()))
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def _child_reads_environment(prepare: Callable[[], None]) -> bool:
    prepare()
    asked = subprocess.run(["/bin/sh", "-c", f"head -c 1 /proc/{os.getpid()}/environ >/dev/null 2>&1"], check=False)
    return asked.returncode == 0


def _dumpable() -> None:
    """Makes this process what it was before it gave up root's rights, which took that away."""
    ctypes.CDLL(None).prctl(4, 1, 0, 0, 0)


def test_an_agent_without_rights_hides_its_memory_from_others_of_its_account() -> None:
    assert _as_nobody(lambda: _child_reads_environment(_dumpable)) == 1, "else this test shows nothing"
    assert _as_nobody(lambda: _child_reads_environment(lambda: (_dumpable(), hide_memory())[1])) == 0


@as_root
def test_an_account_that_cannot_get_to_the_robots_folder_is_told_at_the_start() -> None:
    with tempfile.TemporaryDirectory() as folder:  # for root alone
        (Path(folder) / "robot").mkdir()
        account = chosen_account("nobody")
        assert account is not None

        with pytest.raises(DocumentError, match="a folder that the account 'nobody' can get to"):
            make_home(account, Path(folder) / "robot")


@as_root
def test_an_agent_of_root_has_an_account_for_its_programs_without_being_asked() -> None:
    account = chosen_account(None)

    assert account is not None
    assert account.uid != 0
    assert chosen_account("0") is None
    assert chosen_account("4294") == Account("4294", 4294, 4294, ())


@pytest.mark.parametrize("user", ["no such account", "", "-1"])
def test_an_account_that_is_none_is_refused(user: str) -> None:
    with pytest.raises(DocumentError, match="an account of this machine"):
        chosen_account(user)


@as_two_accounts
def test_an_agent_of_another_account_lacks_two_rights_and_its_owner_none():
    before = os.umask(0o022)
    try:
        with open_folder() as folder:
            store = open_store((folder / "store").as_uri())
            create_robot(store, "r1")
            store.put("robots/r1/desired.json", b"1")
            ended = subprocess.run(
                [sys.executable, "-c", AS_NOBODY, store.url], capture_output=True, text=True, check=True
            )
            told = [line.partition(", which")[0] for line in ended.stdout.splitlines()]
            places = [f"{folder}/store/robots/r1", f"{folder}/store/.locks"]
            assert told == [f"nobody may not write in {place}" for place in places]
            assert list(missing_rights(store, "r1")) == []
            note = silence_note(store, "r1")
            assert f"only root may write in {places[0]} and only root may write in {places[1]}" in note
    finally:
        os.umask(before)
