"""Whether the threads of some processes are all asleep, by what the kernel tells of them (proc_pid_stat(5)).

A thread of roscpp, which has all timers of its process, waits for simulated time alone; it is known by its memory.

One look reads each thread's state, then how long and how often it was run so far. All are asleep at one and the same
moment if a look finds each asleep and run no more than at the look before: such a thread slept from its first reading
to its second, and these stretches overlap. A thread that is woken but waits for a core reads as running.

Since Linux 6.12 a thread that sleeps may stay in its core's queue for a while, and the kernel does not tell then where
it sleeps (``wchan`` reads 0). Such a thread is one that may nap, until the kernel tells.

A callback may also sleep on a condition until a time, as ``rclcpp::sleep_for`` and waits of Python's ``threading`` do.
What a thread is waiting with says whether there is a time: the fourth argument of futex(2).

roscpp's thread looks at the clock each millisecond, and sleeps in between on a condition that is a variable of roscpp's
library. So the address that it waits at, which the kernel tells (``/proc/*/task/*/syscall``), says which one it is.
"""

import contextlib
import os
import resource
import time
from collections.abc import Generator, Iterable, Mapping, Set
from enum import Enum
from pathlib import Path
from typing import NamedTuple, Self

from tasks.ros.process.lane_limits import NO_ROOM

_LIBRARY = "/libroscpp.so"
_FIELDS = 5
_TRIES = 20


class _Mapping(NamedTuple):
    first: int
    end: int
    written: bool
    path: str


def keeps_timers(pid: int, tid: int) -> bool:
    """Returns whether a thread is roscpp's for timers; False where the kernel does not tell."""
    with contextlib.suppress(OSError, ValueError):
        mappings = _mappings(Path(f"/proc/{pid}/maps").read_text())
        for _ in range(_TRIES):
            # "running", or a number, then what it was called with: to wait, first of all the address.
            words = Path(f"/proc/{pid}/task/{tid}/syscall").read_text().split()
            if len(words) > 1:
                return _variable_of_roscpp(int(words[1], 16), mappings)
    return False


def _mappings(text: str) -> list[_Mapping]:
    found: list[_Mapping] = []
    for line in text.splitlines():
        words = line.split(maxsplit=_FIELDS)
        first, end = (int(word, 16) for word in words[0].split("-"))
        found.append(_Mapping(first, end, "w" in words[1], words[_FIELDS] if len(words) > _FIELDS else ""))
    return found


def _variable_of_roscpp(address: int, mappings: list[_Mapping]) -> bool:
    """Returns whether a variable of the library lies there; those that begin as zero follow it without a name."""
    end = 0
    for each in mappings:
        of_library = _LIBRARY in each.path or (not each.path and each.first == end)
        if each.written and of_library:
            end = each.end
            if each.first <= address < each.end:
                return True
        else:
            end = each.end if of_library and _LIBRARY in each.path else 0
    return False


_STATE_BYTES = 64
_RUNS_BYTES = 64
_AWAKE = b"RD"
_STOPPED = b"Tt"
_NAP = b"nanosleep"
_UNTOLD = b"0"
_CONDITION = b"futex"
# What stands in a call's place where a thread runs, or is about to.
_RUNS = "running"
# Of futex(2): to wait, without and with a set of bits; other bits say which clock there is, and whose it is.
_WAITS, _OPERATION = frozenset({0, 9}), 0x7F
_LOOK_AGAIN_S = 0.002
# Whoever waits there hears nothing of a socket; the last is where a nap is held (``nap_gate``).
_DEAF = (_NAP, _CONDITION, b"seccomp")
_NONE: frozenset[int] = frozenset()


class Runs(NamedTuple):
    """What the kernel counts of a thread: how long it ran, how long it waited for a core, how often it was run."""

    ran_ns: int = 0
    waited_ns: int = 0
    times: int = 0

    @classmethod
    def of(cls, noted: bytes) -> Self:
        """Returns what was noted of a thread; zeros for one that was not there."""
        return cls(*map(int, noted.split()))


class Rest(Enum):
    """What a look found: all asleep since the last look, or why not."""

    ASLEEP = "asleep"
    MOVED = "moved"
    AWAKE = "awake"
    STOPPED = "stopped"


class _Thread(NamedTuple):
    pid: int
    tid: int
    state: int
    runs: int
    waits: int

    def close(self) -> None:
        for file in (self.state, self.runs, self.waits):
            os.close(file)


