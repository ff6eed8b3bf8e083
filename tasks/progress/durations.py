"""How long steps took, told to the log: what `benchmarks/quickstart.py` makes its timeline of."""

import logging
import time
from collections.abc import Generator
from contextlib import contextmanager

logger = logging.getLogger(__name__)


@contextmanager
def log_duration(step: str) -> Generator[None, None, None]:
    """Tells the log how long the ``with`` block took.

    Args:
        step: What it does, as a name in code.
    """
    start_s = time.perf_counter()
    try:
        yield
    finally:
        seconds = time.perf_counter() - start_s
        logger.info("%s took %.1f s", step, seconds, extra={"fields": {"step": step, "seconds": round(seconds, 3)}})
