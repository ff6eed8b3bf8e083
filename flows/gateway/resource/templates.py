"""Calls about world templates."""

from contextlib import nullcontext

from flows.gateway.gateway import Gateway, Handlers
from flows.gateway.references import path_of
from flows.gateway.resource.quota import one_more
from flows.resource.tags_now import with_tags_now
from specs.base import Fault
from specs.errors import DocumentError, ResourceNotFound
from specs.interface.quotas import TEMPLATES
from specs.job_kinds import JobKind
from specs.robomaker.world_descriptions import DescribeWorldTemplateResponse
from specs.robomaker.world_jobs import (
    CreateWorldTemplateRequest,
    CreateWorldTemplateResponse,
    DeleteWorldTemplateRequest,
    DeleteWorldTemplateResponse,
    DescribeWorldTemplateRequest,
    GetWorldTemplateBodyRequest,
    GetWorldTemplateBodyResponse,
    UpdateWorldTemplateRequest,
    UpdateWorldTemplateResponse,
)
from specs.template.body import TemplateBody
from tasks.documents.template_source import find_template_in_bucket
from tasks.storage.base.keys import NAMED_TEMPLATE_PREFIX
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import read
from tasks.storage.tags import require_free_keys
from tasks.storage.templates.named_templates import (
    create_template,
    delete_template,
    digest_now,
    is_made,
    read_body,
    read_template,
    template_count,
    update_template,
)
from tasks.worlds.job.describe import describe_named_template, describe_template

_GENERATION: JobKind = "world-generation-job"


def _create(gateway: Gateway, request: CreateWorldTemplateRequest) -> CreateWorldTemplateResponse:
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


def _update(gateway: Gateway, request: UpdateWorldTemplateRequest) -> UpdateWorldTemplateResponse:
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


def _delete(gateway: Gateway, request: DeleteWorldTemplateRequest) -> DeleteWorldTemplateResponse:
    delete_template(gateway.store, _named(gateway.store, request.template))
    return DeleteWorldTemplateResponse()


def _describe(gateway: Gateway, request: DescribeWorldTemplateRequest) -> DescribeWorldTemplateResponse:
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
    raise ResourceNotFound([Fault(path="template", value=repr(text), allowed=allowed)])


def _refused(path: str, value: str, allowed: str) -> DocumentError:
    return DocumentError([Fault(path=path, value=value, allowed=allowed)])


HANDLERS: Handlers = {
    "CreateWorldTemplate": _create,
    "DeleteWorldTemplate": _delete,
    "DescribeWorldTemplate": _describe,
    "GetWorldTemplateBody": _body_text,
    "UpdateWorldTemplate": _update,
}
