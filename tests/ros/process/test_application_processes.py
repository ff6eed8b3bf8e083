"""An application of plain programs: whose its processes are, started, watched, ended, with nothing left."""

import ctypes
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import pytest

from tasks.ros.launch.launch_plan import NodePlan
from tasks.ros.process.application_processes import (
    ApplicationProcesses,
    ProcessTracker,
    alive,
    end_applications,
    end_strays,
    marked,
    tied_to,
)
from tasks.ros.process.lane_limits import LaneLimits, ending

_PR_SET_CHILD_SUBREAPER, _PR_GET_CHILD_SUBREAPER = 36, 37


def adopts() -> bool:
    asked = ctypes.c_int()
    ctypes.CDLL(None).prctl(_PR_GET_CHILD_SUBREAPER, ctypes.byref(asked), 0, 0, 0)
    return bool(asked.value)


def test_orphans_are_adopted_until_the_last_lineage_is_closed():
    before = adopts()
    first, second = ProcessTracker(), ProcessTracker()
    assert adopts()
    first.close()
    first.close()
    assert adopts()
    second.close()
    assert adopts() == before


def test_a_process_of_an_episode_is_known_until_it_is_forgotten(tmp_path: Path):
    tracker = ProcessTracker()
    tracker.add(os.getpid(), tmp_path)
    assert tracker.processes(tmp_path) == [os.getpid()]
    tracker.forget([tmp_path])
    assert tracker.processes(tmp_path) == []
    tracker.close()


def test_strays_are_no_children_of_before_none_of_this_session_and_nobody_elses():
    def child(*, session: bool) -> "subprocess.Popen[bytes]":
        return subprocess.Popen(["sleep", "600"], start_new_session=session)

    before = child(session=True)
    tracker = ProcessTracker()
    own, stray = child(session=False), child(session=True)
    assert tracker.strays() == [stray.pid]
    other = ProcessTracker()
    assert tracker.strays() == other.strays() == []
    for each in (other, tracker):
        each.close()
    for each in (before, own, stray):
        each.kill()
        each.wait()


Start = Callable[..., ApplicationProcesses]
_MIB = 1 << 20


@pytest.fixture
def tracker() -> Iterator[ProcessTracker]:
    found = ProcessTracker()
    yield found
    found.close()


@pytest.fixture
def start(tmp_path: Path, tracker: ProcessTracker) -> Iterator[Start]:
    """Starts an application of one node: a program of Python's."""
    started: list[ApplicationProcesses] = []

    def begin(
        program: str, *, limits: LaneLimits | None = None, required: bool = False, respawn: bool = False
    ) -> ApplicationProcesses:
        home = tmp_path / f"lane-{len(started)}"
        (home / "log").mkdir(parents=True)
        application = ApplicationProcesses(home, tracker, limits or LaneLimits())
        command = (sys.executable, "-I", "-S", "-c", program)
        plan = NodePlan("/node", "x", "x", command, required=required, respawn=respawn)
        application.start([plan], {"PATH": os.environ["PATH"], "ROS_HOME": str(home)})
        started.append(application)
        return application

    yield begin
    end_applications(started, tracker)
    assert [each.home for each in started if each.home.exists()] == []
    assert marked([each.home for each in started]) == []


def failure(application: ApplicationProcesses) -> str:
    found = ""
    while application.names and not found:
        found = application.failure()
        time.sleep(0.002)
    return found


def wait_for(path: Path) -> None:
    while not path.exists():
        time.sleep(0.002)


def test_a_node_that_fails_is_named_with_its_status_and_last_words(start: Start) -> None:
    words = failure(start("print('no map'); raise SystemExit(7)"))
    assert words == "node /node ended with status 7: no map"


def test_a_node_that_has_done_its_work_is_no_failure(start: Start) -> None:
    application = start("pass")
    assert failure(application) == ""
    assert application.done == {"/node"}


@pytest.mark.parametrize(("what", "words"), [("required", "is required"), ("respawn", "would be respawned")])
def test_the_end_of_a_required_or_respawned_node_is_one(start: Start, what: str, words: str) -> None:
    assert words in failure(start("pass", **{what: True}))


def test_a_process_that_leaves_session_and_parent_is_ended_as_well(start: Start, tracker: ProcessTracker) -> None:
    escape = "import os, time\nif not os.fork():\n os.setsid()\n"
    escape += " if os.fork(): os._exit(0)\n open(os.environ['ROS_HOME'] + '/there', 'w').close()\n time.sleep(600)\n"
    application = start(escape + "time.sleep(600)")
    wait_for(application.home / "there")
    application.find()
    while len([pid for pid in application.processes() if alive(pid)]) != 2:  # the one between them is about to end
        time.sleep(0.002)


