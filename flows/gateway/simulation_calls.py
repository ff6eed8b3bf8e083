"""Calls about simulation jobs and their batches: StartSimulationJobBatch, CreateSimulationJob, and what follows."""

from collections.abc import Mapping
from pathlib import Path
from typing import cast

from flows.gateway.admission import (
    SINGLE,
    Admission,
    Document,
    NewRecord,
    admit,
    answer_of,
    asked_document,
    require_output,
    require_room,
    token_of,
)
from flows.gateway.gateway import Gateway, Handlers, missing, path_of
from flows.pipeline.references import latest_finder
from flows.pipeline.tested_batch import batch_plan, launch_faults, worldless_fault
from specs.arn import resource_kind
from specs.base import Fault
from specs.data.outcomes import MOST_OWN_TAGS, is_reserved
from specs.errors import DocumentError
from specs.job_kinds import JobKind
from specs.pipeline.simulation_section import SimulationBatch
from specs.robomaker.operations import BATCHES, SIMULATION_JOBS
from specs.robomaker.simulation import (
    BatchDescribeSimulationJobRequest,
    CancelSimulationJobBatchRequest,
    CancelSimulationJobBatchResponse,
    CancelSimulationJobRequest,
    CancelSimulationJobResponse,
    CreateSimulationJobRequest,
    DescribeSimulationJobBatchRequest,
    DescribeSimulationJobRequest,
    RestartSimulationJobRequest,
    RestartSimulationJobResponse,
    StartSimulationJobBatchRequest,
)
from specs.robomaker.simulation_descriptions import (
    BatchDescribeSimulationJobResponse,
    CreateSimulationJobResponse,
    DescribeSimulationJobBatchResponse,
    DescribeSimulationJobResponse,
    SimulationJob,
    StartSimulationJobBatchResponse,
)
from specs.settings import CountSetting
from tasks.documents.pipeline_file import in_request, pipeline_of_request
from tasks.simulate.batch.batch_jobs import (
    batch_describe_jobs,
    cancel_batch,
    cancel_job,
    describe_batch,
    describe_job,
    restart_job,
)
from tasks.simulate.batch.batch_record import etag_detail
from tasks.simulate.plan.batch_plan import BatchPlan
from tasks.simulate.plan.plan_batch import is_single, output_location
from tasks.storage.base.store import Store
from tasks.storage.jobs.queue import enqueue
from tasks.storage.jobs.records import JobRecord, read

_BATCH_KIND: JobKind = "simulation-job-batch"
_SOURCE = "request"
_JOB = "simulation-job"


def _start_batch(gateway: Gateway, request: StartSimulationJobBatchRequest) -> StartSimulationJobBatchResponse:
    """Answers StartSimulationJobBatch: the batch waits for a worker."""
    for number, entry in enumerate(request.createSimulationJobRequests):
        require_own_tags(entry.tags, f"createSimulationJobRequests[{number}].tags")
    record = admit_batch(gateway, asked_document(request, token_of(request)), BATCHES, {})
    return answer_of(StartSimulationJobBatchResponse, describe_batch(gateway.store, record.id), gateway.store)


def _describe_batch(gateway: Gateway, request: DescribeSimulationJobBatchRequest) -> DescribeSimulationJobBatchResponse:
    """Answers DescribeSimulationJobBatch; unlike `simyard describe` it ends no batch that was left."""
    store, batch = gateway.store, _batch_of(gateway.store, request.batch)
    return answer_of(DescribeSimulationJobBatchResponse, describe_batch(store, batch), store)


def _cancel_batch(gateway: Gateway, request: CancelSimulationJobBatchRequest) -> CancelSimulationJobBatchResponse:
    """Answers CancelSimulationJobBatch: who works on it stops within seconds, and writes its tables."""
    record = cancel_batch(gateway.store, _batch_of(gateway.store, request.batch))
    enqueue(gateway.store, _BATCH_KIND, record.id)  # who worked on it may have died: a worker ends it
    gateway.wake()
    return CancelSimulationJobBatchResponse()


def admit_batch(gateway: Gateway, asked: Document, quota: CountSetting, options: Document) -> JobRecord:
    """Returns the batch of a request, or the batch of one that a single job is, with its plan."""
    store = gateway.store

    def checked() -> NewRecord:
        plan = _plan(store, asked)
        return NewRecord({"request": asked, "plan": plan.model_dump(mode="json")}, etag_detail(plan))

    admission = Admission(_BATCH_KIND, str(asked["clientRequestToken"]), asked, _asked_in, checked, quota, options)
    record = admit(store, admission)
    gateway.wake()
    return record


