"""The stop of a robot's agent: by a signal, or because the process that started it is gone."""

import os
import signal
import threading
import time
from collections.abc import Callable
from types import FrameType

_SLICE_S = 0.05


class StopRequested(Exception):  # noqa: N818 - no error: the agent unwinds to its end, and resumes at the next start
    """The agent has to end now; whatever it was doing is taken up at its next start."""


class Stop:
    """Asked before everything that takes time.

    Args:
        parent: The process that must live, or None; compared with the parent this process has.
        meanwhile: Called many times a second while somebody waits.
    """

    def __init__(self, parent: int | None = None, meanwhile: Callable[[], None] = lambda: None) -> None:
        self._parent = parent
        self._meanwhile = meanwhile
        self._told = threading.Event()

    def listen(self) -> None:
        """Makes SIGTERM and SIGINT request the stop."""
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._on_signal)

    def request(self) -> None:
        """Requests the stop."""
        self._told.set()

    @property
    def requested(self) -> bool:
        """Whether the agent has to end."""
        return self._told.is_set() or (self._parent is not None and os.getppid() != self._parent)

    def check(self) -> None:
        """Does nothing while the agent may go on.

        Raises:
            StopRequested: It may not.
        """
        if self.requested:
            raise StopRequested

    def sleep(self, seconds: float) -> None:
        """Waits, but not beyond the end.

        Raises:
            StopRequested: The agent has to end.
        """
        until_s = time.monotonic() + seconds
        self.check()
        while (left_s := until_s - time.monotonic()) > 0:
            self._told.wait(min(left_s, _SLICE_S))
            self._meanwhile()
            self.check()

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        self._told.set()
