"""The seconds that JAX takes to trace, lower and compile programs, or to load what was compiled, in this process.

JAX tells of each such time at its end. A function that is traced within another one is told of first, and again as part
of the other, so that times are added up as intervals.
"""

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
        """Adds an interval that ends now, if it is one of compiling: JAX calls this."""
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


_of_this_process: list[CompileClock] = []


def compiled_s() -> float:
    """Returns the seconds that this process has spent so since it asked first; JAX is imported then."""
    if not _of_this_process:
        import jax.monitoring  # noqa: PLC0415 - the flow's process reads timings without JAX

        clock = CompileClock()
        jax.monitoring.register_event_duration_secs_listener(clock.tell)
        _of_this_process.append(clock)
    return _of_this_process[0].seconds


def running_s() -> float:
    """Returns a clock's time that stands still while something is compiled."""
    return time.monotonic() - compiled_s()
