"""Waiting for what another thread or process will do."""

import time
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


def eventually(holds: Callable[[], T], timeout_s: float = 120.0) -> T:
    """Returns the first true answer.

    Raises:
        AssertionError: There is none for so long that there will be none.
    """
    deadline_s = time.monotonic() + timeout_s
    while not (value := holds()):
        assert time.monotonic() < deadline_s, "it never held"
        time.sleep(0.02)
    return value
