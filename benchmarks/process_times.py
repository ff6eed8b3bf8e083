"""Processor time and memory of a process and of all that it starts, looked at again and again while it runs (Linux)."""

import os
import subprocess
import threading
import time
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

_LOOK_S = 0.05
_TICKS = os.sysconf("SC_CLK_TCK")
# What a command line holds that tells a process from others.
KINDS: Mapping[str, str] = {
    "tasks.server.": "server",
    "tasks.simulate.simulation_process": "simulation",
    "tasks.deploy.robot.agent": "agents",
}


class Look(NamedTuple):
    """What all processes had taken at a time: seconds of the processor, by kind of process."""

    at_s: float
    spent_s: Mapping[str, float]


class Ran(NamedTuple):
    """A command that ended.

    Attributes:
        began_s, ended_s: Seconds since 1970.
        looks: One after the other, from its beginning to its end.
        spent_s: Of the processor, for all processes that were waited for, as the kernel counts them.
        lines: What it wrote to stderr.
        held_mb: The most that one process of each kind held.
    """

    began_s: float
    ended_s: float
    looks: Sequence[Look]
    spent_s: float
    lines: Sequence[str]
    held_mb: Mapping[str, float]


def run_watched(
    command: Sequence[str], environment: Mapping[str, str], folder: Path, *, look_s: float = _LOOK_S
) -> Ran:
    """Returns what a command took, which has to succeed.

    Args:
        command: Program and arguments.
        environment: All of it.
        folder: Where it runs.
        look_s: From a look at its processes to the next: of a short run many, of a long one few, as each takes time.

    Raises:
        CalledProcessError: It failed.
    """
    began_s, before = time.time(), os.times()
    with subprocess.Popen(
        command, env=environment, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        watch = _Watch(process.pid, look_s)
        assert process.stderr is not None  # noqa: S101 - asked for
        lines = list(process.stderr)
        code = process.wait()
        ended_s, after = time.time(), os.times()
        looks = watch.end()
    if code:
        raise subprocess.CalledProcessError(code, command, stderr="".join(lines[-20:]))
    spent_s = after.children_user + after.children_system - before.children_user - before.children_system
    return Ran(began_s, ended_s, looks, spent_s, lines, watch.held_mb)


def spent_between(looks: Sequence[Look], begin_s: float, end_s: float) -> dict[str, float]:
    """Returns what each kind of process took between two times, by its name."""
    first, last = _spent_at(looks, begin_s), _spent_at(looks, end_s)
    return {kind: spent_s - first.get(kind, 0.0) for kind, spent_s in last.items()}


def _spent_at(looks: Sequence[Look], at_s: float) -> Mapping[str, float]:
    place = bisect_right(looks, at_s, key=lambda look: look.at_s)
    if place == 0:
        return {}
    if place == len(looks):
        return looks[-1].spent_s
    before, after = looks[place - 1], looks[place]
    share = (at_s - before.at_s) / (after.at_s - before.at_s)
    return {
        kind: before.spent_s.get(kind, 0.0) + share * (spent_s - before.spent_s.get(kind, 0.0))
        for kind, spent_s in after.spent_s.items()
    }


class _Watch:
    """Looks at a process and its descendants until it is told to end."""

    def __init__(self, root: int, look_s: float) -> None:
        self._root, self._look_s, self._left = root, look_s, threading.Event()
        self.held_mb: dict[str, float] = {}
        self._kinds: dict[int, str] = {}
        self._spent_s: dict[int, float] = {}
        self._looks: list[Look] = []
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def end(self) -> list[Look]:
        self._left.set()
        self._thread.join()
        return self._looks

    def _watch(self) -> None:
        self._look()
        while not self._left.wait(self._look_s):
            self._look()

    def _look(self) -> None:
        for pid, spent_s in _processes(self._root, self._kinds):
            kind = _kind(pid, self._root)
            if kind != "others" or pid not in self._kinds:  # one that has ended has no command line any more
                self._kinds[pid] = kind
            self._spent_s[pid] = max(spent_s, self._spent_s.get(pid, 0.0))
            self.held_mb[kind] = max(_held_mb(pid), self.held_mb.get(kind, 0.0))
        found: dict[str, float] = {}
        for pid, spent_s in self._spent_s.items():
            found[self._kinds[pid]] = found.get(self._kinds[pid], 0.0) + spent_s
        self._looks.append(Look(time.time(), found))


def _kind(pid: int, root: int) -> str:
    if pid == root:
        return "run"
    try:
        line = Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace")
    except OSError:
        return "others"
    return next((kind for part, kind in KINDS.items() if part in line), "others")


def _held_mb(pid: int) -> float:
    """Returns the most memory that a process held so far; 0 if it is gone."""
    try:
        status = Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return 0.0
    return next((int(line.split()[1]) / 1024 for line in status.splitlines() if line.startswith("VmHWM:")), 0.0)


def _processes(root: int, known: Mapping[int, str]) -> Iterator[tuple[int, float]]:
    """Yields the numbers of a process and its descendants, also of those whose parents are gone, and their seconds."""
    stats = dict(_every_stat(lambda name: name.isdecimal()))
    ours = {root} | (known.keys() & stats.keys())
    grown = True
    while grown:
        more = {pid for pid, stat in stats.items() if int(stat[1]) in ours} - ours
        ours, grown = ours | more, bool(more)
    for pid in ours & stats.keys():
        yield pid, (int(stats[pid][11]) + int(stats[pid][12])) / _TICKS


def _every_stat(wanted: Callable[[str], bool]) -> Iterator[tuple[int, list[str]]]:
    for name in filter(wanted, (path.name for path in Path("/proc").iterdir())):
        try:
            text = Path(f"/proc/{name}/stat").read_text()
        except OSError:
            continue
        yield int(name), text.rpartition(")")[2].split()
