"""What Prefect says of a cancellation, and what it is told of one.

A process learns of its flow run's cancellation by an event of Prefect at once, else by a question in 10 s. The event
needs a WebSocket. An older server has none, and a proxy may refuse it: then the questions alone must do.
"""

import asyncio
import contextvars
import logging
import os
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from typing import Any
from uuid import UUID

from prefect import Flow
from prefect.client.orchestration import get_client
from prefect.client.schemas.objects import FlowRun, State
from prefect.events.clients import get_events_subscriber
from prefect.events.filters import EventFilter, EventNameFilter, EventResourceFilter
from prefect.states import Cancelled

from flows.parameter.store_block import store_at
from flows.resource.cancel import CANCELED, cancel_run
from flows.stage.cancellation import PATIENCE_S
from specs.errors import StageFailed
from tasks.storage.jobs.records import is_terminal, records
from tasks.storage.jobs.runs import FLOW_RUN, KIND
from tasks.storage.store_url import open_store

QUESTION_S = 10.0
_RECONNECTIONS = 3
_NEXT_TRY_S = 60.0
_EVENTS = ["prefect.flow-run.Cancelling", "prefect.flow-run.Cancelled"]
logger = logging.getLogger(__name__)


def is_cancelling(flow_run_id: str) -> bool:
    """Returns whether Prefect's server says that somebody cancels a flow run; False if it says nothing."""
    if not flow_run_id:
        return False
    try:
        with get_client(httpx_settings={"timeout": PATIENCE_S}, sync_client=True) as client:
            state = client.read_flow_run(UUID(flow_run_id)).state
    except Exception as exc:  # noqa: BLE001 - whatever Prefect's client makes of it, the job goes on
        logger.debug("Prefect did not say whether %s is canceled: %s", flow_run_id, exc)
        return False
    return state is not None and (state.is_cancelling() or state.is_cancelled())


def canceled_state(failure: StageFailed) -> State[Any]:
    """Returns what Prefect shall call a flow run whose run was cancelled.

    Raises:
        StageFailed: It was not: the failure itself.
    """
    if failure.code != CANCELED:
        raise failure
    return Cancelled(message=f"{failure.reason} ({failure.arn})" if failure.arn else failure.reason)


def cancel_with_flow_run(flow: Flow[..., Any], flow_run: FlowRun, state: State[Any]) -> None:  # noqa: ARG001 - Prefect's
    """Cancels what a flow run worked on, when Prefect has cancelled it and its process could not do so before its end.

    Prefect calls this where the flow run was started: in its worker.
    """
    own_environment: dict[str, str] = (flow_run.job_variables or {}).get("env") or {}
    url = flow_run.parameters.get("store") or own_environment.get("SIMYARD_STORE") or os.environ.get("SIMYARD_STORE")
    if not url:  # a pool of containers does not show its environment, and the worker's folder is not their store
        logger.warning("flow run %s was canceled, and its worker has no SIMYARD_STORE: cancel its job", flow_run.id)
        return
    store = open_store(store_at(url))
    for run in records(store, KIND):
        if run.detail.get(FLOW_RUN) == str(flow_run.id) and not is_terminal(run):
            cancel_run(store, run.id)


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
