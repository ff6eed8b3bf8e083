"""Which threads of a node in C++ wait for simulated time alone: roscpp's own, which has all of a process's timers.

It looks at the clock each millisecond, and sleeps in between on a condition that is a variable of roscpp's library. So
the address that it waits at, which the kernel tells (``/proc/*/task/*/syscall``), says whether a thread is that one.
"""

import contextlib
from pathlib import Path
from typing import NamedTuple

_LIBRARY = "/libroscpp.so"
_FIELDS = 5
_TRIES = 20


class _Mapping(NamedTuple):
    first: int
    end: int
    written: bool
    path: str


def keeps_timers(pid: int, tid: int) -> bool:
    """Returns whether a thread is roscpp's for timers; False where the kernel does not tell."""
    with contextlib.suppress(OSError, ValueError):
        mappings = _mappings(Path(f"/proc/{pid}/maps").read_text())
        for _ in range(_TRIES):
            # "running", or a number, then what it was called with: to wait, first of all the address.
            words = Path(f"/proc/{pid}/task/{tid}/syscall").read_text().split()
            if len(words) > 1:
                return _variable_of_roscpp(int(words[1], 16), mappings)
    return False


def _mappings(text: str) -> list[_Mapping]:
    found: list[_Mapping] = []
    for line in text.splitlines():
        words = line.split(maxsplit=_FIELDS)
        first, end = (int(word, 16) for word in words[0].split("-"))
        found.append(_Mapping(first, end, "w" in words[1], words[_FIELDS] if len(words) > _FIELDS else ""))
    return found


def _variable_of_roscpp(address: int, mappings: list[_Mapping]) -> bool:
    """Returns whether a variable of the library lies there; those that begin as zero follow it without a name."""
    end = 0
    for each in mappings:
        of_library = _LIBRARY in each.path or (not each.path and each.first == end)
        if each.written and of_library:
            end = each.end
            if each.first <= address < each.end:
                return True
        else:
            end = each.end if of_library and _LIBRARY in each.path else 0
    return False
