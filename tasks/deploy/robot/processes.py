"""Starts a bundle's programs in a group and an environment of their own, and ends all that they started.

What forks for ever to get away is found by its parents and by a mark in its environment. The agent itself is stopped by
a signal, or because the process that started it is gone.
"""

import contextlib
import ctypes
import logging
import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import IO
from uuid import uuid4

from tasks.deploy.robot.account import Account

_STOP_LOOK_S = 0.05
_LOG = logging.getLogger(__name__)
_PROC = Path("/proc")
_SET_CHILD_SUBREAPER, _GET_CHILD_SUBREAPER = 36, 37
ROOT_MARK = "SIMYARD_ROBOT_ROOT"
RUN_MARK = "SIMYARD_RUN"
_LONGEST_S = 20.0
_MOMENT_S = 0.25
_SWEEP_LOOK_S = 0.005
_QUIET_LOOKS = 3
_LOGGED = 20
_HEAD_BYTES = _TAIL_BYTES = 1 << 18
_BLOCK_BYTES = 1 << 16
_PATIENCE_S = 2.0
_WAIT_LOOK_S = 0.02
_started: set[int] = set()  # and not waited for
_runs: set[str] = set()  # what was started and not ended


class StopRequested(Exception):  # noqa: N818 - no error: the agent unwinds to its end, and resumes at the next start
    """The agent has to end now; whatever it was doing is taken up at its next start."""


class Stop:
    """Asked before everything that takes time.

    Args:
        parent: The process that must live, or None; compared with the parent this process has.
        meanwhile: Called many times a second while somebody waits.
    """

    def __init__(self, parent: int | None = None, meanwhile: Callable[[], None] = lambda: None) -> None:
        self._parent = parent
        self._meanwhile = meanwhile
        # No event: its lock may be held by what the handler interrupts, which then never goes on.
        self._told = False

    def listen(self) -> None:
        """Makes SIGTERM and SIGINT request the stop."""
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._on_signal)

    def request(self) -> None:
        """Requests the stop."""
        self._told = True

    @property
    def requested(self) -> bool:
        """Whether the agent has to end."""
        return self._told or (self._parent is not None and os.getppid() != self._parent)

    def check(self) -> None:
        """Does nothing while the agent may go on.

        Raises:
            StopRequested: It may not.
        """
        if self.requested:
            raise StopRequested

    def sleep(self, seconds: float) -> None:
        """Waits, but not beyond the end.

        Raises:
            StopRequested: The agent has to end.
        """
        until_s = time.monotonic() + seconds
        self.check()
        while (left_s := until_s - time.monotonic()) > 0:
            time.sleep(min(left_s, _STOP_LOOK_S))
            self._meanwhile()
            self.check()

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        self._told = True


# Every process that is started carries a mark in its environment, which its children inherit. A process that leaves
# the group, as a daemon does, is found by the mark, also by the next agent after this one was killed.
#
# A daemon that cleared its environment carries no mark. But a process whose parent has ended belongs to the nearest
# ancestor that asked for orphans (prctl(2), PR_SET_CHILD_SUBREAPER), and here that is the agent (Linux). So such a
# daemon is found as long as this agent lives.
#
# A process may fork and exit faster than one looks at all processes. So what is found is stopped first: that ends its
# chain, because the one that is stopped forks no more, and nothing is left to start again what is killed. Only when a
# look finds nothing that runs, all that was stopped is killed. Between two looks at all processes, this process's own
# children are looked at again and again, which takes less time than a process needs to fork.
@dataclass(frozen=True)
class Quarry:
    """What is to be ended.

    Attributes:
        mark: In the environment of each process, such as ``SIMYARD_RUN=0123``.
        own: Children of this process that it waits for elsewhere.
        spared: Orphans without the mark that were there before.
        runs: Marks of what runs on.
    """

    mark: str
    own: Collection[int] = ()
    spared: Collection[int] = ()
    runs: Collection[str] = field(default_factory=frozenset[str])

    def holds(self, pid: int, *, adopts: bool) -> bool:
        """Returns whether a process belongs to it.

        Args:
            pid: The process.
            adopts: Whether this process is given orphans.
        """
        variables = _variables(pid)
        if self.mark.encode() in variables:
            return pid != os.getpid()
        if not adopts or pid in self.own or pid in self.spared or not _is_child(pid):
            return False
        return not any(f"{RUN_MARK}={run}".encode() in variables for run in self.runs)


