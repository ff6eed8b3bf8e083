"""How much of a machine one episode's application may use; more is a failure of that episode alone."""

import errno
import os
import signal
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

_PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")
_MIB = 1 << 20
NO_ROOM = frozenset({errno.EAGAIN, errno.ENOMEM, errno.EMFILE, errno.ENFILE})
"""What a machine says that has no room for more processes or files: fewer lanes at once may fit."""


class LaneLimits(NamedTuple):
    """What one application may use.

    Attributes:
        memory_bytes: Of all its processes, without what they share with files.
        processes: At once.
        written_bytes: In its folder, logs included; a single file has no more, either.
        open_files: Of each process.
    """

    memory_bytes: int = 4096 * _MIB
    processes: int = 256
    written_bytes: int = 512 * _MIB
    open_files: int = 4096

    def command(self) -> tuple[str, ...]:
        """Returns what stands before a node's command so that the kernel keeps those limits that it can."""
        return (
            "prlimit",
            f"--nofile={self.open_files}:{self.open_files}",
            f"--fsize={self.written_bytes}:{self.written_bytes}",
            "--core=0:0",
            "--",
        )

    def excess(self, pids: Sequence[int], home: Path) -> str:
        """Returns which limit an application is beyond, for a person; empty while it keeps them all.

        Args:
            pids: Its processes.
            home: Its folder.
        """
        if len(pids) > self.processes:
            return f"runs {len(pids)} processes: more than the {self.processes} that an application may have"
        memory = sum(map(_private_bytes, pids))
        if memory > self.memory_bytes:
            return f"takes {memory // _MIB} MiB of memory: more than the {self.memory_bytes // _MIB} MiB that it may"
        written = _written_bytes(home)
        if written > self.written_bytes:
            return f"wrote {written // _MIB} MiB of files and logs: more than the {self.written_bytes // _MIB} MiB"
        return ""


def ending(status: int) -> str:
    """Returns how a process ended, for a person.

    Args:
        status: Its exit status; a signal's number below 0.
    """
    if status >= 0:
        return f"ended with status {status}"
    number = -status
    name = signal.Signals(number).name if number in set(signal.Signals) else f"signal {number}"
    more = ": it wrote a file of more bytes than an application may" if number == signal.SIGXFSZ else ""
    return f"was ended by {name}{more}"


def _private_bytes(pid: int) -> int:
    try:
        fields = Path(f"/proc/{pid}/statm").read_bytes().split()
        return (int(fields[1]) - int(fields[2])) * _PAGE_BYTES
    except (OSError, IndexError, ValueError):
        return 0


def _written_bytes(folder: Path) -> int:
    """Returns the bytes that lie below a folder; links are not followed."""
    total, todo = 0, [str(folder)]
    while todo:
        try:
            with os.scandir(todo.pop()) as entries:
                for entry in entries:
                    if entry.is_dir(follow_symlinks=False):
                        todo.append(entry.path)
                    else:
                        total += entry.stat(follow_symlinks=False).st_blocks * 512
        except OSError:
            continue
    return total
