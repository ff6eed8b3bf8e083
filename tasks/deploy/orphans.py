"""What programs leave behind becomes this process's child, so that it is found whatever it did to hide (Linux).

A daemon that cleared its environment carries no mark. But a process whose parent has ended belongs to the nearest
ancestor that asked for orphans (prctl(2), PR_SET_CHILD_SUBREAPER), and here that is the agent.
"""

import contextlib
import ctypes
import os
from collections.abc import Collection
from pathlib import Path

_PROC = Path("/proc")
_SET_CHILD_SUBREAPER, _GET_CHILD_SUBREAPER = 36, 37


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
    return [pid for pid in _children() if pid not in own and not _reaped(pid)]


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


def _reaped(pid: int) -> bool:
    with contextlib.suppress(ChildProcessError):
        return os.waitpid(pid, os.WNOHANG)[0] == pid
    return True
