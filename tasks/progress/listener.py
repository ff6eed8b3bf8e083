"""Whom a run tells of its progress: the listener, and the document whose run this is.

Both are context variables, so that no step needs a parameter for them; threads of several things at a time keep them.
"""

import time
from collections.abc import Callable, Generator
from concurrent.futures import Future
from contextlib import contextmanager
from contextvars import ContextVar, copy_context
from threading import Event, Thread
from typing import TypeVar

from specs import untrusted_text

_name: ContextVar[str] = ContextVar("simyard_document", default="")
_INTERVAL_S = 1.0
_SAID_EVERY_S = 10.0
R = TypeVar("R")
S = TypeVar("S")
# What is done beside has so long to end after an interrupt.
_INTERRUPTED_S = 3.0


@contextmanager
def work_for_document(name: str) -> Generator[None, None, None]:
    """Makes everything in the ``with`` block a part of a document's run.

    Args:
        name: The document's; of a stage that runs alone, its flow's.
    """
    token = _name.set(name)
    try:
        yield
    finally:
        _name.reset(token)


def document_name() -> str:
    """Returns the name of the document whose run this is; empty if there is none."""
    return _name.get()


def document_artifact_key(what: str) -> str:
    """Returns the key of an artifact of this document, such as ``nightly--batch-results``."""
    return untrusted_text.artifact_key(_name.get(), what)


Listener = Callable[[str, int, int], None]
Progress = Callable[[int, int], None]


def _nobody(stage: str, done: int, total: int) -> None:
    """Drops what is told: nobody watches."""


_listener: ContextVar[Listener] = ContextVar("simyard_progress_listener", default=_nobody)


@contextmanager
def listen_to_progress(listener: Listener) -> Generator[None, None, None]:
    """Lets the listener hear of progress inside the ``with`` block.

    Args:
        listener: Called with the stage's name, units done, and units in all.
    """
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


def current_listener() -> Listener:
    """Returns the listener of this context."""
    return _listener.get()


def report_progress(stage: str, done: int, total: int) -> None:
    """Tells the listener of this context how far a stage is."""
    _listener.get()(stage, done, total)


@contextmanager
def waiting_for(what: str, say: Callable[[str], None], first_s: float = 2.0) -> Generator[None, None, None]:
    """Says what the block waits for, and how far that is where it tells, once it has taken long and then now and then.

    Args:
        what: What a person waits for.
        say: Called in a thread of its own with a line.
        first_s: After how many seconds it is said for the first time.
    """
    ended, begin_s, outer, far = Event(), time.monotonic(), current_listener(), ""

    def hear(stage: str, done: int, total: int) -> None:
        nonlocal far
        far = f": {stage} {done:,}/{total:,}"
        outer(stage, done, total)

    def tell() -> None:
        wait_s = first_s
        while not ended.wait(wait_s):
            say(f"{time.monotonic() - begin_s:6.1f} s  {what}{far}")
            wait_s = _SAID_EVERY_S

    teller = Thread(target=tell, name="simyard waiting", daemon=True)
    teller.start()
    try:
        with listen_to_progress(hear):
            yield
    finally:
        ended.set()
        teller.join()


def stage_progress(stage: str) -> Progress:
    """Returns a function that tells how far a stage is: units done and in all, once a second at most, and the end.

    Args:
        stage: What a person calls it, such as ``Worlds``.
    """
    told_s = -_INTERVAL_S

    def progress(done: int, total: int) -> None:
        nonlocal told_s
        if done >= total or time.monotonic() - told_s >= _INTERVAL_S:
            told_s = time.monotonic()
            report_progress(stage, done, total)

    return progress


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
