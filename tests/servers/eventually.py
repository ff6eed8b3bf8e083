"""Waiting for what another thread or process will do."""

import time
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


def eventually(holds: Callable[[], T | None], *, every_s: float = 0.01) -> T:
    """Returns the first true answer; the suite's limit ends a test in which there is none."""
    while not (value := holds()):
        time.sleep(every_s)
    return value
