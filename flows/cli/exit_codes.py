"""Exit codes of `simyard`, the message that goes with each, and the answer to signals.

0: done and passed. 1: not passed: the gate says FAIL, the deployment failed, a replay deviates, or a batch is worse
than another. 2: a bad document or command. 3: a stage failed, or Simyard has a defect. 4: INCONCLUSIVE: a gate or a
comparison has too few episodes to say. 130 and 143: interrupted. Nothing else ends with 1 or 4, so that a script can
tell a verdict from an accident, and a bad robot from a small batch.
"""

import atexit
import logging
import os
import signal
import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from select import select
from threading import Event, Lock, Thread
from types import FrameType
from typing import NoReturn

from rich.text import Text

from flows.cli.output import TerminalConsole
from specs.errors import NO_SOURCE, DocumentError, PipelineNotPassed, SimyardError
from tasks.storage.base.disk_space import NO_ROOM, full_machine_message

NOT_PASSED, REFUSED, FAILED, UNDECIDED = 1, 2, 3, 4
_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_INTERRUPTED = tuple(128 + number for number in _SIGNALS)
_GO_ON = "interrupted; the same command continues this run if the document is unchanged"
# Agents, the server and Prefect's last messages may take this long to come to their end.
_GRACE_S = 30.0
# One Ctrl-C may come twice, from the terminal and from a program that simyard was started by.
_SAME_KEY_S = 0.5


def exit_code_of(failure: Exception) -> int:
    """Returns the exit code of a command that this ends."""
    if isinstance(failure, PipelineNotPassed):
        return UNDECIDED if failure.report.undecided else NOT_PASSED
    return REFUSED if isinstance(failure, DocumentError) else FAILED


def run_and_exit(command: Callable[[], object], grace_s: float = _GRACE_S) -> NoReturn:
    """Runs a command and ends the process with Simyard's exit code; writes one message to stderr if it fails.

    Args:
        command: May end the process itself, as the parser does after a usage error.
        grace_s: How long an interrupted command may take to leave before the process is ended under it.
    """
    for number in _SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:  # as in `nohup` and for jobs in a script's background
            signal.signal(number, _on_signal)
    with _watch_signals(grace_s) as heard:
        code = _exit_code(command, heard)
    sys.exit(code)


def run_and_end_process(command: Callable[[], object], grace_s: float = _GRACE_S) -> NoReturn:
    """Does what ``run_and_exit`` does, and ends the process soon after, for its outermost frame."""
    codes: list[int] = []
    atexit.register(_end_unfreed, codes)  # before any library registers what it does at the exit, so that this is last
    try:
        run_and_exit(command, grace_s)
    except SystemExit as exc:
        codes.append(exc.code if isinstance(exc.code, int) else int(exc.code is not None))
        _guard_shutdown(codes[0], grace_s)
        raise


def _end_unfreed(codes: list[int]) -> None:
    """Ends the process when all else is done: to free each object of Prefect's takes half a second of the processor."""
    try:
        logging.shutdown()
        sys.stdout.flush()
        sys.stderr.flush()
    except (OSError, ValueError, AttributeError):  # Python itself has an exit code for that
        return
    for code in codes:
        os._exit(code)


def _guard_shutdown(code: int, grace_s: float) -> None:
    """Ends the process soon, even if a thread of a library never ends, such as one that polls a dead server."""

    def end() -> None:
        time.sleep(grace_s)
        os._exit(code)

    Thread(target=end, name="simyard shutdown", daemon=True).start()


def _exit_code(command: Callable[[], object], heard: Callable[[], int | None]) -> int:
    try:
        command()
    except SimyardError as exc:
        return _fail(_complaint(exc), exit_code_of(exc))
    except BaseException as exc:  # the outermost frame: Python would exit with 1, which means a failed gate
        if isinstance(exc, SystemExit) and exc.code not in _INTERRUPTED:
            raise
        number = heard()
        if number is not None:  # Prefect answers signals with exceptions of its own
            return _fail(_GO_ON, 128 + number)
        if not isinstance(exc, Exception):
            raise
        return _fail(_accident(exc), FAILED)
    return 0


def _complaint(exc: SimyardError) -> str:
    """Returns the error; faults of no document without the heading of one."""
    if isinstance(exc, DocumentError) and exc.source == NO_SOURCE:
        return "\n".join(map(str, exc.faults))
    return str(exc)


def _accident(exc: Exception) -> str:
    if isinstance(exc, OSError) and exc.errno in NO_ROOM:
        return full_machine_message(exc)
    return _defect(exc)


def _defect(exc: Exception) -> str:
    if os.environ.get("SIMYARD_DEBUG") == "1":
        TerminalConsole(stderr=True).print_exception()
    what = " ".join(f"{type(exc).__name__}: {exc}".split())
    return f"this is a defect of Simyard: {what} (SIMYARD_DEBUG=1 shows where)"


def _on_signal(number: int, _frame: FrameType | None) -> NoReturn:
    # Not KeyboardInterrupt: the parser takes that for itself and says nothing.
    raise SystemExit(128 + number)


@contextmanager
def _watch_signals(grace_s: float) -> Generator[Callable[[], int | None], None, None]:
    """Yields a function that returns the last signal of ours that came.

    Ends the process if the block goes on for long after one, or at once when Ctrl-C comes again.

    A handler's exception may be caught, and Prefect puts handlers of its own in place of ours; but Python writes the
    number of each signal to a pipe, and this reads it there.
    """
    reading, writing = os.pipe()
    os.set_blocking(reading, False)
    os.set_blocking(writing, False)
    hearing = _SignalPipe(reading)
    watching = Thread(target=hearing.watch, args=(grace_s,), name="simyard signals", daemon=True)
    before = signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    watching.start()
    try:
        yield hearing.last
    finally:
        hearing.left.set()
        signal.set_wakeup_fd(before)
        with suppress(BlockingIOError):
            os.write(writing, b"\0")  # wakes the thread, so that it ends
        watching.join()
        os.close(reading)
        os.close(writing)


class _SignalPipe:
    """The signals that came, read from a pipe by the first thread that asks."""

    def __init__(self, pipe: int) -> None:
        self.left = Event()
        self._pipe, self._numbers, self._one_reads = pipe, list[int](), Lock()

    def last(self) -> int | None:
        with self._one_reads, suppress(BlockingIOError):
            self._numbers += [number for number in os.read(self._pipe, 1 << 12) if number in _SIGNALS]
        return self._numbers[-1] if self._numbers else None

    def watch(self, grace_s: float) -> None:
        while self.last() is None and not self.left.is_set():
            select([self._pipe], [], [])
        end_s = time.monotonic() + grace_s
        self.left.wait(_SAME_KEY_S)
        self.last()
        keys = self._numbers.count(signal.SIGINT)
        while not self.left.is_set():
            ready = select([self._pipe], [], [], max(0.0, end_s - time.monotonic()))[0]
            number = self.last()
            # Only Ctrl-C is impatience: Prefect sends its process each SIGTERM once more.
            again = self._numbers.count(signal.SIGINT) > keys
            if number is not None and not self.left.is_set() and (again or not ready):
                _end_now(number)


def _end_now(number: int) -> None:
    sys.stderr.write(f"\n{_GO_ON}\n")
    sys.stderr.flush()
    os._exit(128 + number)


def _fail(about: object, code: int) -> int:
    _complain(about)
    return code


def _complain(about: object) -> None:
    TerminalConsole(stderr=True).print(Text(str(about), style="red"), soft_wrap=True)
