"""Cancellation of a flow run, as its process learns it: by an event of Prefect at once, else by a question in 10 s.

The event needs a WebSocket. An older server has none, and a proxy may refuse it: then the questions alone must do.
"""

import asyncio
import contextvars
import logging
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress

from prefect.events.clients import get_events_subscriber
from prefect.events.filters import EventFilter, EventNameFilter, EventResourceFilter

from flows.run.cancellation import is_cancelling

QUESTION_S = 10.0
_RECONNECTIONS = 3
_NEXT_TRY_S = 60.0
_EVENTS = ["prefect.flow-run.Cancelling", "prefect.flow-run.Cancelled"]
logger = logging.getLogger(__name__)


@contextmanager
def watch_cancellation(
    flow_run: str, now_s: Callable[[], float] = time.monotonic
) -> Generator[Callable[[], bool], None, None]:
    """Yields a function that says whether a flow run is cancelled, and that may be called often.

    Args:
        flow_run: Its id; empty for none, which nobody cancels.
        now_s: A clock that never goes back.
    """
    if not flow_run:
        yield lambda: False
        return
    told, next_s = threading.Event(), now_s()

    def is_canceled() -> bool:
        nonlocal next_s
        if not told.is_set() and now_s() >= next_s:
            next_s = now_s() + QUESTION_S
            if is_cancelling(flow_run):
                told.set()
        return told.is_set()

    with _listening(flow_run, told):
        yield is_canceled


@contextmanager
def _listening(flow_run: str, told: threading.Event) -> Generator[None, None, None]:
    """Sets an event as soon as Prefect tells of the cancellation, inside the ``with`` block."""
    loop = asyncio.new_event_loop()
    left = asyncio.Event()

    def listen() -> None:
        with suppress(RuntimeError), asyncio.Runner(loop_factory=lambda: loop) as runner:  # or the interpreter ends
            runner.run(_listen_until(flow_run, told, left))

    context = contextvars.copy_context()  # so that it asks the same server
    thread = threading.Thread(target=context.run, args=(listen,), name=f"events of {flow_run}", daemon=True)
    thread.start()
    try:
        yield
    finally:
        with suppress(RuntimeError):  # it has ended
            loop.call_soon_threadsafe(left.set)


async def _listen_until(flow_run: str, told: threading.Event, left: asyncio.Event) -> None:
    listening = asyncio.create_task(_listen(flow_run, told))
    leaving = asyncio.create_task(left.wait())
    await asyncio.wait({listening, leaving}, return_when=asyncio.FIRST_COMPLETED)
    for task in (listening, leaving):
        task.cancel()
    await asyncio.gather(listening, leaving, return_exceptions=True)


async def _listen(flow_run: str, told: threading.Event) -> None:
    wanted = EventFilter(
        event=EventNameFilter(name=_EVENTS), resource=EventResourceFilter(id=[f"prefect.flow-run.{flow_run}"])
    )
    while not told.is_set():
        try:
            async with get_events_subscriber(filter=wanted, reconnection_attempts=_RECONNECTIONS) as events:
                async for _ in events:
                    told.set()
                    return
        except Exception as exc:  # noqa: BLE001 - whatever a server or a proxy makes of it, the questions are asked
            logger.info("no events of %s, which is asked after every %.0f s: %s", flow_run, QUESTION_S, exc)
        await asyncio.sleep(_NEXT_TRY_S)