def test_a_process_that_sheds_its_mark_as_well_is_ended_with_the_last_episode(
    start: Start, tracker: ProcessTracker, tmp_path: Path
) -> None:
    there = tmp_path / "pid"
    sleeper = "import os, sys, time; open(sys.argv[1], 'w').write(str(os.getpid())); time.sleep(600)"
    escape = "import os, sys\nif not os.fork():\n os.setsid()\n if os.fork(): os._exit(0)\n"
    escape += f" os.execve(sys.executable, [sys.executable, '-I', '-S', '-c', {sleeper!r}, {str(there)!r}], {{}})\n"
    application = start(escape)
    while not (there.exists() and there.read_text()):
        time.sleep(0.002)
    end_applications([application], tracker)
    assert alive(int(there.read_text()))
    end_strays(tracker)
    assert not alive(int(there.read_text()))


def test_a_pipe_in_the_place_of_a_log_is_not_waited_for(start: Start) -> None:
    program = "import os\nlog = os.environ['ROS_HOME'] + '/log/node.out'\nos.remove(log)\nos.mkfifo(log)\nos._exit(7)"
    assert failure(start(program)) == "node /node ended with status 7"


def test_what_nodes_printed_last_is_known_when_they_are_gone_and_no_link_is_followed(
    start: Start, tracker: ProcessTracker, tmp_path: Path
) -> None:
    (tmp_path / "secret").write_text("of the machine")
    application, other = start("print('x' * 3000 + '\\nhello\\nworld'); raise SystemExit(7)"), start("pass")
    log = other.home / "log" / "node.out"
    for each in (application, other):
        failure(each)
    log.unlink()
    log.symlink_to(tmp_path / "secret")
    end_applications([application, other], tracker)
    said = application.printed().splitlines()
    assert said[1:] == ["node: hello", "node: world"]
    assert (len(said[0]), other.printed()) == (len("node: ") + 1987, "")


def test_memory_beyond_the_limit_is_told(start: Start) -> None:
    hog = "import os, time; held = bytearray(64 << 20); held[::4096] = b'1' * len(held[::4096])\n"
    hog += "open(os.environ['ROS_HOME'] + '/there', 'w').close(); time.sleep(600)"
    application = start(hog, limits=LaneLimits(memory_bytes=32 * _MIB))
    wait_for(application.home / "there")
    application.find()
    assert "MiB of memory: more than the 32 MiB" in application.excess()


def test_files_and_processes_beyond_the_limit_are_told(start: Start) -> None:
    application = start("import time; time.sleep(600)", limits=LaneLimits(written_bytes=_MIB, processes=0))
    application.find()
    assert "runs 1 processes" in application.excess()
    (application.home / "log/big").write_bytes(b"1" * 2 * _MIB)
    words = LaneLimits(written_bytes=_MIB).excess([], application.home)
    assert words == "wrote 2 MiB of files and logs: more than the 1 MiB"


def test_a_file_beyond_the_limit_ends_its_writer(start: Start) -> None:
    program = "import os, signal; signal.signal(signal.SIGXFSZ, signal.SIG_DFL)\n"
    program += "file = open(os.environ['ROS_HOME'] + '/big', 'wb')\nwhile True: file.write(b'1' * 65536)"
    assert "SIGXFSZ: it wrote a file of more bytes" in failure(start(program, limits=LaneLimits(written_bytes=_MIB)))


@pytest.mark.parametrize("is_there", [True, False])
def test_a_node_whose_parent_was_killed_before_it_could_be_tied_to_it_does_not_begin(*, is_there: bool) -> None:
    gone = subprocess.Popen(["true"])
    gone.wait()
    said = subprocess.run(
        [*tied_to(os.getpid() if is_there else gone.pid), "echo", "begun"], stdout=subprocess.PIPE, check=False
    )
    assert said.stdout == (b"begun\n" if is_there else b"")


@pytest.mark.parametrize(("status", "words"), [(0, "ended with status 0"), (-9, "was ended by SIGKILL")])
def test_an_end_has_words(status: int, words: str) -> None:
    assert ending(status) == words


def test_equal_nodes_of_two_episodes_are_told_apart(start: Start) -> None:
    both: Sequence[ApplicationProcesses] = [start("import time; time.sleep(600)") for _ in range(2)]
    for each in both:
        each.find()
    one, two = (each.processes() for each in both)
    assert len(one) == len(two) == 1
    assert one != two
