"""Simulation jobs: CreateSimulationJob, and the calls about jobs, whether single or of a batch.

A single job is a batch of one to Simyard, and none to RoboMaker.
"""

from flows.gateway.gateway import Gateway, Handlers
from flows.gateway.jobs.admission import Document, asked_document, token_of
from flows.gateway.jobs.answer import answer_of
from flows.gateway.jobs.quota import SINGLE, require_room
from flows.gateway.jobs.simulation_batch import KIND as BATCH
from flows.gateway.jobs.simulation_batch import admit_batch, require_own_tags
from flows.gateway.references import missing, path_of
from specs.arn import resource_kind
from specs.interface.quotas import SIMULATION_JOBS
from specs.robomaker.simulation import (
    BatchDescribeSimulationJobRequest,
    CancelSimulationJobRequest,
    CancelSimulationJobResponse,
    CreateSimulationJobRequest,
    DescribeSimulationJobRequest,
    RestartSimulationJobRequest,
    RestartSimulationJobResponse,
)
from specs.robomaker.simulation_descriptions import (
    BatchDescribeSimulationJobResponse,
    CreateSimulationJobResponse,
    DescribeSimulationJobResponse,
    SimulationJob,
)
from tasks.simulate.batch.cancel_restart import cancel_job, restart_job
from tasks.simulate.batch.describe import batch_describe_jobs, describe_job

_JOB = "simulation-job"


def create(gateway: Gateway, request: CreateSimulationJobRequest) -> CreateSimulationJobResponse:
    """Answers CreateSimulationJob: the job waits for a worker."""
    require_own_tags(request.tags, "tags")
    asked: Document = asked_document(request, token_of(request))
    record = admit_batch(gateway, asked, SIMULATION_JOBS, {SINGLE: True})
    return answer_of(CreateSimulationJobResponse, describe_job(gateway.store, f"{record.id}/0"), gateway.store)


def describe(gateway: Gateway, request: DescribeSimulationJobRequest) -> DescribeSimulationJobResponse:
    """Answers DescribeSimulationJob."""
    store = gateway.store
    described = describe_job(store, path_of(store, request.job, _JOB, "job"))
    return answer_of(DescribeSimulationJobResponse, described, store)


def describe_several(
    gateway: Gateway, request: BatchDescribeSimulationJobRequest
) -> BatchDescribeSimulationJobResponse:
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


def cancel(gateway: Gateway, request: CancelSimulationJobRequest) -> CancelSimulationJobResponse:
    """Answers CancelSimulationJob: who works on its batch stops it within seconds."""
    cancel_job(gateway.store, path_of(gateway.store, request.job, _JOB, "job"))
    gateway.wake()
    return CancelSimulationJobResponse()


def restart(gateway: Gateway, request: RestartSimulationJobRequest) -> RestartSimulationJobResponse:
    """Answers RestartSimulationJob: a running job is simulated once more (docs/decisions/0008)."""
    path = path_of(gateway.store, request.job, _JOB, "job")
    require_room(gateway.store, BATCH, SIMULATION_JOBS)
    restart_job(gateway.store, path)
    return RestartSimulationJobResponse()


HANDLERS: Handlers = {
    "CreateSimulationJob": create,
    "DescribeSimulationJob": describe,
    "BatchDescribeSimulationJob": describe_several,
    "CancelSimulationJob": cancel,
    "RestartSimulationJob": restart,
}
