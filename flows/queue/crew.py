"""The gateway's own workers: a foreman in a process of its own, told of work over a pipe, begun again if it dies.

The queue is in the store, so that nothing is lost with a worker or with the gateway. The end of the pipe ends the
foreman and its lanes, however the gateway ends.
"""

import logging
import os
import subprocess
import sys
import threading
import time
from types import TracebackType

_SHORT_LIFE_S = 5.0
_FIRST_PAUSE_S = 0.5
_LONGEST_PAUSE_S = 10.0
_END_S = 15.0
_CREW_END_S = 40.0  # the lanes' own, and then that of a Prefect server
logger = logging.getLogger(__name__)


class KeptProcess:
    """A process that is begun again whenever it ends, until it is told to end.

    Args:
        command: What runs in it; it ends when its input does.
        name: For the log.
        end_s: How long it may take to end before it is killed.
    """

    def __init__(self, command: list[str], name: str, end_s: float = _END_S) -> None:
        self._command, self._name, self._end_s = command, name, end_s
        self._ending = threading.Event()
        self._lock = threading.Lock()
        self._process = self._start()
        self._keeper = threading.Thread(target=self._keep, name=f"keeper of {name}", daemon=True)
        self._keeper.start()

    @property
    def pid(self) -> int:
        """The number of the process, or of the last one."""
        return self._process.pid

    def wake(self) -> None:
        """Tells the process that there is work; one that is just beginning looks anyway."""
        with self._lock:
            _write_line(self._process)

    def end(self) -> None:
        """Closes the input of the process, and waits for it to end; kills one that does not."""
        self._ending.set()
        with self._lock:
            _close_input(self._process)
        try:
            self._process.wait(self._end_s)
        except subprocess.TimeoutExpired:
            logger.warning("%s did not end, and is killed", self._name)
            self._process.kill()
            self._process.wait()

    def _start(self) -> subprocess.Popen[bytes]:
        # A terminal's interrupt is for who started this; the end of its input reaches the process.
        process = subprocess.Popen(  # noqa: S603 - a list built here, no shell
            self._command, stdin=subprocess.PIPE, bufsize=0, start_new_session=True
        )
        if process.stdin:
            os.set_blocking(process.stdin.fileno(), False)  # one that does not read shall hold up nobody
        return process

    def _keep(self) -> None:
        pause_s = _FIRST_PAUSE_S
        while True:
            began_s = time.monotonic()
            status = self._process.wait()
            if self._ending.is_set():
                return
            pause_s = (
                _FIRST_PAUSE_S if time.monotonic() - began_s > _SHORT_LIFE_S else min(2 * pause_s, _LONGEST_PAUSE_S)
            )
            logger.warning("%s ended with %d, and begins again in %.1f s", self._name, status, pause_s)
            if self._ending.wait(pause_s):
                return
            with self._lock:
                if self._ending.is_set():
                    return
                _close_input(self._process)
                self._process = self._start()


def _write_line(process: subprocess.Popen[bytes]) -> None:
    try:
        if process.stdin:
            process.stdin.write(b"\n")
            process.stdin.flush()
    except (BrokenPipeError, BlockingIOError, ValueError):  # it has ended, or has lines enough
        return


def _close_input(process: subprocess.Popen[bytes]) -> None:
    try:
        if process.stdin:
            process.stdin.close()
    except (BrokenPipeError, BlockingIOError):
        return


class Crew:
    """Works off the queue of a store inside a ``with`` block.

    Args:
        store_url: Where the queue is.
        workers: How many jobs of a lane are worked on at once; 0 for none, because workers elsewhere do.
        pool: Prefect's work pool to which jobs are handed instead; empty for none.
    """

    def __init__(self, store_url: str, workers: int = 1, pool: str = "") -> None:
        arguments = [store_url, str(workers), *([pool] if pool else [])]
        self._command = [sys.executable, "-m", "flows.queue.foreman", *arguments] if workers or pool else []
        self._foreman: KeptProcess | None = None

    def __enter__(self) -> "Crew":
        """Starts the workers, which are warm some seconds later."""
        if self._command:
            self._foreman = KeptProcess(self._command, "the foreman of the workers", _CREW_END_S)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, exc: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Ends the workers; what they are at is continued next time."""
        if self._foreman:
            self._foreman.end()

    def wake(self) -> None:
        """Tells the workers that there is work."""
        if self._foreman:
            self._foreman.wake()
