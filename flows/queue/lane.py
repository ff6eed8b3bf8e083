"""A lane: a warm process that works off the queued jobs of some kinds, one after the other or many at once.

Run as ``python -m flows.queue.lane LANE STORE`` by `flows.queue.supervisor`. A line on its input says that there is
work; the end of its input ends it, so that no lane outlives who started it.
"""

import contextlib
import logging
import os
import signal
import sys
import threading
from collections.abc import Callable
from importlib import import_module
from queue import Empty, SimpleQueue
from types import FrameType

from flows.queue.attempts import Attempts, Job
from flows.queue.supervisor import LANES, Lane, log_to_stderr
from specs.errors import StoreError
from tasks.server.watchdog import pause_collector
from tasks.simulate.devices import prepare_devices
from tasks.storage.base.store import Store
from tasks.storage.jobs.queue import QueueEntry, QueueView
from tasks.storage.store_url import open_store

LOOK_S = 2.0
_GRACE_S = 10.0
logger = logging.getLogger(__name__)


class Signals:
    """What a worker's process is told: that there is work, and that it is to end.

    A handler may interrupt whoever waits here. It may put news into a simple queue at any moment, but set no event,
    whose lock the one that it interrupts may hold.

    Attributes:
        ending: Whether it is to end.
    """

    def __init__(self) -> None:
        """Begins without either."""
        self.ending, self._news = False, SimpleQueue[None]()

    def end(self, _number: int = 0, _frame: FrameType | None = None) -> None:
        """Ends the process; a signal's handler."""
        self.ending = True
        self._news.put(None)

    def forget(self) -> None:
        """Forgets what was told of work until now."""
        with contextlib.suppress(Empty):
            while True:
                self._news.get_nowait()

    def wait(self) -> None:
        """Waits until something is told, or it is time to look without that."""
        with contextlib.suppress(Empty):
            self._news.get(timeout=LOOK_S)

    def listen(self, give_back: Callable[[], None]) -> None:
        """Reads standard input to its end; then the process has a little time to end by itself.

        Args:
            give_back: Called if it does not, right before it is ended.
        """
        while os.read(sys.stdin.fileno(), 4096):
            self._news.put(None)
        self.end()
        os.kill(os.getpid(), signal.SIGTERM)  # Prefect ends the flow run, if there is one, as Crashed
        timer = threading.Timer(_GRACE_S, lambda: (give_back(), os._exit(1)))
        timer.daemon = True
        timer.start()


def main(name: str, store_url: str) -> None:
    """Works until standard input ends.

    Args:
        name: Of the lane.
        store_url: Where the queue is.
    """
    lane, signals, store = LANES[name], Signals(), open_store(store_url)
    attempts = Attempts(store)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal's interrupt is for who started it
    threading.Thread(target=signals.listen, args=(attempts.give_back,), name="orders", daemon=True).start()
    work = _warm(lane, store)
    signal.signal(
        signal.SIGTERM, signals.end
    )  # before, it ends the process at once: imports take long, and nothing is begun
    logger.info("worker %d takes %s", os.getpid(), " and ".join(lane.kinds))
    try:
        _work(lane, store, attempts, work, signals)
    except BaseException:
        if not signals.ending:  # else it is how Prefect ends a flow run whose process is told to end
            raise
    finally:
        attempts.give_back()


def _warm(lane: Lane, store: Store) -> Callable[[Job], None]:
    """Imports what the lane needs, and returns what ends a job."""
    prepare_devices()  # before anything imports JAX
    with pause_collector():
        for module in lane.modules:
            import_module(module)
    from flows.queue.queued_flows import call_flow  # noqa: PLC0415 - Prefect, once the devices are prepared
    from tasks.server.health import is_answering  # noqa: PLC0415

    server = os.environ["PREFECT_API_URL"]
    return lambda job: call_flow(store, job, lambda: is_answering(server))


def _work(lane: Lane, store: Store, attempts: Attempts, work: Callable[[Job], None], signals: Signals) -> None:
    view, threads = QueueView(store, lane.kinds), dict[str, threading.Thread]()
    while not signals.ending:
        signals.forget()
        try:
            begun = _begin(lane, view, attempts, work, threads)
        except StoreError as exc:  # it may come back; nothing is lost by looking again
            logger.warning("the queue could not be looked at: %s", exc)
            begun = False
        if not begun:
            signals.wait()


def _begin(
    lane: Lane,
    view: QueueView,
    attempts: Attempts,
    work: Callable[[Job], None],
    threads: dict[str, threading.Thread],
) -> bool:
    """Returns whether a job was ended; where many are worked on at once, has begun those that are new."""
    if lane.at_once == 1:
        return any(attempts.attempt(entry, work) for entry in view.entries())
    for job in [job for job, thread in threads.items() if not thread.is_alive()]:
        del threads[job]
    for entry in view.entries():
        if entry.id not in threads and len(threads) < lane.at_once:
            thread = threading.Thread(target=_attempt, args=(attempts, entry, work), name=entry.id, daemon=True)
            threads[entry.id] = thread
            thread.start()
    return False


def _attempt(attempts: Attempts, entry: QueueEntry, work: Callable[[Job], None]) -> None:
    try:
        attempts.attempt(entry, work)
    except StoreError as exc:  # it is looked at again in two seconds
        logger.warning("%s could not be looked at: %s", entry.id, exc)


if __name__ == "__main__":
    log_to_stderr()
    main(sys.argv[1], sys.argv[2])
