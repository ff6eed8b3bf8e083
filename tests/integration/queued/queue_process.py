"""A gateway's workers as a process, its lanes, and the queue's end."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from tasks.storage.base.store import Store
from tasks.storage.jobs.queue import queued_jobs
from tests.repository import ROOT

_GATEWAY = (
    "import sys; from flows.queue.supervisor import QueueWorkers\nwith QueueWorkers(sys.argv[1]): sys.stdin.read()"
)


class QueueProcess:
    """A process that has workers, as `simyard serve` has; nobody asks it anything.

    Args:
        store: Whose queue it works off.
        log: Where what it says goes.
    """

    def __init__(self, store: Store, log: Path) -> None:
        self._store, self._log = store, log
        self.process = self._start()

    def _start(self) -> subprocess.Popen[bytes]:
        with self._log.open("ab") as log:
            return subprocess.Popen(
                [sys.executable, "-c", _GATEWAY, self._store.url],
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=log,
                env={**os.environ, "PYTHONPATH": str(ROOT)},
            )

    def kill(self) -> bool:
        """Kills it, and starts another one; returns that it was there."""
        self.process.kill()
        self._close()
        self.process = self._start()
        return True

    def end(self) -> None:
        """Ends it as Ctrl-C ends a gateway."""
        self._close()

    def _close(self) -> None:
        if self.process.stdin:
            self.process.stdin.close()
        self.process.wait()


@contextmanager
def workers_at(store: Store, folder: Path) -> Generator[QueueProcess]:
    """Yields workers that work off a store's queue inside the ``with`` block."""
    workers = QueueProcess(store, folder / "workers.log")
    try:
        yield workers
    finally:
        workers.end()


def lane_pids(store: Store, name: str) -> list[int]:
    """Returns the processes of a lane of this machine that work off a store's queue."""
    wanted = f"flows.queue.lane\0{name}\0{store.url}\0".encode()
    return [int(path.parent.name) for path in Path("/proc").glob("[0-9]*/cmdline") if wanted in _bytes(path)]


def kill_lane(store: Store, name: str) -> bool:
    """Returns whether there was a process of a lane, which is killed."""
    pids = lane_pids(store, name)
    for pid in pids:
        os.kill(pid, signal.SIGKILL)
    return bool(pids)


def wait_until_done(store: Store) -> None:
    """Returns once the queue is empty."""
    while queued_jobs(store):
        time.sleep(0.1)


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError:  # it has ended
        return b""
