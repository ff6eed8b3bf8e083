"""Queued jobs as flow runs of Prefect: of the flow that a document's stage has, with its artifacts and events.

A job that the gateway has recorded is worked off from its record alone, through the stages that a document's has.
"""

import contextvars
import logging
import threading
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

import httpx
from prefect import Flow, flow, tags
from prefect.client.schemas.objects import FlowRun, State
from prefect.exceptions import CancelledRun
from pydantic import JsonValue, TypeAdapter

from flows.batch.batch_end import close_if_stopped
from flows.pipeline.batch_run import run_batch
from flows.pipeline.orchestrator import orchestrator, run_step
from flows.pipeline.run_turns import require_success
from flows.pipeline.stage_report import made_by
from flows.prefect.flow_calls import completed_job
from flows.prefect.flow_runs import end_flow_runs_before
from flows.prefect.parameters import StoreParameter, guarded, store_at
from flows.prefect.prefect_orchestrator import flow_result, under_prefect
from flows.queue.attempts import Job, ServerAway
from flows.resources.kinds import cancel_resource
from specs.data.world import ROBOT_RADIUS_M
from specs.errors import DocumentError, SimyardError, StageFailed
from specs.job_kinds import JOB_KINDS, JobKind
from specs.pipeline.world_sections import WorldFormat
from specs.robomaker.deployment import CreateDeploymentJobRequest
from specs.robomaker.world_jobs import CreateWorldExportJobRequest, CreateWorldGenerationJobRequest
from specs.template.body import TemplateBody
from tasks.applications.registry import resolve
from tasks.deploy.rollout.resolved_request import SYNC
from tasks.deploy.step import deploy_version, sync_fleet
from tasks.deploy.trust.trust_record import chosen_keys, require_vouched
from tasks.export.step import draw_worlds, export_worlds
from tasks.progress.listener import work_for_document
from tasks.simulate.batch.batch_record import STOPPING
from tasks.simulate.plan.plan_batch import recorded_location
from tasks.storage.base.keys import template_key
from tasks.storage.base.store import Store, decode_document
from tasks.storage.jobs.queue import find_entry
from tasks.storage.jobs.records import JobRecord, advance, is_terminal, read
from tasks.storage.store_url import open_store
from tasks.worlds.step import generate_worlds

_SEED, _TEMPLATE, _RADIUS, _FORMATS = "seed", "templateDigest", "robotRadius", "formats"
_WORLD_FORMATS = TypeAdapter(tuple[WorldFormat, ...])
_MADE = frozenset({"Completed", "PartialFailed"})
TAG = "simyard:api"
_LOOK_S = 1.0
JobFlow = Flow[..., Any]
logger = logging.getLogger(__name__)