def adopt_orphans() -> None:
    """Makes this process the parent of what its programs leave behind; where there is no such thing, does nothing."""
    if _PROC.is_dir():
        ctypes.CDLL(None).prctl(_SET_CHILD_SUBREAPER, 1, 0, 0, 0)


def orphans(own: Collection[int]) -> list[int]:
    """Returns the processes that became this one's children and live; those that have ended are reaped.

    Args:
        own: Children that this process has started itself, and waits for elsewhere.
    """
    if not _adopts():
        return []
    return [pid for pid in _children() if pid not in own and not _has_ended(pid, own)]


def sweep(quarry: Quarry) -> None:
    """Ends all of it, within seconds whatever it does; logs what cannot be ended."""
    until_s, ended = time.monotonic() + _LONGEST_S, 0
    with _hurry():
        while (found := _stop_all(quarry, until_s)) and time.monotonic() < until_s:
            for pid in found:
                if ended < _LOGGED:
                    _LOG.info("ending process %d, left behind", pid)
                ended += 1
                _send(pid, signal.SIGKILL)
            time.sleep(_SWEEP_LOOK_S)
    if ended > _LOGGED:
        _LOG.warning("ended %d processes that were left behind", ended)
    if found:
        _LOG.error("processes with %s cannot be ended", quarry.mark)


def _stop_all(quarry: Quarry, until_s: float) -> set[int]:
    """Returns the processes of the quarry that live, all stopped, as a last look at all processes found them."""
    adopts, stopped = _adopts(), set[int]()
    while True:
        stopped |= _stop_new(quarry, adopts=adopts)
        found = {pid for pid in _processes() if quarry.holds(pid, adopts=adopts) and not _is_gone(pid, quarry.own)}
        fresh = found - stopped
        stopped |= fresh
        for pid in fresh:
            _send(pid, signal.SIGSTOP)
        if not fresh or time.monotonic() > until_s:
            return found


def _stop_new(quarry: Quarry, *, adopts: bool) -> set[int]:
    """Returns the processes of the quarry that began while this looked for a moment, all stopped.

    What forks and exits is this process's child before it forks again.
    """
    until_s, known, stopped = time.monotonic() + _MOMENT_S, set[int](), set[int]()
    quiet = 0
    while time.monotonic() < until_s and quiet < _QUIET_LOOKS:
        # The newest first: those before it have ended by now, and only have to be reaped.
        now = [pid for pid in (reversed(_children()) if adopts else _processes()) if pid not in known]
        fresh = {pid for pid in now if not _has_ended(pid, quarry.own) and quarry.holds(pid, adopts=adopts)}
        for pid in fresh:
            _send(pid, signal.SIGSTOP)
        known.update(fresh)
        stopped |= fresh
        quiet = 0 if fresh else quiet + 1
    return stopped


def _children() -> list[int]:
    """Returns this process's children, the newest last, those that ended among them."""
    found: list[int] = []
    try:
        for task in os.listdir("/proc/self/task"):  # noqa: PTH208 - as below
            with open(f"/proc/self/task/{task}/children", "rb") as file:  # noqa: PTH123 - as below
                found += map(int, file.read().split())
    except OSError:  # a kernel without this file, or a thread that ended
        return [pid for pid in _processes() if _is_child(pid)]
    return found


