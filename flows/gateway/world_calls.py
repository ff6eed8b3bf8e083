"""Calls about world templates, about worlds, and about the jobs that generate and export them."""

import hashlib
from collections.abc import Iterator
from contextlib import nullcontext

from flows.gateway.admission import (
    Admission,
    Document,
    NewRecord,
    admit,
    answer_of,
    asked_document,
    cancel_recorded_job,
    require_output,
    token_of,
    without,
)
from flows.gateway.gateway import Gateway, Handlers, missing, one_more, path_of
from flows.resources.kinds import with_tags_now
from specs.errors import DocumentError, ResourceNotFound
from specs.job_kinds import JobKind
from specs.pipeline.world_sections import MAX_SEED, WorldExport, WorldFormat
from specs.robomaker.operations import EXPORT_JOBS, GENERATION_JOBS, TEMPLATES
from specs.robomaker.world_jobs import (
    BatchDeleteWorldsRequest,
    BatchDeleteWorldsResponse,
    CancelWorldExportJobRequest,
    CancelWorldExportJobResponse,
    CancelWorldGenerationJobRequest,
    CancelWorldGenerationJobResponse,
    CreateWorldExportJobRequest,
    CreateWorldExportJobResponse,
    CreateWorldGenerationJobRequest,
    CreateWorldGenerationJobResponse,
    CreateWorldTemplateRequest,
    CreateWorldTemplateResponse,
    DeleteWorldTemplateRequest,
    DeleteWorldTemplateResponse,
    DescribeWorldExportJobRequest,
    DescribeWorldExportJobResponse,
    DescribeWorldGenerationJobRequest,
    DescribeWorldGenerationJobResponse,
    DescribeWorldRequest,
    DescribeWorldResponse,
    DescribeWorldTemplateRequest,
    DescribeWorldTemplateResponse,
    GetWorldTemplateBodyRequest,
    GetWorldTemplateBodyResponse,
    UpdateWorldTemplateRequest,
    UpdateWorldTemplateResponse,
)
from specs.template.body import TemplateBody
from tasks.documents.template_source import find_template_in_bucket
from tasks.export.format.formats import require_writable
from tasks.export.job.export_answers import describe_export_job
from tasks.storage.base.keys import NAMED_TEMPLATE_PREFIX
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, read
from tasks.storage.tags import require_free_keys
from tasks.storage.templates import (
    create_template,
    delete_template,
    digest_now,
    is_made,
    keep_body,
    read_body,
    read_template,
    template_count,
    update_template,
)
from tasks.storage.worlds import reference_key
from tasks.worlds.job.stored_worlds import delete_worlds
from tasks.worlds.job.world_answers import (
    describe_generation_job,
    describe_named_template,
    describe_stored_world,
    describe_template,
)

_GENERATION: JobKind = "world-generation-job"
_GENERATION_OWN = ("seed", "templateDigest")
_EXPORT: JobKind = "world-export-job"
# RoboMaker's request has no formats: those of a document that names none.
_FORMATS: tuple[WorldFormat, ...] = WorldExport.model_fields["formats"].default
_EXPORT_OWN = ("formats",)


def _create_template(gateway: Gateway, request: CreateWorldTemplateRequest) -> CreateWorldTemplateResponse:
    store, token = gateway.store, request.clientRequestToken or ""
    require_free_keys(request.tags or {}, "tags")
    body = _body(store, request)
    if body is None:
        raise _refused("templateBody", "none", "templateBody or templateLocation")
    count = one_more(TEMPLATES, lambda: template_count(store))
    with nullcontext() if is_made(store, name=request.name or "", token=token) else count:
        made = create_template(store, body, name=request.name or "", tags=request.tags, token=token)
    return CreateWorldTemplateResponse.model_validate(
        describe_named_template(store, made).model_dump(exclude={"lastUpdatedAt", "version"})
    )


def _update_template(gateway: Gateway, request: UpdateWorldTemplateRequest) -> UpdateWorldTemplateResponse:
    store = gateway.store
    template = _named(store, request.template)
    read_template(store, template)  # before a bucket is read for one that is not there
    body = _body(store, request)
    if body is None and request.name is None:
        raise _refused("templateBody", "none", "templateBody, templateLocation or name: there is nothing to change")
    after = update_template(store, template, body=body, name=request.name)
    return UpdateWorldTemplateResponse.model_validate(
        describe_named_template(store, after).model_dump(exclude={"clientRequestToken", "tags", "version"})
    )


def _delete_template(gateway: Gateway, request: DeleteWorldTemplateRequest) -> DeleteWorldTemplateResponse:
    delete_template(gateway.store, _named(gateway.store, request.template))
    return DeleteWorldTemplateResponse()


def _describe_template(gateway: Gateway, request: DescribeWorldTemplateRequest) -> DescribeWorldTemplateResponse:
    template = _template(gateway.store, request.template)
    return with_tags_now(gateway.store, "world-template", template, describe_template(gateway.store, template))


def _body_text(gateway: Gateway, request: GetWorldTemplateBodyRequest) -> GetWorldTemplateBodyResponse:
    store = gateway.store
    if (request.template is None) == (request.generationJob is None):
        raise _refused("template", "both or none", "template or generationJob")
    if request.generationJob is not None:
        job = path_of(store, request.generationJob, _GENERATION, "generationJob")
        digest = str(read(store, _GENERATION, job).request["templateDigest"])
    else:
        digest = digest_now(store, _template(store, request.template or ""))
    return GetWorldTemplateBodyResponse(templateBody=read_body(store, digest).decode())


