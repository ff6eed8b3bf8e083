"""World generation jobs: CreateWorldGenerationJob, and the calls about such a job."""

import hashlib

from flows.gateway.gateway import Gateway, Handlers
from flows.gateway.jobs.admission import Admission, Document, NewRecord, admit, asked_document, token_of, without
from flows.gateway.jobs.answer import answer_of
from flows.gateway.jobs.wish import wish_canceled
from flows.gateway.references import path_of
from specs.interface.quotas import GENERATION_JOBS
from specs.job_kinds import JobKind
from specs.pipeline.world_sections import MAX_SEED
from specs.robomaker.world_descriptions import DescribeWorldGenerationJobResponse
from specs.robomaker.world_jobs import (
    CancelWorldGenerationJobRequest,
    CancelWorldGenerationJobResponse,
    CreateWorldGenerationJobRequest,
    CreateWorldGenerationJobResponse,
    DescribeWorldGenerationJobRequest,
)
from specs.template.body import TemplateBody
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, read
from tasks.storage.templates.named_templates import digest_now, keep_body, read_body
from tasks.worlds.job.describe import describe_generation_job

KIND: JobKind = "world-generation-job"
_OWN = ("seed", "templateDigest")


def create(gateway: Gateway, request: CreateWorldGenerationJobRequest) -> CreateWorldGenerationJobResponse:
    """Answers CreateWorldGenerationJob: the job waits for a worker, with the body that its template has now."""
    store, token = gateway.store, token_of(request)

    def checked() -> NewRecord:
        digest = template_digest_of(store, request.template)
        return NewRecord({**asked, "seed": _seed(token), "templateDigest": digest})

    asked = asked_document(request, token)
    record = admit(store, Admission(KIND, token, asked, _asked_in, checked, GENERATION_JOBS))
    gateway.wake()
    return answer_of(CreateWorldGenerationJobResponse, describe_generation_job(record), store)


def describe(gateway: Gateway, request: DescribeWorldGenerationJobRequest) -> DescribeWorldGenerationJobResponse:
    """Answers DescribeWorldGenerationJob."""
    store = gateway.store
    record = read(store, KIND, path_of(store, request.job, KIND, "job"))
    return answer_of(DescribeWorldGenerationJobResponse, describe_generation_job(record), store)


def cancel(gateway: Gateway, request: CancelWorldGenerationJobRequest) -> CancelWorldGenerationJobResponse:
    """Answers CancelWorldGenerationJob."""
    wish_canceled(gateway.store, KIND, path_of(gateway.store, request.job, KIND, "job"))
    gateway.wake()
    return CancelWorldGenerationJobResponse()


def template_digest_of(store: Store, template: str) -> str:
    """Returns the digest of the body that a template has now, by the template's ARN; the body is in the store.

    Raises:
        ResourceNotFound: There is no such template.
    """
    digest = digest_now(store, path_of(store, template, "world-template", "template"))
    return keep_body(store, TemplateBody.model_validate_json(read_body(store, digest)))


def _seed(token: str) -> int:
    """Returns the seed of a token's worlds: RoboMaker's jobs made other worlds each, and a token is one job."""
    return int.from_bytes(hashlib.sha256(token.encode()).digest()[:8], "big") % (MAX_SEED + 1)


def _asked_in(record: JobRecord) -> Document:
    return without(record.request, _OWN)


HANDLERS: Handlers = {
    "CreateWorldGenerationJob": create,
    "DescribeWorldGenerationJob": describe,
    "CancelWorldGenerationJob": cancel,
}
