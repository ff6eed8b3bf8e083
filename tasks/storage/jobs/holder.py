"""The identity of a process that holds something, from which another process sees whether it still lives."""

import os
from pathlib import Path

from specs.base import Spec

_PROC = Path("/proc")
_ENDED_STATES = frozenset("ZX")


class ProcessIdentity(Spec):
    """One process, never mistaken for a later one that was given the same number.

    Attributes:
        host: The running kernel and the space in which ``pid`` counts (containers have their own); empty where the
            system does not tell.
        pid: The process's number.
        started: When it started, in the kernel's ticks since boot; empty where the system does not tell.
    """

    host: str
    pid: int
    started: str


def this_process() -> ProcessIdentity:
    """Returns the identity of the calling process."""
    return process_of(os.getpid())


def process_of(pid: int) -> ProcessIdentity:
    """Returns the identity of the process that has the number now; one that has ended has no start."""
    state = _state_and_start(pid)
    return ProcessIdentity(host=_host(), pid=pid, started=state[1] if state else "")


def is_known_dead(process: ProcessIdentity) -> bool:
    """Returns whether the process certainly runs no more; False for one on another host, of which nothing is known."""
    if not process.started or not process.host or process.host != _host():
        return False
    state = _state_and_start(process.pid)
    return state is None or state[1] != process.started or state[0] in _ENDED_STATES


def _host() -> str:
    try:
        boot = (_PROC / "sys/kernel/random/boot_id").read_text().strip()
        space = (_PROC / "self/ns/pid").readlink()
    except OSError:
        return ""
    return f"{boot} {space}"


def _state_and_start(pid: int) -> tuple[str, str] | None:
    # proc(5): the name in brackets may hold anything; state is the field behind it, the start time the 20th.
    try:
        fields = (_PROC / str(pid) / "stat").read_text().rpartition(")")[2].split()
    except OSError:
        return None
    return fields[0], fields[19]
