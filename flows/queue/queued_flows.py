"""Queued jobs as flow runs of Prefect: of the flow that a document's stage has, with its artifacts and events.

A worker of Simyard's own calls a flow in its process (`call_flow`), and holds the job's turn meanwhile.
"""

import contextvars
import logging
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from typing import Any

import httpx
from prefect import Flow, flow, tags
from prefect.client.schemas.objects import FlowRun, State
from prefect.exceptions import CancelledRun

from flows.entry.flow_state import completed_job
from flows.parameter.secret_guard import guarded
from flows.parameter.store_block import store_at
from flows.parameter.store_parameter import StoreParameter
from flows.prefect_orchestrator import flow_result, under_prefect
from flows.queue.attempts import Job, ServerAway
from flows.queue.recorded_work import work_off
from flows.resource.cancel import cancel_resource
from flows.run.abandoned_flow_runs import end_flow_runs_before
from flows.stage.assets import made_by
from flows.stage.orchestrator import orchestrator
from flows.stage.stage_run import require_success
from specs.errors import DocumentError, SimyardError
from specs.job_kinds import JOB_KINDS, JobKind
from tasks.progress.document import work_for_document
from tasks.storage.base.store import Store
from tasks.storage.jobs.queue import find_entry
from tasks.storage.jobs.records import JobRecord, is_terminal, read
from tasks.storage.store_url import open_store

TAG = "simyard:api"
_LOOK_S = 1.0
JobFlow = Flow[..., Any]
logger = logging.getLogger(__name__)


def queued_flow(kind: JobKind, work: Callable[[Store, str], JobRecord], description: str) -> JobFlow:
    """Returns the flow of a kind's queued jobs, which takes a job's id and the store's URL.

    Args:
        kind: Of the jobs.
        work: Ends a job, given the store and its id.
        description: For Prefect's pages.
    """

    def queued(job: str, store: StoreParameter = None) -> JobRecord:
        opened = open_store(store_at(store))
        with under_prefect(is_queued=True), orchestrator().announce_changes(), work_for_document(JOB_KINDS[kind].flow):
            return completed_job(flow_result(lambda: work(opened, job)))

    def cancel(flow: JobFlow, flow_run: FlowRun, state: State[Any]) -> None:  # noqa: ARG001 - Prefect's
        url = flow_run.parameters.get("store")
        store = open_store(store_at(url if isinstance(url, str) else None))
        _cancel(store, read(store, kind, str(flow_run.parameters["job"])))

    name = JOB_KINDS[kind].flow
    queued.__name__ = name.replace("-", "_")
    options = flow(
        name=name, description=description, flow_run_name="{job}", persist_result=False, on_cancellation=[cancel]
    )
    return guarded(options(queued))


def end_in_flow(store: Store, kind: JobKind, job: str) -> JobRecord:
    """Returns the record of a job that this flow run has ended; its asset is told of.

    Args:
        store: Where it is.
        kind: The job's.
        job: Its id; its turn is this process's.

    Raises:
        SimyardError: It ended without success, cannot be done, or not now.
    """
    entry, record = find_entry(store, kind, job), read(store, kind, job)
    if entry and entry.attempts > 1:
        own = orchestrator().flow_run_id
        end_flow_runs_before(job, own, f"Its process ended without a word; flow run {own} goes on with {record.arn}")
    with _watch_button(store, record):
        ended = work_off(store, record, entry.options if entry else {})
    made = made_by(store, ended)
    if made is not None:
        orchestrator().announce_asset(made)
    return ended if kind == "deployment-job" else require_success(ended)


_FLOWS = {
    kind: queued_flow(kind, lambda store, job, kind=kind: end_in_flow(store, kind, job), "A job of RoboMaker's API.")
    for kind, declared in JOB_KINDS.items()
    if declared.section
}


def call_flow(store: Store, job: Job, is_server_there: Callable[[], bool]) -> None:
    """Ends a job in a flow run of this process.

    Args:
        store: Where it is.
        job: Its turn is this worker's.
        is_server_there: Whether Prefect's server answers.

    Raises:
        SimyardError: It ended without success, cannot be done, or not now.
        ServerAway: Prefect's server does not answer.
    """
    with tags(job.entry.id, TAG):
        try:
            _FLOWS[job.entry.kind](job=job.entry.id, store=store.url)
        except (SimyardError, CancelledRun) as exc:
            if is_terminal(read(store, job.entry.kind, job.entry.id)):
                logger.info("%s: %s", job.record.arn, exc)
            elif isinstance(exc, SimyardError):
                raise
        except Exception as exc:
            # Its SQLite answers 503 while somebody else writes for long; the client has asked several times by then.
            if isinstance(exc, httpx.HTTPError) or not is_server_there():
                raise ServerAway(f"Prefect's server does not answer as it should: {exc}") from exc
            raise


@contextmanager
def _watch_button(store: Store, record: JobRecord) -> Generator[None, None, None]:
    """Cancels the job inside the block as soon as somebody cancels its flow run in Prefect."""
    left = threading.Event()

    def watch() -> None:
        with orchestrator().watch_cancellation() as asked:
            while not left.wait(_LOOK_S):
                if asked():
                    _cancel(store, record)
                    return

    watching = contextvars.copy_context()
    threading.Thread(target=watching.run, args=(watch,), name=f"cancellation of {record.id}", daemon=True).start()
    try:
        yield
    finally:
        left.set()


def _cancel(store: Store, record: JobRecord) -> None:
    with suppress(DocumentError):  # it has ended, or is about to
        try:
            cancel_resource(store, record.arn)
        except SimyardError as exc:
            if isinstance(exc, DocumentError):
                raise
            logger.warning("%s was canceled in Prefect, and could not be: %s", record.arn, exc)
