"""Whether processes on Fast DDS know all of each other's readers and writers: nobody tells, but their threads do.

A participant asks each one that it knows whether that has heard of its readers and writers, once a second until all of
them have: by a thread that does what is due at a time. So once all such threads slept for longer at one and the same
moment, all is told. What wakes one otherwise, as its participant says again that it is there, has let it sleep before.

Sources: Fast DDS 2.14, EDPSimple.cpp (its heartbeat period), StatefulWriter.cpp (its periodic heartbeat goes on
until all is acknowledged); its documentation, "ThreadSettings", for the threads' names.
"""

import contextlib
import time
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import NamedTuple

_NAME = b"dds.ev"
# How long such a thread sleeps at least if nothing is left to tell.
_SILENT_S = 1.3
# After so long without news all is told where no thread has that name, and where one never sleeps for so long.
_UNNAMED_S, _RESTLESS_S = 5.0, 20.0
# Where others have the cores, all of it takes longer: as long as whoever looks waited for one, up to this.
_MOST_WAITED_S = 60.0
_LOOK_S = 0.1
_Thread = tuple[int, str]


class _Sleep(NamedTuple):
    """How often a thread was run, and since when it was not."""

    runs: bytes
    since_s: float


class DiscoveryWatch:
    """Watches the processes of one episode.

    Args:
        waited_s: Returns how long whoever looks has waited for a core so far.
        proc: Where the kernel tells of processes.

    Attributes:
        guessed: Whether they were taken to know each other although a thread never slept for long.
    """

    def __init__(self, waited_s: Callable[[], float], proc: Path = Path("/proc")) -> None:
        self._own_wait_s, self._proc, self.guessed = waited_s, proc, False
        self._sleeps: dict[_Thread, _Sleep] = {}
        # Who slept for long around the last moment at which somebody had not, and since the news.
        self._slept = set[_Thread]()
        self._news_s = self._looked_s = self._waited_s = 0.0
        self._told = False

    def told(self, pids: Collection[int], count: int, news_s: float) -> bool:
        """Returns whether all that there is to tell has been told.

        Args:
            pids: The episode's processes.
            count: How many of them are in the DDS domain.
            news_s: When somebody came or went last, by ``time.perf_counter``.
        """
        now_s = time.perf_counter()
        if news_s != self._news_s:
            self._news_s, self._waited_s, self._told = news_s, self._own_wait_s(), False
            self._slept.clear()
        if not self._told and now_s - self._looked_s >= _LOOK_S:
            self._look(pids, now_s)
            named = len({pid for pid, _ in self._sleeps}) >= count
            slept = named and self._sleeps.keys() <= self._slept
            waited_s = min(self._own_wait_s() - self._waited_s, _MOST_WAITED_S)
            self._told = slept or now_s - news_s - waited_s >= (_RESTLESS_S if named else _UNNAMED_S)
            self.guessed = self._told and named and not slept
        return self._told

    def _look(self, pids: Collection[int], now_s: float) -> None:
        """Notes who has slept for long; one that wakes up too early makes all others do so once more, from now on."""
        before, self._sleeps = self._sleeps, {}
        for thread, runs, awake in self._threads(pids):
            last = before.get(thread, _Sleep(b"", now_s))
            ran = last.runs != runs or awake
            self._sleeps[thread] = _Sleep(runs, now_s) if ran else last
            # Who ran between two looks slept until the first, and from the second on; what is news is still to be told.
            slept_s = (self._looked_s if ran else now_s) - max(last.since_s, self._news_s)
            if slept_s >= _SILENT_S:
                self._slept.add(thread)
            elif ran and thread not in self._slept:
                self._slept.clear()
        self._looked_s = now_s

    def _threads(self, pids: Collection[int]) -> Iterator[tuple[_Thread, bytes, bool]]:
        """Yields those threads, how often they were run, and whether one runs or waits for a core."""
        for each in self._tasks(pids):
            if self._read(each, "comm").startswith(_NAME) and (runs := self._read(each, "schedstat")):
                awake = self._read(each, "stat").rpartition(b") ")[2][:1] == b"R"
                yield (int(each.parts[-3]), each.name), runs, awake

    def _tasks(self, pids: Collection[int]) -> Iterator[Path]:
        for pid in pids:
            with contextlib.suppress(OSError):  # it has ended
                yield from (self._proc / str(pid) / "task").iterdir()

    def _read(self, task: Path, name: str) -> bytes:
        """Returns what the kernel says of a thread; empty for one that has ended."""
        with contextlib.suppress(OSError):
            return (task / name).read_bytes()
        return b""
