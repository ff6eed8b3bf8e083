"""World export jobs: CreateWorldExportJob, and the calls about such a job."""

from collections.abc import Iterator

from flows.gateway.gateway import Gateway, Handlers
from flows.gateway.jobs.admission import Admission, Document, NewRecord, admit, asked_document, token_of, without
from flows.gateway.jobs.answer import answer_of
from flows.gateway.jobs.output import require_output
from flows.gateway.jobs.wish import wish_canceled
from flows.gateway.references import missing, path_of
from specs.errors import DocumentError, ResourceNotFound
from specs.interface.quotas import EXPORT_JOBS
from specs.job_kinds import JobKind
from specs.pipeline.world_sections import WorldExport, WorldFormat
from specs.robomaker.world_descriptions import DescribeWorldExportJobResponse
from specs.robomaker.world_jobs import (
    CancelWorldExportJobRequest,
    CancelWorldExportJobResponse,
    CreateWorldExportJobRequest,
    CreateWorldExportJobResponse,
    DescribeWorldExportJobRequest,
)
from tasks.export.format.formats import require_writable
from tasks.export.job.describe import describe_export_job
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, read
from tasks.storage.worlds import reference_key

KIND: JobKind = "world-export-job"
# RoboMaker's request has no formats: those of a document that names none.
_FORMATS: tuple[WorldFormat, ...] = WorldExport.model_fields["formats"].default
_OWN = ("formats",)


def create(gateway: Gateway, request: CreateWorldExportJobRequest) -> CreateWorldExportJobResponse:
    """Answers CreateWorldExportJob: the job waits for a worker."""
    store, token = gateway.store, token_of(request)

    def checked() -> NewRecord:
        _require_worlds(store, request)
        require_output(store, request.outputLocation.s3Bucket, "outputLocation.s3Bucket")
        require_writable(_FORMATS, "request")
        return NewRecord({**asked, "formats": [*sorted(_FORMATS)]})

    asked = asked_document(request, token)
    record = admit(store, Admission(KIND, token, asked, _asked_in, checked, EXPORT_JOBS))
    gateway.wake()
    return answer_of(CreateWorldExportJobResponse, describe_export_job(record), store)


def describe(gateway: Gateway, request: DescribeWorldExportJobRequest) -> DescribeWorldExportJobResponse:
    """Answers DescribeWorldExportJob."""
    store = gateway.store
    record = read(store, KIND, path_of(store, request.job, KIND, "job"))
    return answer_of(DescribeWorldExportJobResponse, describe_export_job(record), store)


def cancel(gateway: Gateway, request: CancelWorldExportJobRequest) -> CancelWorldExportJobResponse:
    """Answers CancelWorldExportJob."""
    wish_canceled(gateway.store, KIND, path_of(gateway.store, request.job, KIND, "job"))
    gateway.wake()
    return CancelWorldExportJobResponse()


def _require_worlds(store: Store, request: CreateWorldExportJobRequest) -> None:
    """Does nothing if all worlds are there.

    Raises:
        DocumentError: Some are no worlds; or, as ResourceNotFound, some are not there.
    """
    faults = [*_world_faults(store, request)]
    if faults:
        gone = all(isinstance(each, ResourceNotFound) for each in faults)
        raise (ResourceNotFound if gone else DocumentError)([fault for each in faults for fault in each.faults])


def _world_faults(store: Store, request: CreateWorldExportJobRequest) -> Iterator[DocumentError]:
    for number, world in enumerate(request.worlds):
        member = f"worlds[{number}]"
        try:
            if not store.exists(reference_key(path_of(store, world, "world", member))):
                yield missing(store, world, "world", member)
        except DocumentError as exc:
            yield exc


def _asked_in(record: JobRecord) -> Document:
    return without(record.request, _OWN)


HANDLERS: Handlers = {
    "CreateWorldExportJob": create,
    "DescribeWorldExportJob": describe,
    "CancelWorldExportJob": cancel,
}
