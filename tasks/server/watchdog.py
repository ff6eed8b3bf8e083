"""Ends a run whose server went away: Prefect's client would ask it again, in silence, for minutes."""

import gc
import signal
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass, field

from specs.errors import SimyardError, StageFailed


@contextmanager
def pause_collector() -> Generator[None, None, None]:
    """Makes no collection in the block, and none ever of what the block has made; for a process that imports once.

    Modules, classes and models stay until the process ends. A collection finds no garbage in them, and one of all of
    Prefect's takes a tenth of a second (docs/reference/prefect.md, section 2).
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        if enabled:
            gc.enable()


@dataclass(frozen=True)
class WatchdogPace:
    """How often a watchdog looks, and how long it waits, in seconds.

    Attributes:
        look_s: Between two looks at the server.
        patience_s: How long the server may be away, by this process's own monotonic clock.
        grace_s: How long the main thread may take to leave once it is interrupted.
    """

    look_s: float = 2.0
    patience_s: float = 20.0
    grace_s: float = 5.0


@dataclass(frozen=True)
class WatchdogState:
    """What a watchdog and the block that it guards know of each other.

    Attributes:
        is_there: Whether the server answers.
        gone: Set when the server is given up.
        left: Set when the block has ended.
    """

    is_there: Callable[[], bool]
    gone: threading.Event = field(default_factory=threading.Event)
    left: threading.Event = field(default_factory=threading.Event)
    deciding: threading.Lock = field(default_factory=threading.Lock)


@contextmanager
def guard_run(
    is_there: Callable[[], bool], reason: str, give_up: Callable[[StageFailed], None], pace: WatchdogPace | None = None
) -> Generator[WatchdogState, None, None]:
    """Interrupts the block when its server is gone; for the main thread, which alone can be interrupted.

    Args:
        is_there: Whether the server answers.
        reason: What to tell when it does not.
        give_up: Called from another thread when the block goes on in spite of the interrupt; is to end the process.
        pace: How often and how long to look.

    Raises:
        StageFailed: The server is gone, whatever the block made of that.
    """
    watch = WatchdogState(is_there)
    failure = StageFailed("InternalServiceError", reason)
    chosen = pace or WatchdogPace()
    threading.Thread(
        target=_look_after, args=(watch, chosen, lambda: give_up(failure)), name="simyard watchdog", daemon=True
    ).start()
    try:
        yield watch
    except BaseException as exc:
        # The interrupt itself, or an exception of Prefect's client that came before it.
        if watch.gone.is_set() or (_is_unexplained(exc) and not is_there()):
            watch.gone.set()
            raise failure from exc
        raise
    finally:
        with watch.deciding:
            watch.left.set()


def _look_after(watch: WatchdogState, pace: WatchdogPace, give_up: Callable[[], None]) -> None:
    if not _is_lost(watch, pace):
        return
    with watch.deciding:
        if watch.left.is_set():
            return
        watch.gone.set()
        main = threading.main_thread().ident
        if main is not None:
            signal.pthread_kill(main, signal.SIGINT)
    if not watch.left.wait(pace.grace_s):
        give_up()


def _is_lost(watch: WatchdogState, pace: WatchdogPace) -> bool:
    """Returns True once the server was away for too long, or False when the block has ended."""
    away_since_s: float | None = None
    while not watch.left.wait(pace.look_s):
        if watch.is_there():
            away_since_s = None
            continue
        now_s = time.monotonic()
        away_since_s = now_s if away_since_s is None else away_since_s
        if now_s - away_since_s >= pace.patience_s:
            return True
    return False


def _is_unexplained(exc: BaseException) -> bool:
    return isinstance(exc, Exception) and not isinstance(exc, SimyardError)
