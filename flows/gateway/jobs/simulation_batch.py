"""Batches of simulation jobs: StartSimulationJobBatch, and the calls about a batch."""

from collections.abc import Mapping
from pathlib import Path
from typing import cast

from flows.document.references import latest_finder
from flows.document.tested_batch import batch_plan, launch_faults
from flows.gateway.gateway import Gateway, Handlers
from flows.gateway.jobs.admission import Admission, Document, NewRecord, admit, asked_document, token_of
from flows.gateway.jobs.answer import answer_of
from flows.gateway.jobs.output import require_output
from flows.gateway.references import missing, path_of
from specs.base import Fault
from specs.data.outcome_tags import MOST_OWN_TAGS, is_reserved
from specs.errors import DocumentError
from specs.interface.quotas import BATCHES, Quota
from specs.job_kinds import JobKind
from specs.pipeline.simulation_section import SimulationBatch
from specs.robomaker.simulation import (
    CancelSimulationJobBatchRequest,
    CancelSimulationJobBatchResponse,
    DescribeSimulationJobBatchRequest,
    StartSimulationJobBatchRequest,
)
from specs.robomaker.simulation_descriptions import DescribeSimulationJobBatchResponse, StartSimulationJobBatchResponse
from tasks.documents.bare_requests import in_request, pipeline_of_request
from tasks.simulate.batch.cancel_restart import cancel_batch
from tasks.simulate.batch.describe import describe_batch
from tasks.simulate.batch.job import etag_detail
from tasks.simulate.plan.batch_plan import BatchPlan
from tasks.simulate.plan.request import is_single
from tasks.simulate.plan.resolve import output_location
from tasks.storage.base.store import Store
from tasks.storage.jobs.queue import enqueue
from tasks.storage.jobs.records import JobRecord, read

KIND: JobKind = "simulation-job-batch"
_SOURCE = "request"


def start(gateway: Gateway, request: StartSimulationJobBatchRequest) -> StartSimulationJobBatchResponse:
    """Answers StartSimulationJobBatch: the batch waits for a worker."""
    for number, entry in enumerate(request.createSimulationJobRequests):
        require_own_tags(entry.tags, f"createSimulationJobRequests[{number}].tags")
    record = admit_batch(gateway, asked_document(request, token_of(request)), BATCHES, {})
    return answer_of(StartSimulationJobBatchResponse, describe_batch(gateway.store, record.id), gateway.store)


def describe(gateway: Gateway, request: DescribeSimulationJobBatchRequest) -> DescribeSimulationJobBatchResponse:
    """Answers DescribeSimulationJobBatch; unlike `simyard describe` it ends no batch that was left."""
    store, batch = gateway.store, _batch_of(gateway.store, request.batch)
    return answer_of(DescribeSimulationJobBatchResponse, describe_batch(store, batch), store)


def cancel(gateway: Gateway, request: CancelSimulationJobBatchRequest) -> CancelSimulationJobBatchResponse:
    """Answers CancelSimulationJobBatch: who works on it stops within seconds, and writes its tables."""
    record = cancel_batch(gateway.store, _batch_of(gateway.store, request.batch))
    enqueue(gateway.store, KIND, record.id)  # who worked on it may have died: a worker ends it
    gateway.wake()
    return CancelSimulationJobBatchResponse()


def admit_batch(gateway: Gateway, asked: Document, quota: Quota, options: Document) -> JobRecord:
    """Returns the batch of a request, or the batch of one that a single job is, with its plan."""
    store = gateway.store

    def checked() -> NewRecord:
        plan = _plan(store, asked)
        return NewRecord({"request": asked, "plan": plan.model_dump(mode="json")}, etag_detail(plan))

    admission = Admission(KIND, str(asked["clientRequestToken"]), asked, _asked_in, checked, quota, options)
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
    batch = path_of(store, text, KIND, "batch")
    if is_single(read(store, KIND, batch)):
        raise missing(store, text, KIND, "batch")
    return batch


def _plan(store: Store, asked: Document) -> BatchPlan:
    """Returns the plan of a request whose worlds, versions, launch files, data and output bucket are there."""
    section = cast("SimulationBatch", pipeline_of_request(asked, Path(_SOURCE)).simulationBatch)
    try:
        require_output(store, output_location(section).s3Bucket, "outputLocation.s3Bucket")
        plan = batch_plan(section, (), store, latest_finder(store))
        faults = launch_faults(plan, store)
    except DocumentError as exc:
        raise type(exc)([in_request(fault, asked) for fault in exc.faults], _SOURCE) from exc
    if faults:
        raise DocumentError([in_request(fault, asked) for fault in faults], _SOURCE)
    return plan


def _asked_in(record: JobRecord) -> Document:
    return cast("Document", record.request["request"])


HANDLERS: Handlers = {
    "StartSimulationJobBatch": start,
    "DescribeSimulationJobBatch": describe,
    "CancelSimulationJobBatch": cancel,
}