# What the gateway writes, and a worker takes, is this. First the entry of the queue
# (`tasks.storage.jobs.queue.enqueue`), then the record (`tasks.storage.jobs.records.submit`), Pending, under the
# request's clientRequestToken, or one that the gateway has chosen. The record's ``request`` is
#
# - of a world-generation-job: RoboMaker's request as `specs.base.canonical_document` has it, its ``template`` an ARN,
#   its ``clientRequestToken`` the token; and beside its fields ``seed`` and ``templateDigest``. The body lies
#   under ``template_key(templateDigest)`` before the record does.
# - of a world-export-job: likewise RoboMaker's request, and beside it ``formats``, sorted, each once.
# - of a simulation-job-batch: ``{"request": ..., "plan": ...}``, as `tasks.simulate.batch.batch_record.open_batch`
#   submits them: RoboMaker's request of a batch, or of a single job, and ``BatchPlan.model_dump(mode="json")``.
# - of a deployment-job: RoboMaker's request as `canonical_document` has it, its ``clientRequestToken`` the token, and
#   its ``applicationVersion`` a number, so that what was checked is what is deployed. The fleet's record names the job
#   as its deployment. Of a sync, the entry's options are ``{"sync": true}``, and the request is what
#   `tasks.deploy.rollout.resolved_request.sync_request` makes of the last deployment.
#
# The record's ``vouched`` is the owner's word for it (`tasks.deploy.trust.trust_record.vouch_queued`). A worker with
# keys asks for it, whatever the kind: who writes to the store would have strangers' code simulated beside the keys,
# with the owner's word for what came of it, and buckets read and written that only the worker's credentials reach.
#
# A token stands for its record's digest. So what is submitted again here, by the functions that a document's stage
# calls, must be what was recorded: `canonical_document` of the request that was read back is.
def work_off(store: Store, record: JobRecord, options: Mapping[str, JsonValue]) -> JobRecord:
    """Returns the job's record in its terminal state; one that was begun and left is continued.

    Args:
        store: Where the job is.
        record: The job's.
        options: Of its entry in the queue.

    Raises:
        SimyardError: It cannot be done, or not now.
    """
    if chosen_keys() and record.kind != "deployment-job":
        if record.status in STOPPING:  # nothing of it is begun
            return _close(store, record)
        require_vouched(record, sync=True)
    match record.kind:
        case "world-generation-job":
            return _generate(store, record)
        case "world-export-job":
            return _export(store, record)
        case "simulation-job-batch":
            return _simulate(store, record)
        case "deployment-job":
            return _sync(store, record) if options.get(SYNC) else _deploy(store, record)
        case "pipeline-run":
            raise StageFailed("InvalidInput", "a run of a document is not queued", record.arn)


def _close(store: Store, record: JobRecord) -> JobRecord:
    """Returns the record of a job that was cancelled, ended: whoever asked for it need not have been the owner."""
    if record.kind == "simulation-job-batch":
        return close_if_stopped(store, record.id)
    return advance(store, record.kind, record.id, "Canceled", only_from={"Canceling"})


def _generate(store: Store, record: JobRecord) -> JobRecord:
    own = record.request
    key = template_key(str(own[_TEMPLATE]))
    made = run_step(
        generate_worlds,
        store.url,
        CreateWorldGenerationJobRequest.model_validate(_without(own, _SEED, _TEMPLATE, _RADIUS)),
        decode_document(TemplateBody, store.get(key), store, key),
        seed=int(str(own[_SEED])),
        token=record.token,
        robot_radius_m=float(str(own.get(_RADIUS, ROBOT_RADIUS_M))),
    )
    if made.status in _MADE:
        run_step(draw_worlds, store.url, made)
    return made


def _export(store: Store, record: JobRecord) -> JobRecord:
    request = CreateWorldExportJobRequest.model_validate(_without(record.request, _FORMATS))
    formats = _WORLD_FORMATS.validate_python(record.request[_FORMATS])
    return run_step(export_worlds, store.url, request, formats=formats, token=record.token)


def _simulate(store: Store, record: JobRecord) -> JobRecord:
    begun = advance(store, "simulation-job-batch", record.id, "InProgress", only_from={"Pending"})
    if begun.status in STOPPING:
        return close_if_stopped(store, record.id)
    return run_batch(store, record.id, recorded_location(record))


def _deploy(store: Store, record: JobRecord) -> JobRecord:
    request = CreateDeploymentJobRequest.model_validate(record.request)
    asked = request.deploymentApplicationConfigs[0]
    version = resolve(store, "robot-application", asked.application, asked.applicationVersion)
    digest, builds = version.digest, version.digests
    if chosen_keys():  # what is signed is what was asked for: the record, and the version, are in the store
        vouched = require_vouched(record, sync=False)
        digest, builds = vouched.digest, vouched.builds
    return run_step(deploy_version, store.url, request, digest=digest, builds=builds, token=record.token)


def _sync(store: Store, record: JobRecord) -> JobRecord:
    if chosen_keys():
        require_vouched(record, sync=True)
    return run_step(sync_fleet, store.url, str(record.request["fleet"]), token=record.token)


def _without(document: Mapping[str, JsonValue], *names: str) -> dict[str, JsonValue]:
    return {name: value for name, value in document.items() if name not in names}


# A worker of Simyard's own calls a flow in its process (`call_flow`), and holds the job's turn meanwhile.
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
