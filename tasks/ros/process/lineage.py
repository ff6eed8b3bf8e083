"""Which processes belong to which episode: its nodes, what they started, and what got away from its parents.

An episode's processes are found as children of its nodes, by the session that a node leads, and, once they have
neither, by the ``ROS_HOME`` in their environment: whoever their parent is by now.
"""

import contextlib
import ctypes
import os
import threading
import time
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

_PR_SET_CHILD_SUBREAPER, _PR_GET_CHILD_SUBREAPER = 36, 37
_LOADAVG_BYTES = 64


class _Adoption:
    """Makes this process the parent of its descendants' orphans for as long as anybody needs it.

    It is taken back at the end: a process that is given orphans may be asked by others, such as a robot's agent, to end
    all that it did not start.
    """

    def __init__(self) -> None:
        self._lock, self._holders, self._before = threading.Lock(), 0, 0

    @property
    def alone(self) -> bool:
        """Returns whether one holder needs it, and no other."""
        return self._holders == 1

    def begin(self) -> None:
        with self._lock:
            if not self._holders:
                asked = ctypes.c_int()
                ctypes.CDLL(None).prctl(_PR_GET_CHILD_SUBREAPER, ctypes.byref(asked), 0, 0, 0)
                self._before = asked.value
                ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
            self._holders += 1

    def end(self) -> None:
        with self._lock:
            self._holders -= 1
            if not self._holders:
                ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, self._before, 0, 0, 0)


_ADOPTION = _Adoption()


class Lineage:
    """The processes of all episodes that this process runs; until it is closed, their orphans are this process's.

    So what calls ``setsid`` cannot get away.

    Begun when this process has all its own children that lead a session: others that are started later, and do, are
    taken for orphans of nodes.

    Attributes:
        epoch: Grows when a process or thread was started anywhere on the machine since the last ``update``.
    """

    def __init__(self) -> None:
        _ADOPTION.begin()
        self.epoch = 0
        self._own_children = frozenset(each.pid for each in _children())
        self._begun_ticks = int(time.clock_gettime(time.CLOCK_BOOTTIME) * os.sysconf("SC_CLK_TCK"))
        self._of: dict[int, Path] = {}
        self._seen: set[int] = set()
        self._newest = b""
        self._loadavg = os.open("/proc/loadavg", os.O_RDONLY)

    def add(self, pid: int, home: Path) -> None:
        """Counts a node that was just started among the processes of an episode."""
        self._of[pid] = home
        self._newest = b""

    def update(self) -> None:
        """Looks for processes that are new; quick as long as nothing was started on this machine."""
        newest = os.pread(self._loadavg, _LOADAVG_BYTES, 0).rpartition(b" ")[2]
        if newest == self._newest:
            return
        self._newest, self.epoch = newest, self.epoch + 1
        there = _process_ids()
        for pid in self._of.keys() - there:
            del self._of[pid]
        # A parent is older than its child; numbers start again at the smallest one some day, and two rounds see that.
        new = sorted(there - self._seen)
        for pid in (*new, *new):
            if pid not in self._of:
                self._place(pid)
        self._seen = there

    def processes(self, home: Path) -> list[int]:
        """Returns the processes of an episode as of the last update."""
        return [pid for pid, each in self._of.items() if each == home]

    def strays(self) -> list[int]:
        """Returns the orphans that this process adopted and nobody knows: its new children in a session of their own.

        A node's orphan may have left its session and its mark behind; a session of this process's it cannot enter. As
        long as others have episodes in this process, theirs are not told apart: there are none then.
        """
        if not _ADOPTION.alone:
            return []
        session = os.getsid(0)
        return [
            each.pid
            for each in _children()
            if each.session != session and each.begun_ticks >= self._begun_ticks and each.pid not in self._own_children
        ]

    def forget(self, homes: Iterable[Path]) -> None:
        """Forgets the processes of episodes that are over."""
        gone = set(homes)
        self._of = {pid: home for pid, home in self._of.items() if home not in gone}

    def close(self) -> None:
        """Closes the file, and adopts no more."""
        if self._loadavg >= 0:
            os.close(self._loadavg)
            self._loadavg = -1
            _ADOPTION.end()

    def _place(self, pid: int) -> None:
        with contextlib.suppress(OSError, IndexError, ValueError):
            fields = Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()
            parent, session = int(fields[1]), int(fields[3])
            home = self._of.get(parent) or self._of.get(session)
            if home is None and parent in (os.getpid(), 1):
                home = next((each for each in set(self._of.values()) if has_home(pid, each)), None)
            if home is not None:
                self._of[pid] = home


def has_home(pid: int, home: Path) -> bool:
    """Returns whether a process, whoever its parent is, has an episode's folder as its ROS_HOME."""
    with contextlib.suppress(OSError):
        return f"ROS_HOME={home}".encode() in Path(f"/proc/{pid}/environ").read_bytes().split(b"\0")
    return False


def marked(homes: Iterable[Path]) -> list[int]:
    """Returns the processes of episodes that ``/proc`` shows now, by their environment; zombies have none."""
    marks = {f"ROS_HOME={home}".encode() for home in homes}
    found: list[int] = []
    for pid in _process_ids():
        with contextlib.suppress(OSError):
            if not marks.isdisjoint(Path(f"/proc/{pid}/environ").read_bytes().split(b"\0")):
                found.append(pid)
    return found


def alive(pid: int) -> bool:
    """Returns whether a process runs or sleeps: a zombie does neither."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()[0] not in (b"Z", b"X")
    return False


class _Child(NamedTuple):
    pid: int
    session: int
    begun_ticks: int


def _children() -> list[_Child]:
    """Returns this process's children; zombies are none."""
    found: list[_Child] = []
    for pid in _process_ids():
        with contextlib.suppress(OSError, IndexError, ValueError):
            fields = Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()
            if int(fields[1]) == os.getpid() and fields[0] not in (b"Z", b"X"):
                found.append(_Child(pid, int(fields[3]), int(fields[19])))
    return found


def _process_ids() -> set[int]:
    return {int(name) for name in os.listdir("/proc") if name.isdigit()}  # noqa: PTH208 - much quicker
