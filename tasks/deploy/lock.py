"""The lock on a robot's folder: who has it alone may start what runs there, and end it."""

import fcntl
import os
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

LOCK = "agent.lock"


@contextmanager
def locking(root: Path) -> Generator[Callable[[], bool]]:
    """Yields what tries to take the lock and tells whether this process has it, until the end of the block.

    The kernel frees the lock when its holder dies.

    Args:
        root: The robot's folder, which exists.
    """
    descriptor = os.open(root / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        yield lambda: _locked(descriptor)
    finally:
        os.close(descriptor)


def _locked(descriptor: int) -> bool:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
