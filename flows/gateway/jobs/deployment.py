"""Deployment jobs: CreateDeploymentJob and SyncDeploymentJob, and the calls about such a job."""

from dataclasses import replace

from pydantic import JsonValue

from flows.gateway.gateway import Gateway, Handlers
from flows.gateway.jobs.admission import Admission, Document, NewRecord, admit
from flows.gateway.jobs.answer import answer_of
from flows.gateway.references import path_of
from specs.arn import arn
from specs.digest import canonical_document
from specs.interface.quotas import DEPLOYMENTS
from specs.job_kinds import JobKind
from specs.robomaker.deployment import (
    CancelDeploymentJobRequest,
    CancelDeploymentJobResponse,
    CreateDeploymentJobRequest,
    CreateDeploymentJobResponse,
    DescribeDeploymentJobRequest,
    DescribeDeploymentJobResponse,
    SyncDeploymentJobRequest,
    SyncDeploymentJobResponse,
)
from tasks.applications.registry import resolve
from tasks.deploy.answers.describe import describe_deployment_job
from tasks.deploy.fleet.fleets import read_fleet
from tasks.deploy.fleet.reservation import require_free, reserve_fleet
from tasks.deploy.rollout.operator_commands import wish_deployment_canceled
from tasks.deploy.rollout.resolved_request import plan_deployment
from tasks.deploy.rollout.sync import SYNC, latest_deployment, sync_request
from tasks.storage.jobs.queue import enqueue
from tasks.storage.jobs.records import JobRecord
from tasks.storage.store_url import store_id

KIND: JobKind = "deployment-job"


def create(gateway: Gateway, request: CreateDeploymentJobRequest) -> CreateDeploymentJobResponse:
    """Answers CreateDeploymentJob: the job waits for a worker, and its fleet takes no other until it has ended."""
    store, token, asked = gateway.store, request.clientRequestToken, canonical_document(request)
    fleet = path_of(store, request.fleet, "deployment-fleet", "fleet")
    path_of(store, request.deploymentApplicationConfigs[0].application, "robot-application", "application")

    def checked() -> NewRecord:
        use = request.deploymentApplicationConfigs[0]
        require_free(store, fleet, read_fleet(store, fleet)[0].deployment)
        version = resolve(store, "robot-application", use.application, use.applicationVersion)
        plan_deployment(store, request, version.digest)
        return NewRecord(asked)

    record = _admit(gateway, fleet, Admission(KIND, token, asked, _asked_in, checked, DEPLOYMENTS))
    return answer_of(CreateDeploymentJobResponse, describe_deployment_job(store, record.id), store)


def sync(gateway: Gateway, request: SyncDeploymentJobRequest) -> SyncDeploymentJobResponse:
    """Answers SyncDeploymentJob: a job of its own, as at RoboMaker, also where no robot lacks anything."""
    store, token = gateway.store, request.clientRequestToken
    fleet = path_of(store, request.fleet, "deployment-fleet", "fleet")
    # What the fleet's latest deployment is may change; what was asked for is the fleet.
    asked: Document = {"fleet": arn("deployment-fleet", store_id(store), fleet), SYNC: True}

    def checked() -> NewRecord:
        require_free(store, fleet, read_fleet(store, fleet)[0].deployment)
        last = sync_request(latest_deployment(store, fleet), token)
        return NewRecord({**canonical_document(last), "fleet": asked["fleet"]})

    options: dict[str, JsonValue] = {SYNC: True}
    admission = Admission(KIND, token, asked, _synced_in, checked, DEPLOYMENTS, options)
    record = _admit(gateway, fleet, admission)
    return answer_of(SyncDeploymentJobResponse, describe_deployment_job(store, record.id), store)


def describe(gateway: Gateway, request: DescribeDeploymentJobRequest) -> DescribeDeploymentJobResponse:
    """Answers DescribeDeploymentJob."""
    store = gateway.store
    described = describe_deployment_job(store, path_of(store, request.job, KIND, "job"))
    return answer_of(DescribeDeploymentJobResponse, described, store)


def cancel(gateway: Gateway, request: CancelDeploymentJobRequest) -> CancelDeploymentJobResponse:
    """Answers CancelDeploymentJob: robots that were asked finish, no other is asked."""
    store = gateway.store
    record = wish_deployment_canceled(store, path_of(store, request.job, KIND, "job"))
    enqueue(store, KIND, record.id, _options(record))  # who worked on it may have died: a worker ends it
    gateway.wake()
    return CancelDeploymentJobResponse()


def _admit(gateway: Gateway, fleet: str, admission: Admission) -> JobRecord:
    """Returns the job of an admission, whose fleet is taken before the job is recorded."""
    store = gateway.store
    record = admit(store, replace(admission, before_record=lambda job: reserve_fleet(store, fleet, job)))
    gateway.wake()
    return record


def _options(record: JobRecord) -> dict[str, JsonValue]:
    return {SYNC: True} if record.detail.get(SYNC) else {}


def _asked_in(record: JobRecord) -> Document:
    return {**record.request, **_options(record)}


def _synced_in(record: JobRecord) -> Document:
    return {"fleet": record.request["fleet"], **_options(record)}


HANDLERS: Handlers = {
    "CreateDeploymentJob": create,
    "SyncDeploymentJob": sync,
    "DescribeDeploymentJob": describe,
    "CancelDeploymentJob": cancel,
}
