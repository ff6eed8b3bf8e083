"""The seconds that JAX takes to trace, lower and compile programs, or to load what was compiled, by thread.

JAX tells of each such time at its end. A function that is traced within another one is told of first, and again as part
of the other, so that times are added up as intervals.
"""

import threading
import time
from collections.abc import Callable

# JAX's own: `jax/core/compile/` has tracing, lowering, and the compiler or its cache (`jax/_src/dispatch.py`).
_COMPILING = "/jax/core/compile/"
# A program's times follow one another closely: what began longer ago holds none of those to come.
_INTERVALS_KEPT = 256


class CompileClock:
    """Adds up intervals that lie apart or within one another, told by their ends."""

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        """Begins at zero.

        Args:
            now_s: The time.
        """
        self._now_s = now_s
        self._apart: list[tuple[float, float]] = []
        self.seconds = 0.0

    def tell(self, event: str, duration_secs: float, **_: object) -> None:
        """Adds an interval that ends now, if it is one of compiling."""
        if not event.startswith(_COMPILING):
            return
        end_s = self._now_s()
        begin_s = end_s - duration_secs
        while self._apart and self._apart[-1][0] >= begin_s:
            inner_begin_s, inner_end_s = self._apart.pop()
            self.seconds -= inner_end_s - inner_begin_s
        if self._apart:  # clocks are read a little later than JAX reads them
            begin_s = max(begin_s, self._apart[-1][1])
        self._apart = [*self._apart[1 - _INTERVALS_KEPT :], (begin_s, end_s)]
        self.seconds += end_s - begin_s


class _OfThread(threading.local):
    clock: CompileClock | None = None


_of_thread, _listening, _turn = _OfThread(), threading.Event(), threading.Lock()


def compiled_s() -> float:
    """Returns the seconds that this thread has spent so since it asked first; JAX is imported then."""
    clock = _of_thread.clock
    if clock is None:
        clock = _of_thread.clock = CompileClock()
        _listen()
    return clock.seconds


def running_s() -> float:
    """Returns a clock's time that stands still while this thread compiles something; of each thread another."""
    return time.monotonic() - compiled_s()


def _listen() -> None:
    """Lets JAX tell this process of its times, once."""
    import jax.monitoring  # noqa: PLC0415 - the flow's process reads timings without JAX

    with _turn:
        if not _listening.is_set():
            jax.monitoring.register_event_duration_secs_listener(_tell_thread)
            _listening.set()


def _tell_thread(event: str, duration_secs: float, **more: str | int) -> None:
    """Tells the clock of the thread that compiled, which is the one that JAX calls."""
    if _of_thread.clock is not None:
        _of_thread.clock.tell(event, duration_secs, **more)
