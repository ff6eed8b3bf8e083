"""Who sleeps and who does not, by processes of plain Python, and which threads keep roscpp's timers."""

import platform
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tasks.ros.process.thread_watch import Rest, ThreadWatch, allow_files, counts_runs, keeps_timers
from tests.ros.process.proc_folder import fake_thread
from tests.servers.open_files import open_files

pytestmark = pytest.mark.skipif(not counts_runs(), reason="this kernel does not count how often threads are run")
Start = Callable[[str], "subprocess.Popen[bytes]"]


@pytest.fixture
def start() -> Iterator[Start]:
    """Starts programs that write a byte when they are where the test wants them."""
    running: list[subprocess.Popen[bytes]] = []

    def begin(program: str) -> "subprocess.Popen[bytes]":
        command = [sys.executable, "-I", "-S", "-c", program]
        running.append(subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE))
        assert running[-1].stdout is not None
        assert running[-1].stdout.read(1) == b"."
        return running[-1]

    yield begin
    for each in running:
        each.kill()
        each.communicate()


def watch(process: "subprocess.Popen[bytes]") -> ThreadWatch:
    found = ThreadWatch()
    found.refresh([process.pid])
    return found


def until(watched: ThreadWatch, rest: Rest) -> None:
    """Looks until it finds that; the test's own limit of time ends it otherwise."""
    while watched.look() is not rest:
        time.sleep(0.001)


READS = "import os; os.write(1, b'.'); os.read(0, 1); os.write(1, b'!'); os.read(0, 1)"


def test_one_that_waits_for_input_sleeps_and_the_first_look_never_says_so(start: Start) -> None:
    watched = watch(start(READS))
    assert watched.look() in (Rest.MOVED, Rest.AWAKE)
    until(watched, Rest.ASLEEP)
    watched.close()


def test_one_that_computes_is_awake(start: Start) -> None:
    watched = watch(start("import os; os.write(1, b'.')\nwhile True: pass"))
    assert [watched.look() for _ in range(20)] == [Rest.AWAKE] * 20
    watched.close()


def test_a_thread_counts_like_a_process(start: Start) -> None:
    program = (
        "import os, _thread\ndef spin():\n while True: pass\n_thread.start_new_thread(spin, ())\nos.write(1, b'.')\n"
    )
    watched = watch(start(program + "os.read(0, 1)"))
    until(watched, Rest.AWAKE)
    watched.close()


def test_what_was_sent_is_noticed_by_the_thread_that_reads_it(start: Start) -> None:
    process = start(READS)
    watched = watch(process)
    until(watched, Rest.ASLEEP)
    watched.mark()
    assert not watched.moved()
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(b"x")
    process.stdin.flush()
    assert process.stdout.read(1) == b"!"
    until(watched, Rest.ASLEEP)
    assert watched.moved()
    assert not watched.moved({process.pid})
    watched.close()


def test_one_that_sleeps_by_the_walls_clock_naps(start: Start) -> None:
    process = start("import os, time; os.write(1, b'.'); time.sleep(600)")
    watched = watch(process)
    until(watched, Rest.ASLEEP)
    assert watched.napping() == {process.pid}
    assert watched.napping({process.pid}) == frozenset()
    while process.pid not in watched.sleepers():  # a kernel may tell only after a while where it sleeps
        time.sleep(0.001)
    watched.close()


@pytest.mark.parametrize(("limit_s", "naps"), [(600, True), (-1, False)])
def test_one_that_waits_on_a_condition_naps_where_its_wait_ends_by_itself(
    start: Start, limit_s: int, *, naps: bool
) -> None:
    waits = f"lock = _thread.allocate_lock(); lock.acquire(); lock.acquire(True, {limit_s})"
    process = start(f"import os, _thread; os.write(1, b'.'); {waits}")
    watched = watch(process)
    watched.limits = True
    until(watched, Rest.ASLEEP)
    # A kernel may tell only after a while where it sleeps, and until then it may nap.
    while watched.napping() != ({process.pid} if naps else frozenset()):
        time.sleep(0.001)
    while naps and process.pid not in watched.resting():  # likewise
        time.sleep(0.001)
    assert (process.pid in watched.resting()) is naps
    watched.limits = False
    assert process.pid not in watched.resting()
    watched.close()


def test_one_may_nap_as_long_as_the_kernel_does_not_tell_where_it_sleeps(tmp_path: Path) -> None:
    thread, watched = fake_thread(tmp_path, 1, 2), ThreadWatch(tmp_path)
    thread.waits_at = "0"
    watched.refresh([1])
    thread.run()
    watched.look()
    assert (watched.napping(), watched.sleepers()) == ({2}, frozenset())
    thread.waits_at = "futex_wait_queue"
    thread.be("S")
    assert watched.napping() == frozenset()
    watched.close()