class ThreadWatch:
    """The threads of an application's processes; files of ``/proc`` stay open from look to look.

    Args:
        proc: Where the kernel tells of processes.

    Attributes:
        limits: Whether a wait on a condition until a time is a nap.
        looks: How often it looked.
        runs: What was noted last of each thread: how long and how often it was run.
        changed: Threads that were run between the last two notes.
    """

    def __init__(self, proc: Path = Path("/proc")) -> None:
        self._proc, self.limits = proc, False
        self.looks = 0
        self.runs: dict[int, bytes] = {}
        self.changed: frozenset[int] = frozenset()
        self._threads: dict[int, _Thread] = {}
        self._marked: dict[int, bytes] = {}
        # The thread that was found awake last is asked first: as long as it is, the others need not be asked.
        self._hot: _Thread | None = None
        # Of whoever looks, so it is opened by the thread that does.
        self._own, self._own_waited_ns = -1, 0
        with contextlib.suppress(OSError):
            self._own = os.open(proc / "thread-self/schedstat", os.O_RDONLY)

    def refresh(self, pids: Iterable[int]) -> None:
        """Looks again which threads these processes have.

        Raises:
            OSError: There is no room for so many open files.
        """
        there: dict[int, int] = {}
        for pid in pids:
            with _gone():
                there.update((int(tid), pid) for tid in os.listdir(f"{self._proc}/{pid}/task"))  # noqa: PTH208 - much quicker
        for tid in self._threads.keys() - there.keys():
            self._forget(tid)
        for tid in there.keys() - self._threads.keys():
            with _gone():
                self._threads[tid] = _opened(self._proc, there[tid], tid)

    def look(self, besides: Set[int] = _NONE) -> Rest:
        """Returns whether all threads, besides some, slept since the last look; the first look never says so."""
        self.looks += 1
        hot, stopped = self._hot, False
        if hot is not None and hot.tid not in besides and self._state(hot) in _AWAKE:
            return Rest.AWAKE
        for thread in [each for tid, each in self._threads.items() if tid not in besides]:
            state = self._state(thread)
            if state in _AWAKE:
                self._hot = thread
                return Rest.AWAKE
            stopped = stopped or state in _STOPPED
        self.snapshot()
        if self.changed - besides:
            return Rest.MOVED
        return Rest.STOPPED if stopped else Rest.ASLEEP

    def snapshot(self) -> None:
        """Notes how often each thread was run so far."""
        runs: dict[int, bytes] = {}
        for tid, thread in list(self._threads.items()):
            try:
                runs[tid] = os.pread(thread.runs, _RUNS_BYTES, 0)
            except OSError:
                self._forget(tid)
        self.changed = _differ(runs, self.runs) if runs != self.runs else _NONE
        self.runs = runs

    def mark(self) -> None:
        """Notes that what comes now has a cause: something was sent."""
        self._marked = self.runs

    def moved(self, besides: Set[int] = _NONE) -> bool:
        """Returns whether any thread, besides some, was run between the mark and the last look."""
        return self.runs != self._marked and bool(_differ(self.runs, self._marked) - besides)

    def ran(self, tid: int, noted: bytes | None) -> bool:
        """Returns whether a thread was run since that was noted of it, or is gone."""
        now = self.now(tid)
        return not now or now != noted

    def now(self, tid: int) -> bytes:
        """Returns what is to be noted of a thread now; empty for one that is gone."""
        thread = self._threads.get(tid)
        try:
            return os.pread(thread.runs, _RUNS_BYTES, 0) if thread is not None else b""
        except OSError:
            return b""

    def waits_for_core(self, tid: int) -> bool:
        """Returns whether a thread is awake; one that was not run since it slept, and is, waits for a core."""
        thread = self._threads.get(tid)
        return thread is not None and self._state(thread) in _AWAKE

    def ran_s(self, before: Mapping[int, bytes]) -> float:
        """Returns the longest that a thread ran since that was noted, in seconds.

        Args:
            before: What ``runs`` was; a thread that is not there came later.
        """
        longest_ns = 0
        for tid, thread in list(self._threads.items()):
            try:
                now = os.pread(thread.runs, _RUNS_BYTES, 0)
            except OSError:
                self._forget(tid)
                continue
            longest_ns = max(longest_ns, Runs.of(now).ran_ns - Runs.of(before.get(tid, b"")).ran_ns)
        return longest_ns / 1e9

    def looker_waited_s(self) -> float:
        """Returns how long whoever looks waited for a core since this was asked last, in seconds."""
        before, waited_ns = self._own_waited_ns, 0
        if self._own >= 0:
            waited_ns = Runs.of(os.pread(self._own, _RUNS_BYTES, 0)).waited_ns
        self._own_waited_ns = waited_ns
        return (waited_ns - before) / 1e9

    def touched(self, before: Mapping[int, bytes], besides: Set[int]) -> frozenset[int]:
        """Returns the processes of which threads, besides some, were run since that was noted, or came or are gone.

        A thread that is gone may be any process's: 0 stands for all.

        Args:
            before: What ``runs`` was.
            besides: Threads that may run by themselves. One of them that waits for what may be sent to it counts.
        """
        ran = _differ(self.runs, before)
        return frozenset(self.process(tid) for tid in ran if tid not in besides or self.listens(tid))

    def process(self, tid: int) -> int:
        """Returns the process of a thread; 0 for one that is not known."""
        thread = self._threads.get(tid)
        return thread.pid if thread is not None else 0

    def counted(self) -> dict[int, Runs]:
        """Returns what the kernel counts of each thread, as of the last look."""
        return {tid: Runs.of(runs) for tid, runs in self.runs.items() if runs}

    def counts_since_mark(self) -> dict[int, int]:
        """Returns how often threads were run between the mark and the last look; of those that were there then."""
        there = {tid: Runs.of(noted).times for tid, noted in self._marked.items() if noted}
        return {tid: counted.times - there[tid] for tid, counted in self.counted().items() if tid in there}

    def napping(self, exempt: Set[int] = _NONE) -> frozenset[int] | None:
        """Returns the threads that were run since the mark and may sleep by the wall's clock, as ``time.sleep`` does.

        One of which the kernel does not tell where it sleeps may, too. None says that one of them woke up meanwhile.

        Args:
            exempt: Threads that may, as the first one of a Python node in ``rospy.spin``.
        """
        if self.runs == self._marked:
            return _NONE
        ran = [tid for tid in _differ(self.runs, self._marked) - exempt if tid in self._threads]
        naps = frozenset(tid for tid in ran if self._naps(self._threads[tid]))
        woken = any(self._woken(tid) for tid in ran if tid not in naps)
        return None if woken else naps

    def sleepers(self) -> frozenset[int]:
        """Returns the threads that the kernel tells to sleep by the wall's clock now."""
        return frozenset(tid for tid, thread in self._threads.items() if _NAP in _waits_at(thread))

    def resting(self) -> frozenset[int]:
        """Returns the sleepers, and the threads that wait on a condition until a time where that is a nap."""
        return self.sleepers() | {tid for tid, thread in self._threads.items() if self._naps_on_condition(thread)}

    def _naps_on_condition(self, thread: _Thread) -> bool:
        """Returns whether a thread waits on a condition until a time, and that is a nap."""
        return self.limits and _CONDITION in _waits_at(thread) and _waits_until(self._call(thread))

    def _naps(self, thread: _Thread) -> bool:
        return _may_nap(thread) or self._naps_on_condition(thread)

    def _call(self, thread: _Thread) -> list[str]:
        """Returns the system call that a thread is in, its number first; nothing where the kernel does not tell."""
        with contextlib.suppress(OSError):
            return Path(f"{self._proc}/{thread.pid}/task/{thread.tid}/syscall").read_text().split()
        return []

    def doing(self, tid: int) -> str:
        """Returns what a thread does, for a person: where it waits is the kernel's name; empty if it is gone."""
        thread = self._threads.get(tid)
        with contextlib.suppress(OSError):
            if thread is not None:
                where = _waits_at(thread)
                told = self._state(thread) not in _AWAKE and where not in (b"", _UNTOLD)
                return f"waits in {where.decode(errors='replace')}" if told else "runs"
        return ""

    def stopped(self) -> bool:
        """Returns whether a thread is stopped by a signal now, whatever others do."""
        return any(self._state(thread) in _STOPPED for thread in list(self._threads.values()))

    def awake(self) -> int:
        """Returns the thread that the last look found awake; 0 for none."""
        return self._hot.tid if self._hot is not None else 0

    def _woken(self, tid: int) -> bool:
        """Returns whether a thread was run since the last look, or waits for a core after its nap."""
        return self.waits_for_core(tid) or self.ran(tid, self.runs.get(tid))

    def listens(self, tid: int, looks: int = 1) -> bool:
        """Returns whether a thread may wait for something to come to a socket, until a limit perhaps.

        Args:
            tid: The thread.
            looks: How often to look, at most, where a thread waits of which the kernel does not tell it.
        """
        thread = self._threads.get(tid)
        where = _waits_at(thread) if thread is not None else b""
        while thread is not None and where == _UNTOLD and (looks := looks - 1) > 0:
            time.sleep(_LOOK_AGAIN_S)
            where = _waits_at(thread)
        return not any(name in where for name in _DEAF)

    def naps(self, tid: int) -> bool:
        """Returns whether a thread may sleep by the wall's clock now, as ``time.sleep`` does."""
        thread = self._threads.get(tid)
        return thread is not None and _may_nap(thread)

    def sleeps_until(self, tid: int) -> bool:
        """Returns whether a thread wakes up by itself, or just did: it may nap, or waits on a condition for a time."""
        thread = self._threads.get(tid)
        if thread is None or _may_nap(thread):
            return thread is not None
        call = self._call(thread)
        return call == [_RUNS] or (_CONDITION in _waits_at(thread) and _waits_until(call))

    def close(self) -> None:
        """Closes the files."""
        for tid in list(self._threads):
            self._forget(tid)
        if self._own >= 0:
            os.close(self._own)
            self._own = -1

    def _state(self, thread: _Thread) -> bytes:
        """Returns the letter of a thread's state; that of a sleeper for one that is gone."""
        try:
            text = os.pread(thread.state, _STATE_BYTES, 0)
        except OSError:
            self._forget(thread.tid)
            return b"S"
        at = text.rfind(b")") + 2
        return text[at : at + 1] or b"S"

    def _forget(self, tid: int) -> None:
        thread = self._threads.pop(tid, None)
        if thread is not None:
            thread.close()
            if self._hot is thread:
                self._hot = None


