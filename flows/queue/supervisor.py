"""The supervisor: starts the lanes of a worker, begins a lane again that died, passes on that there is work.

Run by `simyard worker`, or as ``python -m flows.queue.supervisor STORE WORKERS [POOL]`` by a gateway. Prefect's server
is the user's, the kept one, or one of the supervisor's own, which all lanes share. It imports neither Prefect nor JAX.

A gateway's own workers are a supervisor in a process of its own, told of work over a pipe, begun again if it dies. The
queue is in the store, so that nothing is lost with a worker or with the gateway. The end of the pipe ends the
supervisor and its lanes, however the gateway ends.
"""

import logging
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from types import TracebackType
from typing import NamedTuple, NoReturn

from flows.prefect.prefect_server import ServerChoice, known_server, prefect_server
from specs.errors import DocumentError, SimyardError, StageFailed
from specs.job_kinds import JobKind
from specs.settings import WORKS_FOR_OTHERS
from specs.untrusted_text import terminal_text
from tasks.progress.log_lines import LOGGERS, EventLines, chosen_log_format
from tasks.server.health import is_listening, url_without_password
from tasks.server.watchdog import WatchdogPace, guard_run

_PREFECT = ("flows.queue.queued_flows", "prefect.flow_engine", "prefect.task_engine", "prefect.utilities.visualization")
_SHORT_LIFE_S = 5.0
_FIRST_PAUSE_S = 0.5
_LONGEST_PAUSE_S = 10.0
_END_S = 15.0
_WORKERS_END_S = 40.0  # the lanes' own, and then that of a Prefect server
logger = logging.getLogger(__name__)


class _PlainLines(logging.Formatter):
    """An event as a line with its time and level, in which no text from a document moves the cursor."""

    def format(self, record: logging.LogRecord) -> str:
        return terminal_text(super().format(record))


def log_to_stderr() -> None:
    """Writes what Simyard logs in this process to stderr from now on; what Prefect says is on the pages of its runs.

    Raises:
        DocumentError: SIMYARD_LOG_FORMAT asks for a format that there is not.
    """
    form = chosen_log_format()
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(EventLines(form) if form else _PlainLines("%(asctime)s %(levelname)s %(message)s"))
    for logger in map(logging.getLogger, LOGGERS):
        logger.addHandler(handler)
        logger.setLevel(logging.INFO)
        logger.propagate = False


class Lane(NamedTuple):
    """What a lane works on.

    Attributes:
        kinds: Of its jobs.
        at_once: How many jobs it works on at once; 1 where a job wants the machine.
        modules: What is imported before the first job comes.
        per_worker: Whether each worker has one; otherwise one does for all.
    """

    kinds: tuple[JobKind, ...]
    at_once: int
    modules: tuple[str, ...]
    per_worker: bool


# A roll-out waits for robots most of the time, and a batch may take hours: neither has to wait for the other, nor
# worlds for a batch. They share the cores as processes do.
LANES: Mapping[str, Lane] = {
    "simulation": Lane(
        ("simulation-job-batch",),
        1,
        ("tasks.simulate.chunk.chunk_simulation", "pyarrow.parquet", *_PREFECT),
        per_worker=True,
    ),
    "worlds": Lane(("world-generation-job", "world-export-job"), 1, ("scipy.ndimage", *_PREFECT), per_worker=True),
    "fleets": Lane(("deployment-job",), 64, _PREFECT, per_worker=False),
}


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


class QueueWorkers:
    """Works off the queue of a store inside a ``with`` block.

    Args:
        store_url: Where the queue is.
        workers: How many jobs of a lane are worked on at once; 0 for none, because workers elsewhere do.
        pool: Prefect's work pool to which jobs are handed instead; empty for none.
    """

    def __init__(self, store_url: str, workers: int = 1, pool: str = "") -> None:
        arguments = [store_url, str(workers), *([pool] if pool else [])]
        self._command = [sys.executable, "-m", "flows.queue.supervisor", *arguments] if workers or pool else []
        self._supervisor: KeptProcess | None = None

    def __enter__(self) -> "QueueWorkers":
        """Starts the workers, which are warm some seconds later."""
        if self._command:
            self._supervisor = KeptProcess(self._command, "the supervisor of the workers", _WORKERS_END_S)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, exc: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Ends the workers; what they are at is continued next time."""
        if self._supervisor:
            self._supervisor.end()

    def wake(self) -> None:
        """Tells the workers that there is work."""
        if self._supervisor:
            self._supervisor.wake()


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
            raise DocumentError.of("--pool", repr(pool), allowed, source="command")


@contextmanager
def _lanes(store_url: str, workers: int, pool: str) -> Generator[list[KeptProcess], None, None]:
    os.environ.setdefault("PREFECT_LOGGING_HANDLERS_CONSOLE_LEVEL", "CRITICAL")  # what a flow run says is on its page
    os.environ[WORKS_FOR_OTHERS] = "1"
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