def test_one_that_was_stopped_is_said_to_be(start: Start) -> None:
    process = start("import os, time; os.write(1, b'.'); time.sleep(600)")
    watched = watch(process)
    until(watched, Rest.ASLEEP)
    assert not watched.stopped()
    process.send_signal(signal.SIGSTOP)
    until(watched, Rest.STOPPED)
    assert watched.stopped()
    watched.close()


def test_one_that_ends_is_forgotten_with_its_files(start: Start) -> None:
    process = start("import os; os.write(1, b'.'); os.read(0, 1)")
    watched = watch(process)
    of_process = f"/proc/{process.pid}/"
    assert any(each.startswith(of_process) for each in open_files())
    process.communicate(b"x")
    until(watched, Rest.ASLEEP)
    assert watched.counted() == {}
    assert not any(each.startswith(of_process) for each in open_files())
    watched.close()


def test_a_thread_that_cannot_be_watched_for_want_of_files_is_no_sleeper(start: Start) -> None:
    process, (soft, hard) = start(READS), resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (0, hard))
    try:
        with pytest.raises(OSError, match="Too many open files"):
            watch(process)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def test_this_process_may_open_as_many_files_as_any() -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(1024, hard), hard))
    try:
        allow_files()
        assert resource.getrlimit(resource.RLIMIT_NOFILE) == (hard, hard)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def test_a_thread_that_was_woken_and_not_run_waits_for_a_core(tmp_path: Path) -> None:
    thread, watched = fake_thread(tmp_path, 1, 2), ThreadWatch(tmp_path)
    watched.refresh([1])
    assert not watched.waits_for_core(2)
    thread.be("R")
    assert watched.waits_for_core(2)
    assert not watched.waits_for_core(3)
    watched.close()


def test_who_ran_longest_counts_and_one_that_came_later_and_not_what_they_waited_for_a_core(tmp_path: Path) -> None:
    threads, watched = [fake_thread(tmp_path, 1, tid) for tid in (2, 3)], ThreadWatch(tmp_path)
    threads[0].run(ran_ns=7_000_000_000)
    watched.refresh([1])
    watched.snapshot()
    before = watched.runs
    assert watched.ran_s(before) == 0.0
    threads[0].run(ran_ns=1_000_000_000, waited_ns=9_000_000_000)
    threads[1].run(ran_ns=2_000_000_000)
    assert watched.ran_s(before) == 2.0
    fake_thread(tmp_path, 1, 4).run(ran_ns=3_000_000_000)
    watched.refresh([1])
    assert watched.ran_s(before) == 3.0
    watched.close()


FUTEX = {"x86_64": 202, "aarch64": 98}.get(platform.machine(), 0)
PAGE = 4096
# The library's page, one of its variables that begin as zero, one of nobody, one of the program's own.
PROGRAM = f"""
import ctypes, os, sys
c = ctypes.CDLL(None)
c.mmap.restype = ctypes.c_void_p
c.mmap.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int, ctypes.c_int, ctypes.c_int, ctypes.c_long]
c.mprotect.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int]
first = c.mmap(None, 5 * {PAGE}, 0, 0x22, -1, 0)
c.mmap(first, {PAGE}, 3, 0x12, os.open(sys.argv[1], os.O_RDONLY), 0)
c.mprotect(first + {PAGE}, {PAGE}, 3)
c.mprotect(first + 3 * {PAGE}, {PAGE}, 3)
os.write(1, b".")
c.syscall(ctypes.c_long({FUTEX}), ctypes.c_void_p(first + int(sys.argv[2]) * {PAGE} + 64), 128, 0, None)
"""


def asleep(pid: int) -> bool:
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "S"


@pytest.mark.skipif(not FUTEX, reason="the number of this machine's futex is not known here")
@pytest.mark.parametrize(
    ("library", "page", "expected"),
    [
        ("libroscpp.so.4d", 0, True),
        ("libroscpp.so.4d", 1, True),
        ("libroscpp.so.4d", 3, False),
        ("libother.so", 0, False),
        ("libother.so", 1, False),
    ],
)
def test_a_thread_keeps_timers_if_it_waits_at_a_variable_of_roscpps_library(
    tmp_path: Path, library: str, page: int, *, expected: bool
) -> None:
    file = tmp_path / library
    file.write_bytes(bytes(PAGE))
    command = [sys.executable, "-I", "-S", "-c", PROGRAM, str(file), str(page)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as waiting:
        assert waiting.stdout is not None
        assert waiting.stdout.read(1) == b"."
        while not asleep(waiting.pid):
            time.sleep(0.001)
        found = keeps_timers(waiting.pid, waiting.pid)
        waiting.kill()
    assert found is expected


def test_a_thread_that_is_gone_keeps_none() -> None:
    assert not keeps_timers(2**22 + 1, 2**22 + 1)