@contextlib.contextmanager
def _gone() -> Generator[None]:
    """Suppresses what is said of a thread that is gone; one that nobody watches would be taken for one that sleeps."""
    try:
        yield
    except OSError as exc:
        if exc.errno in NO_ROOM:
            raise


def _opened(proc: Path, pid: int, tid: int) -> _Thread:
    files: list[int] = []
    try:
        for name in ("stat", "schedstat", "wchan"):
            files.append(os.open(f"{proc}/{pid}/task/{tid}/{name}", os.O_RDONLY))  # noqa: PERF401 - those before it are closed
    except OSError:
        for file in files:
            os.close(file)
        raise
    return _Thread(pid, tid, *files)


def _differ(after: Mapping[int, bytes], before: Mapping[int, bytes]) -> frozenset[int]:
    """Returns the threads that were run in between, that came, or that are gone."""
    gone = before.keys() - after.keys()
    return frozenset(tid for tid, runs in after.items() if before.get(tid) != runs) | gone


def _waits_at(thread: _Thread) -> bytes:
    """Returns the function of the kernel that a thread waits in; empty for one that is gone, 0 for one not told of."""
    with contextlib.suppress(OSError):
        return os.pread(thread.waits, _STATE_BYTES, 0).strip(b"\0\n ")
    return b""


def _may_nap(thread: _Thread) -> bool:
    where = _waits_at(thread)
    return where == _UNTOLD or _NAP in where


def _waits_until(call: list[str]) -> bool:
    """Returns whether a system call waits on a condition until a time."""
    # Its number, then what it was called with: an address, what to do, a value, the time.
    with contextlib.suppress(ValueError):
        return len(call) > 4 and int(call[2], 16) & _OPERATION in _WAITS and int(call[4], 16) != 0
    return False


def own_wait_s() -> float:
    """Returns how long this thread has waited for a core so far, in seconds; 0 where the kernel does not tell."""
    with contextlib.suppress(OSError):
        return Runs.of(Path("/proc/thread-self/schedstat").read_bytes()).waited_ns / 1e9
    return 0.0


def allow_files() -> None:
    """Lets this process open as many files as it may: each thread that is watched takes three."""
    most = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))


def counts_runs() -> bool:
    """Returns whether this kernel counts how often threads are run; without that nobody can tell who is quiet."""
    try:
        return len(Path("/proc/self/schedstat").read_bytes().split()) == 3
    except OSError:
        return False