def _has_ended(pid: int, own: Collection[int]) -> bool:
    """Returns whether an orphan has ended, which is reaped; False for what is waited for elsewhere."""
    if pid in own:
        return False
    try:
        return os.waitpid(pid, os.WNOHANG)[0] == pid
    except ChildProcessError:  # not this process's child
        return False


@contextlib.contextmanager
def _hurry() -> Generator[None]:
    """Goes before other processes, where this one may: what is to be ended may keep every core busy."""
    before = os.getpriority(os.PRIO_PROCESS, 0)
    try:
        os.setpriority(os.PRIO_PROCESS, 0, -20)
    except PermissionError:
        yield
        return
    try:
        yield
    finally:
        os.setpriority(os.PRIO_PROCESS, 0, before)


def _adopts() -> bool:
    if not _PROC.is_dir():
        return False
    answer = ctypes.c_int(0)
    ctypes.CDLL(None).prctl(_GET_CHILD_SUBREAPER, ctypes.byref(answer), 0, 0, 0)
    return bool(answer.value)


def _processes() -> Iterator[int]:
    with contextlib.suppress(FileNotFoundError):
        yield from (int(name) for name in os.listdir(_PROC) if name.isdigit())  # noqa: PTH208 - half as fast with Path


def _state(pid: int) -> tuple[str, int]:
    """Returns the letter of a process's state and its parent; nothing for one that has ended."""
    try:
        with open(f"/proc/{pid}/stat", "rb") as file:  # noqa: PTH123 - half as fast with Path
            # The name before the last bracket may hold anything: proc(5), /proc/pid/stat.
            fields = file.read().rpartition(b")")[2].split()
    except OSError:
        return "", 0
    return fields[0].decode(), int(fields[1])


def _is_child(pid: int) -> bool:
    return _state(pid)[1] == os.getpid()


def _is_gone(pid: int, own: Collection[int]) -> bool:
    """Returns whether a process has ended; an orphan that has is reaped."""
    return _has_ended(pid, own) or _state(pid)[0] in {"", "Z", "X"}


def _send(pid: int, number: signal.Signals) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.kill(pid, number)


def _variables(pid: int) -> list[bytes]:
    try:
        with open(f"/proc/{pid}/environ", "rb") as file:  # noqa: PTH123 - half as fast with Path
            return file.read().split(b"\0")
    except OSError:  # it has ended, or is not ours
        return []


class RunningProgram:
    """A program that was started, and all that it started."""

    def __init__(self, process: subprocess.Popen[bytes], run: str, others: frozenset[int]) -> None:
        self._process = process
        self._run = run
        self._others = others  # orphans from before it began

    @property
    def exit_code(self) -> int | None:
        """The exit code, negative for a signal; None while it runs."""
        return self._process.poll()

    def end(self) -> None:
        """Ends it and everything that it started: politely, then not."""
        if self.exit_code is None:
            until_s = time.monotonic() + _PATIENCE_S
            _signal_group(self._process.pid, signal.SIGTERM)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(_PATIENCE_S)
            # One that only leads, as bubblewrap does, ends at once: the others have the same time.
            while time.monotonic() < until_s and _group_runs(self._process.pid):
                time.sleep(_WAIT_LOOK_S)
        if self.exit_code is None:
            # Only while its leader is not reaped does the group's number surely mean this group.
            _signal_group(self._process.pid, signal.SIGKILL)
        with contextlib.suppress(subprocess.TimeoutExpired):  # what hangs in the kernel ends when that lets go of it
            self._process.wait(_PATIENCE_S)
        _started.discard(self._process.pid)
        _runs.discard(self._run)
        sweep(Quarry(f"{RUN_MARK}={self._run}", _started, self._others, _runs))