def require_own_tags(tags: Mapping[str, str] | None, member: str) -> None:
    """Does nothing for tags that leave room for a job's outcome.

    Raises:
        DocumentError: One is the outcome's, or they are too many.
    """
    own = tags or {}
    reserved = [
        Fault(path=member, value=repr(key), allowed="a key that is not Simyard's own")
        for key in own
        if is_reserved(key)
    ]
    if len(own) > MOST_OWN_TAGS:
        allowed = f"at most {MOST_OWN_TAGS}: the outcome of the job is told in others"
        reserved.append(Fault(path=member, value=f"{len(own)} tags", allowed=allowed))
    if reserved:
        raise DocumentError(reserved, _SOURCE)


def _batch_of(store: Store, text: str) -> str:
    """Returns the id of a batch; a single job is none to RoboMaker."""
    batch = path_of(store, text, _BATCH_KIND, "batch")
    if is_single(read(store, _BATCH_KIND, batch)):
        raise missing(store, text, _BATCH_KIND, "batch")
    return batch


def _plan(store: Store, asked: Document) -> BatchPlan:
    """Returns the plan of a request whose worlds, versions, launch files, data and output bucket are there."""
    section = cast("SimulationBatch", pipeline_of_request(asked, Path(_SOURCE)).simulationBatch)
    try:
        require_output(store, output_location(section).s3Bucket, "outputLocation.s3Bucket")
        plan = batch_plan(section, (), store, latest_finder(store))
        faults = [*filter(None, [worldless_fault(plan)]), *launch_faults(plan, store)]
    except DocumentError as exc:
        raise type(exc)([in_request(fault, asked) for fault in exc.faults], _SOURCE) from exc
    if faults:
        raise DocumentError([in_request(fault, asked) for fault in faults], _SOURCE)
    return plan


def _asked_in(record: JobRecord) -> Document:
    return cast("Document", record.request["request"])


# A single job is a batch of one to Simyard, and none to RoboMaker.
def _create_job(gateway: Gateway, request: CreateSimulationJobRequest) -> CreateSimulationJobResponse:
    """Answers CreateSimulationJob: the job waits for a worker."""
    require_own_tags(request.tags, "tags")
    asked: Document = asked_document(request, token_of(request))
    record = admit_batch(gateway, asked, SIMULATION_JOBS, {SINGLE: True})
    return answer_of(CreateSimulationJobResponse, describe_job(gateway.store, f"{record.id}/0"), gateway.store)


def _describe_job(gateway: Gateway, request: DescribeSimulationJobRequest) -> DescribeSimulationJobResponse:
    """Answers DescribeSimulationJob."""
    store = gateway.store
    described = describe_job(store, path_of(store, request.job, _JOB, "job"))
    return answer_of(DescribeSimulationJobResponse, described, store)


def _describe_jobs(gateway: Gateway, request: BatchDescribeSimulationJobRequest) -> BatchDescribeSimulationJobResponse:
    """Answers BatchDescribeSimulationJob: jobs that do not exist are told, and fail nothing.

    Raises:
        ResourceNotFound: An ARN is of something else than a simulation job.
    """
    store = gateway.store
    for text in request.jobs:
        if resource_kind(text) != _JOB:
            raise missing(store, text, _JOB, "jobs")
    described = batch_describe_jobs(store, request.jobs)
    jobs = tuple(answer_of(SimulationJob, job, store) for job in described.jobs or ())
    return described.model_copy(update={"jobs": jobs})


def _cancel_job(gateway: Gateway, request: CancelSimulationJobRequest) -> CancelSimulationJobResponse:
    """Answers CancelSimulationJob: who works on its batch stops it within seconds."""
    cancel_job(gateway.store, path_of(gateway.store, request.job, _JOB, "job"))
    gateway.wake()
    return CancelSimulationJobResponse()


def _restart_job(gateway: Gateway, request: RestartSimulationJobRequest) -> RestartSimulationJobResponse:
    """Answers RestartSimulationJob: a running job is simulated once more (docs/decisions/0008)."""
    path = path_of(gateway.store, request.job, _JOB, "job")
    require_room(gateway.store, _BATCH_KIND, SIMULATION_JOBS)
    restart_job(gateway.store, path)
    return RestartSimulationJobResponse()


HANDLERS: Handlers = {
    "StartSimulationJobBatch": _start_batch,
    "DescribeSimulationJobBatch": _describe_batch,
    "CancelSimulationJobBatch": _cancel_batch,
    "CreateSimulationJob": _create_job,
    "DescribeSimulationJob": _describe_job,
    "BatchDescribeSimulationJob": _describe_jobs,
    "CancelSimulationJob": _cancel_job,
    "RestartSimulationJob": _restart_job,
}
