"""How long steps took, told to the log: what `benchmarks/quickstart.py` makes its timeline of."""

import logging
import time
from collections.abc import Generator
from contextlib import contextmanager

from tasks.progress.log_lines import chosen_log_format

logger = logging.getLogger(__name__)


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
        level = logging.DEBUG if chosen_log_format() is None else logging.INFO
        fields = {"step": step, "seconds": round(seconds, 3)}
        logger.log(level, "%s took %.1f s", step, seconds, extra={"fields": fields})
