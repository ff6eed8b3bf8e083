"""Cancellation of a run while this process works on it: by `simyard cancel`, or by Prefect's button or command.

Prefect cancels a flow run by marking it, and sends SIGTERM to its process if a worker started it. A machine that goes
down sends SIGTERM, too. So this module asks the orchestrator whether a run was cancelled, or only interrupted and may
continue.
"""

import contextvars
import logging
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress

from pydantic import JsonValue

from flows.resource.cancel import CANCELED, REASON, cancel_jobs, end_canceled, require_not_canceled
from flows.stage.orchestrator import orchestrator
from specs.errors import DocumentError, SimyardError, StageFailed
from specs.settings import chosen_workers
from tasks.simulate.batch.cancel_restart import cancel_batch
from tasks.simulate.batch.chunk_store import chunk_numbers
from tasks.simulate.batch.job import KIND as BATCH
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, advance, read
from tasks.storage.jobs.runs import FLOW_RUN, FLOW_RUN_BEFORE, KIND, jobs_of

_LOOK_S = 1.0
PATIENCE_S = 5.0
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
    own = orchestrator().flow_run_id
    orchestrator().end_flow_run_before(run)
    advance(store, KIND, run.id, "Running", detail=_worked_on_in(own, run), only_from={"Pending", "Running"})
    try:
        with orchestrator().watch_cancellation() as asked, _watch_run(store, run, asked):
            require_not_canceled(store, run)
            yield
    except BaseException as exc:
        if not _is_cancellation(exc, store, run, own):
            raise
        _end(store, run, exc)
        if isinstance(exc, Exception) and not _is_canceled_failure(exc):
            raise StageFailed(CANCELED, REASON, run.arn) from exc
        raise


def _worked_on_in(own: str, run: JobRecord) -> dict[str, JsonValue]:
    """Returns what a run's detail says of Prefect's flow runs: the one that works on it, or a dead one's."""
    if own:
        return {FLOW_RUN: own}
    # Who cancels the dead flow run shall not cancel this process's work; reaping ends it.
    before = run.detail.get(FLOW_RUN) or run.detail.get(FLOW_RUN_BEFORE)
    return {FLOW_RUN: "", FLOW_RUN_BEFORE: before} if before else {}


def _is_canceled_failure(exc: BaseException) -> bool:
    return isinstance(exc, StageFailed) and exc.code == CANCELED


def _is_cancellation(exc: BaseException, store: Store, run: JobRecord, own: str) -> bool:
    """Returns whether a run that ends with an exception was cancelled, and not only interrupted, or failed."""
    if _is_canceled_failure(exc):
        return True
    try:
        if read(store, KIND, run.id).status == "Canceling":
            return True
    except SimyardError as unread:
        logger.warning("whether %s is canceled could not be read: %s", run.id, unread)
    return not isinstance(exc, Exception) and _answer_within(PATIENCE_S, lambda: orchestrator().is_cancelling(own))


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
def _watch_run(store: Store, run: JobRecord, asked: Callable[[], bool]) -> Generator[None, None, None]:
    """Inside the block, cancels the jobs of the run, each once, as soon as somebody cancels the run."""
    left = threading.Event()

    def watch() -> None:
        known = frozenset[str]()
        while not left.wait(_LOOK_S):
            try:
                if _is_canceled(store, run, asked):
                    known |= cancel_jobs(store, run, known)
            except SimyardError as exc:  # the store may come back; nothing is lost by looking again
                logger.warning("%s could not be looked at: %s", run.id, exc)

    watching = contextvars.copy_context()  # so that it asks the same server, and its events have the same flow run
    threading.Thread(target=watching.run, args=(watch,), name=f"cancellation of {run.id}", daemon=True).start()
    try:
        yield
    finally:
        left.set()


def _is_canceled(store: Store, run: JobRecord, asked: Callable[[], bool]) -> bool:
    """Returns whether a run is cancelled; its record says so from then on, also when it was Prefect that was asked."""
    status = read(store, KIND, run.id).status
    if status == "Running" and asked():
        status = advance(store, KIND, run.id, "Canceling", only_from={"Running"}).status
    return status == "Canceling"


def _answer_within(seconds: float, question: Callable[[], bool]) -> bool:
    """Returns the answer; False if there is none in time."""
    answers: list[bool] = []
    asking = contextvars.copy_context()
    thread = threading.Thread(target=lambda: answers.append(asking.run(question)), daemon=True)
    thread.start()
    thread.join(seconds)
    return any(answers)
