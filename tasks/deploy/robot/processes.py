"""Starts a bundle's programs in a group and an environment of their own, and ends all that they started.

Every process that is started carries a mark in its environment, which its children inherit. A process that leaves the
group, as a daemon does, is found by the mark, also by the next agent after this one was killed.

A daemon that cleared its environment carries no mark. But a process whose parent has ended belongs to the nearest
ancestor that asked for orphans (prctl(2), PR_SET_CHILD_SUBREAPER), and here that is the agent (Linux). So such a daemon
is found as long as this agent lives.
"""

import contextlib
import ctypes
import logging
import os
import signal
import subprocess
import threading
import time
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import IO
from uuid import uuid4

from tasks.deploy.robot.shutdown import Stop

_LOG = logging.getLogger(__name__)
_PROC = Path("/proc")
_SET_CHILD_SUBREAPER, _GET_CHILD_SUBREAPER = 36, 37
_ROOT_MARK = "SIMYARD_ROBOT_ROOT"
_RUN_MARK = "SIMYARD_RUN"
_OUTPUT_BYTES = 1 << 20
_PATIENCE_S = 2.0
_SLICE_S = 0.02
_SWEEPS = 10
_started: set[int] = set()  # and not waited for


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
    return [pid for pid in _children() if pid not in own and not _reap(pid)]


def _adopts() -> bool:
    if not _PROC.is_dir():
        return False
    answer = ctypes.c_int(0)
    ctypes.CDLL(None).prctl(_GET_CHILD_SUBREAPER, ctypes.byref(answer), 0, 0, 0)
    return bool(answer.value)


def _children() -> list[int]:
    found: list[int] = []
    for path in _PROC.iterdir():
        if path.name.isdigit():
            with contextlib.suppress(OSError):  # it has ended
                # The name before the last bracket may hold anything: proc(5), /proc/pid/stat.
                fields = (path / "stat").read_text(errors="replace").rpartition(")")[2].split()
                if int(fields[1]) == os.getpid():
                    found.append(int(path.name))
    return found


def _reap(pid: int) -> bool:
    with contextlib.suppress(ChildProcessError):
        return os.waitpid(pid, os.WNOHANG)[0] == pid
    return True


class RunningProgram:
    """A program that was started, and all that it started."""

    def __init__(self, process: subprocess.Popen[bytes], mark: str, others: frozenset[int]) -> None:
        self._process = process
        self._mark = mark
        self._others = others  # orphans from before it began

    @property
    def exit_code(self) -> int | None:
        """The exit code, negative for a signal; None while it runs."""
        return self._process.poll()

    def end(self) -> None:
        """Ends it and everything that it started: politely, then not."""
        if self.exit_code is None:
            _signal_group(self._process.pid, signal.SIGTERM)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(_PATIENCE_S)
        if self.exit_code is None:
            # Only while its leader is not reaped does the group's number surely mean this group.
            _signal_group(self._process.pid, signal.SIGKILL)
        self._process.wait()
        _started.discard(self._process.pid)
        _sweep(self._mark, self._others)


def start(argv: Sequence[str], folder: Path, environment: Mapping[str, str], root: Path, log: Path) -> RunningProgram:
    """Returns the program, started in a session of its own, without input, its output going to a capped file.

    Args:
        argv: Program and arguments; no shell reads them.
        folder: Its working directory.
        environment: All its variables, but for the marks.
        root: The robot's folder.
        log: Where the first MiB of its output goes.

    Raises:
        OSError: The program cannot be started.
    """
    run = uuid4().hex
    others = frozenset(orphans(_started))
    process = subprocess.Popen(  # noqa: S603 - running the bundle's own programs is what an agent is for
        list(argv),
        cwd=folder,
        env={**environment, _ROOT_MARK: str(root), _RUN_MARK: run},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    )
    _started.add(process.pid)
    if process.stdout:
        threading.Thread(target=_drain, args=(process.stdout, log), name=f"output {log.name}", daemon=True).start()
    return RunningProgram(process, f"{_RUN_MARK}={run}", others)


def wait(running: RunningProgram, timeout_s: float, stop: Stop) -> int | None:
    """Returns the exit code, or None when the program still runs after so many seconds.

    Raises:
        StopRequested: The agent has to end.
    """
    until_s = time.monotonic() + timeout_s
    while (code := running.exit_code) is None and time.monotonic() < until_s:
        stop.sleep(_SLICE_S)
    return code


def end_all(root: Path) -> None:
    """Ends everything that agents on this robot's folder ever started."""
    _sweep(f"{_ROOT_MARK}={root}", frozenset())


def reap_orphans() -> None:
    """Lets go of orphans that have ended by themselves."""
    orphans(_started)


def _drain(output: IO[bytes], log: Path) -> None:
    """Keeps the beginning of the output and reads the rest, so that the program never waits for a full pipe."""
    left = _OUTPUT_BYTES
    with output, log.open("wb") as file:
        while block := os.read(output.fileno(), 1 << 16):
            file.write(block[:left])
            file.flush()
            left -= min(left, len(block))


def _signal_group(pid: int, number: signal.Signals) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(pid, number)


def _sweep(mark: str, spared: frozenset[int]) -> None:
    """Kills every process with the mark, and orphans without any; again, because they may be starting others."""
    for _ in range(_SWEEPS):
        found = {
            *_processes_with(mark.encode()),
            *(pid for pid in orphans(_started) if not _is_spared(pid, mark, spared)),
        }
        for pid in found:
            _LOG.info("ending process %d, left behind", pid)
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.kill(pid, signal.SIGKILL)
        if not found:
            return
        time.sleep(_SLICE_S)
    _LOG.error("processes with %s cannot be ended", mark)


def _is_spared(pid: int, mark: str, spared: frozenset[int]) -> bool:
    """Returns whether an orphan was there before, or is of another run, as of the application that runs on."""
    variables = _variables(_PROC / str(pid))
    return pid in spared or (
        mark.encode() not in variables and any(each.startswith(f"{_RUN_MARK}=".encode()) for each in variables)
    )


def _variables(process: Path) -> list[bytes]:
    try:
        return (process / "environ").read_bytes().split(b"\0")
    except OSError:  # it has ended, or is not ours
        return []


def _processes_with(mark: bytes) -> list[int]:
    found: list[int] = []
    for path in _PROC.iterdir() if _PROC.is_dir() else ():
        if not path.name.isdigit() or int(path.name) == os.getpid():
            continue
        if mark in _variables(path):
            found.append(int(path.name))
    return found