def start(
    argv: Sequence[str],
    folder: Path,
    environment: Mapping[str, str],
    root: Path,
    log: Path,
    *,
    account: Account | None = None,
) -> RunningProgram:
    """Returns the program, started in a session of its own, without input, its output going to a capped file.

    Args:
        argv: Program and arguments; no shell reads them.
        folder: Its working directory.
        environment: All its variables, but for the marks.
        root: The robot's folder.
        log: Where its output goes.
        account: Under which it runs; None for this process's own.

    Raises:
        OSError: The program cannot be started.
    """
    run = uuid4().hex
    others = frozenset(orphans(_started))
    process = subprocess.Popen(  # noqa: S603 - running the bundle's own programs is what an agent is for
        list(argv),
        cwd=folder,
        env={**environment, ROOT_MARK: str(root), RUN_MARK: run},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
        user=account.uid if account else None,
        group=account.gid if account else None,
        extra_groups=account.groups if account else None,
    )
    _started.add(process.pid)
    _runs.add(run)
    if process.stdout:
        threading.Thread(target=_drain, args=(process.stdout, log), name=f"output {log.name}", daemon=True).start()
    return RunningProgram(process, run, others)


def wait(running: RunningProgram, timeout_s: float, stop: Stop) -> int | None:
    """Returns the exit code, or None when the program still runs after so many seconds.

    Raises:
        StopRequested: The agent has to end.
    """
    until_s = time.monotonic() + timeout_s
    while (code := running.exit_code) is None and time.monotonic() < until_s:
        stop.sleep(_WAIT_LOOK_S)
    return code


def end_all(root: Path) -> None:
    """Ends everything that agents on this robot's folder ever started."""
    sweep(Quarry(f"{ROOT_MARK}={root}", _started, runs=_runs))


def reap_orphans() -> None:
    """Lets go of orphans that have ended by themselves."""
    orphans(_started)


class _OutputFile:
    """A file with the beginning and the end of what a program prints, and how much is left out between them.

    While the program runs, up to twice the end stands there, so that not every line rewrites the file.
    """

    def __init__(self, log: Path) -> None:
        self._log = log
        self._head, self._tail = bytearray(), bytearray()
        self._left_out = 0
        self._file = log.open("wb")

    def write(self, block: bytes) -> None:
        """Adds what was printed."""
        room = _HEAD_BYTES - len(self._head)
        self._head += block[:room]
        self._tail += block[room:] if room < len(block) else b""
        if len(self._tail) > 2 * _TAIL_BYTES:
            self._rewrite()
        else:
            self._file.write(block)
            self._file.flush()

    def close(self) -> None:
        """Ends the file, with no more than the end of what was printed."""
        if len(self._tail) > _TAIL_BYTES:
            self._rewrite()
        self._file.close()

    def _rewrite(self) -> None:
        self._left_out += len(self._tail) - _TAIL_BYTES
        del self._tail[:-_TAIL_BYTES]
        fresh = self._log.with_suffix(".new")
        with fresh.open("wb") as file:
            file.write(self._head + b"\n[%d bytes are left out here]\n" % self._left_out + self._tail)
        fresh.replace(self._log)
        self._file.close()
        self._file = self._log.open("ab")


def _drain(output: IO[bytes], log: Path) -> None:
    """Keeps some of the output and reads all of it, so that the program never waits for a full pipe."""
    with output:
        try:
            with contextlib.closing(_OutputFile(log)) as file:
                while block := os.read(output.fileno(), _BLOCK_BYTES):
                    file.write(block)
        except OSError as exc:  # the disk is full, or broken: the program runs on
            _LOG.warning("%s holds no more of what is printed: %s", log, exc)
            while os.read(output.fileno(), _BLOCK_BYTES):
                continue


def _group_runs(group: int) -> bool:
    """Returns whether a process of a group runs or sleeps; a zombie does neither."""
    for pid in _processes():
        with contextlib.suppress(ProcessLookupError):
            if os.getpgid(pid) == group and _state(pid)[0] not in {"", "Z", "X"}:
                return True
    return False


def _signal_group(pid: int, number: signal.Signals) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(pid, number)