def _body(store: Store, request: CreateWorldTemplateRequest | UpdateWorldTemplateRequest) -> TemplateBody | None:
    """Returns the body that a request gives, as text or by its place in a bucket; None where it gives none."""
    place = request.templateLocation
    if place is not None and request.templateBody is not None:
        raise _refused("templateLocation", "given with templateBody", "one of the two")
    if place is not None:
        return find_template_in_bucket(place.s3Bucket, place.s3Key, store)
    return TemplateBody.model_validate(request.templateBody) if request.templateBody is not None else None


def _template(store: Store, text: str) -> str:
    return path_of(store, text, "world-template", "template")


def _named(store: Store, text: str) -> str:
    """Returns the id of a template that a call may change: a body that jobs used stays what it was."""
    template = _template(store, text)
    if template.startswith(NAMED_TEMPLATE_PREFIX):
        return template
    allowed = "a template that CreateWorldTemplate made; what documents used has no name, and stays what it is"
    raise ResourceNotFound.of("template", repr(text), allowed)


def _refused(path: str, value: str, allowed: str) -> DocumentError:
    return DocumentError.of(path, value, allowed)


def _create_generation(gateway: Gateway, request: CreateWorldGenerationJobRequest) -> CreateWorldGenerationJobResponse:
    """Answers CreateWorldGenerationJob: the job waits for a worker, with the body that its template has now."""
    store, token = gateway.store, token_of(request)

    def checked() -> NewRecord:
        digest = template_digest_of(store, request.template)
        return NewRecord({**asked, "seed": _seed(token), "templateDigest": digest})

    asked = asked_document(request, token)
    record = admit(store, Admission(_GENERATION, token, asked, _generation_asked_in, checked, GENERATION_JOBS))
    gateway.wake()
    return answer_of(CreateWorldGenerationJobResponse, describe_generation_job(record), store)


def _describe_generation(
    gateway: Gateway, request: DescribeWorldGenerationJobRequest
) -> DescribeWorldGenerationJobResponse:
    """Answers DescribeWorldGenerationJob."""
    store = gateway.store
    record = read(store, _GENERATION, path_of(store, request.job, _GENERATION, "job"))
    return answer_of(DescribeWorldGenerationJobResponse, describe_generation_job(record), store)


def _cancel_generation(gateway: Gateway, request: CancelWorldGenerationJobRequest) -> CancelWorldGenerationJobResponse:
    """Answers CancelWorldGenerationJob."""
    cancel_recorded_job(gateway.store, _GENERATION, path_of(gateway.store, request.job, _GENERATION, "job"))
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


def _generation_asked_in(record: JobRecord) -> Document:
    return without(record.request, _GENERATION_OWN)


def _describe_world(gateway: Gateway, request: DescribeWorldRequest) -> DescribeWorldResponse:
    world = path_of(gateway.store, request.world, "world", "world")
    return with_tags_now(gateway.store, "world", world, describe_stored_world(gateway.store, world))


def _delete_worlds(gateway: Gateway, request: BatchDeleteWorldsRequest) -> BatchDeleteWorldsResponse:
    """Deletes what can be deleted; a call does not fail because of single worlds.

    See docs/reference/robomaker.md, section 9.
    """
    paths: dict[str, str] = {}
    left: list[str] = []
    for each in dict.fromkeys(request.worlds):
        try:
            paths[each] = path_of(gateway.store, each, "world", "worlds")
        except DocumentError:
            left.append(each)
    refused = set(delete_worlds(gateway.store, paths.values()))
    left += [each for each, path in paths.items() if path in refused]
    return BatchDeleteWorldsResponse(unprocessedWorlds=tuple(left) or None)


def _create_export(gateway: Gateway, request: CreateWorldExportJobRequest) -> CreateWorldExportJobResponse:
    """Answers CreateWorldExportJob: the job waits for a worker."""
    store, token = gateway.store, token_of(request)

    def checked() -> NewRecord:
        _require_worlds(store, request)
        require_output(store, request.outputLocation.s3Bucket, "outputLocation.s3Bucket")
        require_writable(_FORMATS, "request")
        return NewRecord({**asked, "formats": [*sorted(_FORMATS)]})

    asked = asked_document(request, token)
    record = admit(store, Admission(_EXPORT, token, asked, _export_asked_in, checked, EXPORT_JOBS))
    gateway.wake()
    return answer_of(CreateWorldExportJobResponse, describe_export_job(record), store)


def _describe_export(gateway: Gateway, request: DescribeWorldExportJobRequest) -> DescribeWorldExportJobResponse:
    """Answers DescribeWorldExportJob."""
    store = gateway.store
    record = read(store, _EXPORT, path_of(store, request.job, _EXPORT, "job"))
    return answer_of(DescribeWorldExportJobResponse, describe_export_job(record), store)


def _cancel_export(gateway: Gateway, request: CancelWorldExportJobRequest) -> CancelWorldExportJobResponse:
    """Answers CancelWorldExportJob."""
    cancel_recorded_job(gateway.store, _EXPORT, path_of(gateway.store, request.job, _EXPORT, "job"))
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


def _export_asked_in(record: JobRecord) -> Document:
    return without(record.request, _EXPORT_OWN)


HANDLERS: Handlers = {
    "CreateWorldTemplate": _create_template,
    "DeleteWorldTemplate": _delete_template,
    "DescribeWorldTemplate": _describe_template,
    "GetWorldTemplateBody": _body_text,
    "UpdateWorldTemplate": _update_template,
    "CreateWorldGenerationJob": _create_generation,
    "DescribeWorldGenerationJob": _describe_generation,
    "CancelWorldGenerationJob": _cancel_generation,
    "BatchDeleteWorlds": _delete_worlds,
    "DescribeWorld": _describe_world,
    "CreateWorldExportJob": _create_export,
    "DescribeWorldExportJob": _describe_export,
    "CancelWorldExportJob": _cancel_export,
}
