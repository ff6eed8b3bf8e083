"""The listener that hears how far a stage is: a context variable, so that no flow needs a parameter for it."""

import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from contextvars import ContextVar

Listener = Callable[[str, int, int], None]
Progress = Callable[[int, int], None]
_INTERVAL_S = 1.0


def _nobody(stage: str, done: int, total: int) -> None:
    """Drops what is told: nobody watches."""


_listener: ContextVar[Listener] = ContextVar("simyard_progress_listener", default=_nobody)


@contextmanager
def listen_to_progress(listener: Listener) -> Generator[None, None, None]:
    """Lets the listener hear of progress inside the ``with`` block.

    Args:
        listener: Called with the stage's name, units done, and units in all.
    """
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def current_listener() -> Listener:
    """Returns the listener of this context."""
    return _listener.get()


def report_progress(stage: str, done: int, total: int) -> None:
    """Tells the listener of this context how far a stage is."""
    _listener.get()(stage, done, total)


def stage_progress(stage: str) -> Progress:
    """Returns a function that tells how far a stage is: units done and in all, once a second at most, and the end.

    Args:
        stage: What a person calls it, such as ``Worlds``.
    """
    told_s = -_INTERVAL_S

    def progress(done: int, total: int) -> None:
        nonlocal told_s
        if done >= total or time.monotonic() - told_s >= _INTERVAL_S:
            told_s = time.monotonic()
            report_progress(stage, done, total)

    return progress
