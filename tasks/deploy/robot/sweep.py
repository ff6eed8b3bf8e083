"""Finds and ends all that a program has started, also what forks for ever to get away.

Every process that is started carries a mark in its environment, which its children inherit. A process that leaves the
group, as a daemon does, is found by the mark, also by the next agent after this one was killed.

A daemon that cleared its environment carries no mark. But a process whose parent has ended belongs to the nearest
ancestor that asked for orphans (prctl(2), PR_SET_CHILD_SUBREAPER), and here that is the agent (Linux). So such a daemon
is found as long as this agent lives.

A process may fork and exit faster than one looks at all processes. So what is found is stopped first: that ends its
chain, because the one that is stopped forks no more, and nothing is left to start again what is killed. Only when a
look finds nothing that runs, all that was stopped is killed. Between two looks at all processes, this process's own
children are looked at again and again, which takes less time than a process needs to fork.
"""

import contextlib
import ctypes
import logging
import os
import signal
import time
from collections.abc import Collection, Generator, Iterator
from dataclasses import dataclass, field
from pathlib import Path

_LOG = logging.getLogger(__name__)
_PROC = Path("/proc")
_SET_CHILD_SUBREAPER, _GET_CHILD_SUBREAPER = 36, 37
ROOT_MARK = "SIMYARD_ROBOT_ROOT"
RUN_MARK = "SIMYARD_RUN"
_LONGEST_S = 20.0
_MOMENT_S = 0.25
_SLICE_S = 0.005
_QUIET_LOOKS = 3
_LOGGED = 20


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
            time.sleep(_SLICE_S)
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
