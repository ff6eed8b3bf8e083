"""The clock of calls: which call into an application's code is under way, and since when, for another process to see.

Who simulates may hang in an application's code and answer nothing any more. So each call is noted in a page of memory
that the process which started it shares: that process sees how long a call takes, and whom to blame when it ends it.
"""

import struct
import time
from collections.abc import Generator
from contextlib import AbstractContextManager, contextmanager
from mmap import mmap
from typing import Literal, NamedTuple

CLOCK_BYTES = 4096
CallKind = Literal["import", "call", "slice", "compile", "nodes"]
_KINDS: tuple[CallKind, ...] = ("import", "call", "slice", "compile", "nodes")
_CODES = ("", "RobotApplicationCrash", "SimulationApplicationCrash")
# A number that is odd while the rest is written, the beginning in seconds, kind, code, and how long the text is.
_HEAD = struct.Struct("<QdBBH")
_TEXT_BYTES = 400


class RunningCall(NamedTuple):
    """A call that is under way.

    Attributes:
        kind: What it is limited as.
        code: RoboMaker's failure code if it is to blame; empty where nobody is.
        what: Such as ``courier: importing nav/nav.py``.
        seconds: Since it began.
    """

    kind: CallKind
    code: str
    what: str
    seconds: float


class CallClock:
    """Notes calls in shared memory; calls within a call are noted instead of it, and it again after them."""

    def __init__(self, memory: mmap | None = None) -> None:
        """Begins with no call.

        Args:
            memory: At least ``CLOCK_BYTES``; None notes nothing.
        """
        self._memory = memory
        self._number = 0
        self._stack: list[tuple[float, int, int, bytes]] = []

    @contextmanager
    def call(self, kind: CallKind, code: str, what: str) -> Generator[None, None, None]:
        """Notes a call for as long as the ``with`` block takes.

        While nodes of ROS work, the clock of the call that waits for them stands still: they have limits of their own.
        """
        if self._memory is None:
            yield
            return
        text = what.encode("utf-8", "replace")[:_TEXT_BYTES]
        began_s = time.monotonic()
        self._stack.append((began_s, _KINDS.index(kind), _CODES.index(code), text))
        self._write(self._memory)
        try:
            yield
        finally:
            self._stack.pop()
            if kind == "nodes":
                waited_s = time.monotonic() - began_s
                self._stack = [(since_s + waited_s, outer, by, said) for since_s, outer, by, said in self._stack]
            self._write(self._memory)

    def _write(self, memory: mmap) -> None:
        self._number += 2
        began_s, kind, code, text = self._stack[-1] if self._stack else (0.0, 0, 0, b"")
        _HEAD.pack_into(memory, 0, self._number + 1, began_s, kind, code, len(text))
        memory[_HEAD.size : _HEAD.size + len(text)] = text
        _HEAD.pack_into(memory, 0, self._number, began_s, kind, code, len(text))


def running_call(memory: mmap) -> RunningCall | None:
    """Returns the call that is under way in the process that notes them; None between calls, or while one is noted.

    The memory is written by a process that nobody trusts, so that whatever it holds is taken for what it can be.
    """
    number, began_s, kind, code, length = _HEAD.unpack_from(memory, 0)
    text = bytes(memory[_HEAD.size : _HEAD.size + min(length, _TEXT_BYTES)])
    if number % 2 or (number, began_s) != _HEAD.unpack_from(memory, 0)[:2] or not began_s > 0.0:
        return None
    seconds = max(0.0, time.monotonic() - began_s)
    return RunningCall(_KINDS[kind % len(_KINDS)], _CODES[code % len(_CODES)], text.decode("utf-8", "replace"), seconds)


class _Current:
    clock = CallClock()


def use_clock(clock: CallClock) -> None:
    """Notes all calls of this process with a clock from now on."""
    _Current.clock = clock


def timed_call(kind: CallKind, code: str, what: str) -> AbstractContextManager[None]:
    """Returns a ``with`` block that is noted by this process's clock; nothing is noted where no clock is used."""
    return _Current.clock.call(kind, code, what)
