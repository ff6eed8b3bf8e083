"""Two pieces of work at a time, of one process: stages of a run, or parts of one."""

from collections.abc import Callable
from concurrent.futures import Future
from contextvars import copy_context
from threading import Thread
from typing import TypeVar

R = TypeVar("R")
S = TypeVar("S")
# What is done beside has so long to end after an interrupt.
_INTERRUPTED_S = 3.0


def at_a_time(beside: Callable[[], S], work: Callable[[], R]) -> tuple[S, R]:
    """Returns what two pieces of work return that need nothing of each other, and are done at the same time.

    Both come to their ends, also when one fails. An interrupt waits a few seconds for the one beside: what it tells
    Prefect after the server has ended would be lost, and complained about after the last message.

    Args:
        beside: What a thread of its own does, in this context.
        work: What this thread does.

    Raises:
        Exception: What the first raised, or else what the second did.
    """
    ended: Future[S] = Future()

    def run() -> None:
        try:
            ended.set_result(beside())
        except BaseException as exc:  # noqa: BLE001 - raised below
            ended.set_exception(exc)

    thread = Thread(target=copy_context().run, args=(run,), name="simyard beside", daemon=True)
    thread.start()
    try:
        found = work()
    except Exception:
        ended.result()
        raise
    except BaseException:
        thread.join(_INTERRUPTED_S)
        raise
    return ended.result(), found
