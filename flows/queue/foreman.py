"""The foreman: starts the lanes of a worker, begins a lane again that died, passes on that there is work.

Run by `simyard worker`, or as ``python -m flows.queue.foreman STORE WORKERS [POOL]`` by a gateway. Prefect's server is
the user's, the kept one, or one of the foreman's own, which all lanes share. It imports neither Prefect nor JAX.
"""

import logging
import os
import signal
import sys
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import NoReturn

from flows.queue.crew import KeptProcess
from flows.queue.lanes import LANES
from flows.queue.worker_log import log_to_stderr
from flows.server.prefect_server import ServerChoice, known_server, prefect_server
from specs.base import Fault
from specs.errors import DocumentError, SimyardError, StageFailed
from tasks.server.health import is_listening, url_without_password
from tasks.server.watchdog import WatchdogPace, guard_run

logger = logging.getLogger(__name__)


def lead(store_url: str, workers: int, pool: str, wait: Callable[[Callable[[], None]], None]) -> None:
    """Works off the queue of a store until the waiting is over.

    Args:
        store_url: Where the queue is.
        workers: How many jobs of a lane are worked on at once on this machine.
        pool: Prefect's work pool to which jobs are handed instead; empty for none.
        wait: Returns when it is time to end; is given what tells the lanes that there is work.

    Raises:
        DocumentError: A pool is named, and there is no Prefect server that stays.
        StageFailed: Prefect's server does not come up, or goes away.
    """
    if pool:
        require_lasting_server(pool)
    with prefect_server() as server, _server_guard(server), _lanes(store_url, workers, pool) as lanes:
        wait(lambda: _wake(lanes))


def _wake(lanes: list[KeptProcess]) -> None:
    for lane in lanes:
        lane.wake()


def require_lasting_server(pool: str) -> None:
    """Does nothing where there is a Prefect server that other machines and later programs know.

    Raises:
        DocumentError: There is none.
    """
    with known_server() as url:
        if not url:
            allowed = "a work pool of a server that stays: set PREFECT_API_URL, or simyard up"
            raise DocumentError([Fault(path="--pool", value=repr(pool), allowed=allowed)], "command")


@contextmanager
def _lanes(store_url: str, workers: int, pool: str) -> Generator[list[KeptProcess], None, None]:
    os.environ.setdefault("PREFECT_LOGGING_HANDLERS_CONSOLE_LEVEL", "CRITICAL")  # what a flow run says is on its page
    lanes: list[KeptProcess] = []
    try:
        if pool:
            command = [sys.executable, "-m", "flows.queue.pool", pool, store_url]
            lanes.append(KeptProcess(command, f"what hands jobs to {pool}"))
        for name, lane in {} if pool else LANES.items():
            for _ in range(workers if lane.per_worker else 1):
                command = [sys.executable, "-m", "flows.queue.lane", name, store_url]
                lanes.append(KeptProcess(command, f"the worker for {name}"))
        yield lanes
    finally:
        ends = [threading.Thread(target=lane.end) for lane in lanes]
        for end in ends:
            end.start()
        for end in ends:
            end.join()


@contextmanager
def _server_guard(server: ServerChoice) -> Generator[None, None, None]:
    reason = f"the Prefect server at {url_without_password(server.api_url)} went away; queued jobs wait in the store"

    def leave(failure: StageFailed) -> None:
        logger.error("%s", failure)
        os._exit(3)

    with guard_run(lambda: is_listening(server.api_url), reason, leave, WatchdogPace(patience_s=server.wait_s)):
        yield


def wait_for_ever(_wake: Callable[[], None]) -> None:
    """Waits until a signal ends it; the lanes look by themselves."""
    threading.Event().wait()


class Orders:
    """What a gateway sends over standard input: lines that say that there is work, and its own end."""

    def __init__(self) -> None:
        self._wake: Callable[[], None] = lambda: None
        self._end = threading.Event()
        signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it
        threading.Thread(target=self._listen, name="orders", daemon=True).start()

    def wait(self, wake: Callable[[], None]) -> None:
        """Wakes the lanes at each line; the end interrupts it, as it does the start of a server before."""
        self._wake = wake
        self._end.wait()  # an interrupt before may have met something that swallowed it

    def _listen(self) -> None:
        while os.read(sys.stdin.fileno(), 4096):
            self._wake()
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
        self._end.set()  # after it, so that the interrupt never meets what ends the lanes


def _main(arguments: list[str]) -> NoReturn:
    log_to_stderr()
    store_url, workers, *pool = arguments
    try:
        lead(store_url, int(workers), "".join(pool), Orders().wait)
    except KeyboardInterrupt:
        sys.exit(0)
    except SimyardError as exc:
        sys.exit(str(exc))
    sys.exit(0)


if __name__ == "__main__":
    _main(sys.argv[1:])
