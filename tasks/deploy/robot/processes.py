"""Starts a bundle's programs in a group and an environment of their own, and ends all that they started.

What leaves the group is found by `tasks.deploy.robot.sweep`.
"""

import contextlib
import logging
import os
import signal
import subprocess
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO
from uuid import uuid4

from tasks.deploy.robot.account import Account
from tasks.deploy.robot.shutdown import Stop
from tasks.deploy.robot.sweep import ROOT_MARK, RUN_MARK, Quarry, orphans, sweep

_LOG = logging.getLogger(__name__)
_HEAD_BYTES = _TAIL_BYTES = 1 << 18
_BLOCK_BYTES = 1 << 16
_PATIENCE_S = 2.0
_SLICE_S = 0.02
_started: set[int] = set()  # and not waited for
_runs: set[str] = set()  # what was started and not ended


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
            _signal_group(self._process.pid, signal.SIGTERM)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(_PATIENCE_S)
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
        stop.sleep(_SLICE_S)
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


def _signal_group(pid: int, number: signal.Signals) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(pid, number)
