"""How long steps took, told to the log: what `benchmarks/quickstart.py` makes its timeline of; and to who asks here."""

import logging
import time
from collections.abc import Generator
from contextlib import contextmanager
from threading import Lock

from tasks.progress.log_lines import chosen_log_format

logger = logging.getLogger(__name__)
_taken_s: dict[str, float] = {}
_turn = Lock()


@contextmanager
def log_duration(step: str) -> Generator[None, None, None]:
    """Tells the log how long the ``with`` block took: a program's log, as a person's is to tell a story in few lines.

    Args:
        step: What it does, as a name in code.
    """
    start_s = time.perf_counter()
    try:
        yield
    finally:
        seconds = time.perf_counter() - start_s
        with _turn:
            _taken_s[step] = _taken_s.get(step, 0.0) + seconds
        level = logging.DEBUG if chosen_log_format() is None else logging.INFO
        fields = {"step": step, "seconds": round(seconds, 3)}
        logger.log(level, "%s took %.1f s", step, seconds, extra={"fields": fields})


def taken_s(*steps: str) -> float:
    """Returns how long steps took in this process until now; those that are under way count when they have ended."""
    with _turn:
        return sum(_taken_s.get(step, 0.0) for step in steps)
