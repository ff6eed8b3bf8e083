"""The listener that hears how far a stage is: a context variable, so that no flow needs a parameter for it."""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from contextvars import ContextVar

Listener = Callable[[str, int, int], None]


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


def report_progress(stage: str, done: int, total: int) -> None:
    """Tells the listener of this context how far a stage is."""
    _listener.get()(stage, done, total)
