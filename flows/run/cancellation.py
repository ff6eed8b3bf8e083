"""Cancellation of a run while this process works on it: by `simyard cancel`, or by Prefect's button or command.

Prefect cancels a flow run by marking it, and sends SIGTERM to its process if a worker started it. A machine that goes
down sends SIGTERM, too. So this module asks Prefect whether a run was cancelled, or only interrupted and may continue.
"""

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
from prefect.runtime import flow_run as this_flow_run
from prefect.states import Cancelled

from flows.resource.cancel import REASON, cancel_jobs, cancel_run, end_canceled, require_not_canceled
from specs.errors import DocumentError, SimyardError, StageFailed
from specs.settings import chosen_workers
from tasks.simulate.batch.cancel_restart import cancel_batch
from tasks.simulate.batch.chunk_store import chunk_numbers
from tasks.simulate.batch.job import KIND as BATCH
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance, is_terminal, read, records
from tasks.storage.jobs.runs import KIND, jobs_of
from tasks.storage.store_url import open_store

FLOW_RUN = "flow_run"
"""Where a run's detail says which of Prefect's flow runs works on it."""
_CANCELED = "Canceled"
_LOOK_S = 1.0
_LOOKS_A_QUESTION = 3  # to Prefect's server, which has more to do than a store
_PATIENCE_S = 5.0
_CHUNK_S = 10.0
logger = logging.getLogger(__name__)


@contextmanager
def cancelable_run(store: Store, run: JobRecord) -> Generator[None, None, None]:
    """Watches a run inside the ``with`` block: if it is cancelled, its job under way is too, and the run ends Canceled.

    Args:
        store: Where the run is.
        run: Its claim is held; it has not ended.

    Raises:
        StageFailed: It was cancelled.
    """
    own = str(this_flow_run.id or "")
    advance(store, KIND, run.id, "Running", detail={FLOW_RUN: own} if own else {}, only_from={"Pending", "Running"})
    try:
        with _watch_run(store, run, own):
            require_not_canceled(store, run)
            yield
    except BaseException as exc:
        if not _is_cancellation(exc, store, run, own):
            raise
        _end(store, run, exc)
        if isinstance(exc, Exception) and not _is_canceled_failure(exc):
            raise StageFailed(_CANCELED, REASON, run.arn) from exc
        raise


def canceled_state(failure: StageFailed) -> State[Any]:
    """Returns what Prefect shall call a flow run whose run was cancelled.

    Raises:
        StageFailed: It was not: the failure itself.
    """
    if failure.code != _CANCELED:
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
    store = open_store(url)
    for run in records(store, KIND):
        if run.detail.get(FLOW_RUN) == str(flow_run.id) and not is_terminal(run):
            cancel_run(store, run.id)


def _is_canceled_failure(exc: BaseException) -> bool:
    return isinstance(exc, StageFailed) and exc.code == _CANCELED


def _is_cancellation(exc: BaseException, store: Store, run: JobRecord, own: str) -> bool:
    """Returns whether a run that ends with an exception was cancelled, and not only interrupted, or failed."""
    if _is_canceled_failure(exc):
        return True
    try:
        if read(store, KIND, run.id).status == "Canceling":
            return True
    except SimyardError as unread:
        logger.warning("whether %s is canceled could not be read: %s", run.id, unread)
    return not isinstance(exc, Exception) and _answer_within(_PATIENCE_S, lambda: _is_cancelling(own))


def _end(store: Store, run: JobRecord, exc: BaseException) -> None:
    try:
        _let_workers_end(store, run)
        end_canceled(store, run)
    except SimyardError as failure:
        logger.warning("%s was canceled (%s), and could not be ended: %s", run.id, exc, failure)


def _let_workers_end(store: Store, run: JobRecord) -> None:
    """Gives workers of a cluster, which outlive this process, the time to commit what is done of their chunks."""
    workers = chosen_workers()
    batches = [job for kind, job in jobs_of(run) if kind == BATCH] if workers and workers.address else []
    for batch in batches:
        with suppress(DocumentError):  # not begun, or ended
            cancel_batch(store, batch)
            end_s = time.monotonic() + _CHUNK_S
            while (chunks := chunk_numbers(store, batch)).begun != chunks.committed and time.monotonic() < end_s:
                time.sleep(_LOOK_S)


@contextmanager
def _watch_run(store: Store, run: JobRecord, own: str) -> Generator[None, None, None]:
    """Inside the block, cancels the jobs of the run, each once, as soon as somebody cancels the run."""
    left = threading.Event()

    def watch() -> None:
        looks, known = 0, frozenset[str]()
        while not left.wait(_LOOK_S):
            asks = looks % _LOOKS_A_QUESTION == 0
            looks += 1
            try:
                if _is_canceled(store, run, own if asks else ""):
                    known |= cancel_jobs(store, run, known)
            except SimyardError as exc:  # the store may come back; nothing is lost by looking again
                logger.warning("%s could not be looked at: %s", run.id, exc)

    watching = contextvars.copy_context()  # so that it asks the same server, and its events have the same flow run
    threading.Thread(target=watching.run, args=(watch,), name=f"cancellation of {run.id}", daemon=True).start()
    try:
        yield
    finally:
        left.set()


def _is_canceled(store: Store, run: JobRecord, own: str) -> bool:
    """Returns whether a run is cancelled; its record says so from then on, also when it was Prefect that was asked."""
    status = read(store, KIND, run.id).status
    if status == "Running" and own and _is_cancelling(own):
        status = advance(store, KIND, run.id, "Canceling", only_from={"Running"}).status
    return status == "Canceling"


def _is_cancelling(own: str) -> bool:
    if not own:
        return False
    try:
        with get_client(httpx_settings={"timeout": _PATIENCE_S}, sync_client=True) as client:
            state = client.read_flow_run(UUID(own)).state
    except Exception as exc:  # noqa: BLE001 - whatever Prefect's client makes of it, the job goes on
        logger.debug("Prefect did not say whether %s is canceled: %s", own, exc)
        return False
    return state is not None and (state.is_cancelling() or state.is_cancelled())


def _answer_within(seconds: float, question: Callable[[], bool]) -> bool:
    """Returns the answer; False if there is none in time."""
    answers: list[bool] = []
    asking = contextvars.copy_context()
    thread = threading.Thread(target=lambda: answers.append(asking.run(question)), daemon=True)
    thread.start()
    thread.join(seconds)
    return any(answers)
