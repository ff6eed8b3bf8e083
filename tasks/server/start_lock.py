"""One server at a time starts on a database: two that migrate an empty one at once break each other."""

import fcntl
import logging
import time
from collections.abc import Callable
from pathlib import Path
from threading import Thread
from typing import IO

logger = logging.getLogger(__name__)

LOCK = "starting.lock"
_INTERVAL_S = 0.1


def take_turn(home: Path, timeout_s: float) -> IO[bytes]:
    """Returns the lock of a database's folder, held; closing it, or the end of this process, lets the next one start.

    Args:
        home: The folder; made where it is missing.
        timeout_s: How long to wait for another's start. It has failed by then, so this one goes ahead beside it.
    """
    home.mkdir(mode=0o700, parents=True, exist_ok=True)
    lock = (home / LOCK).open("ab")
    deadline_s = time.monotonic() + timeout_s
    while not _held(lock):
        if time.monotonic() > deadline_s:
            logger.warning("another start took longer than %.0f s; starting beside it", timeout_s)
            break
        time.sleep(_INTERVAL_S)
    return lock


def end_turn_when(lock: IO[bytes], started: Callable[[], bool], timeout_s: float) -> None:
    """Closes the lock, from a thread, once a start is over or has taken so many seconds."""

    def wait() -> None:
        deadline_s = time.monotonic() + timeout_s
        with lock:
            while time.monotonic() < deadline_s and not started():
                time.sleep(_INTERVAL_S)

    Thread(target=wait, name="simyard start", daemon=True).start()


def _held(lock: IO[bytes]) -> bool:
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
