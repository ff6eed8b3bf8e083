"""Calls about the tags of whatever has an ARN: applications, templates, worlds, jobs, batches, fleets, robots."""

from collections.abc import Callable, Mapping
from typing import cast

from flows.gateway.gateway import ROBOMAKER_KINDS, Gateway, Handlers, missing, referenced
from specs.arn import Reference, ResourceKind, arn
from specs.data.outcomes import MOST_OWN_TAGS, is_reserved
from specs.job_kinds import JobKind
from specs.robomaker.bundle import ApplicationKind
from specs.robomaker.shared_operations import (
    ListTagsForResourceRequest,
    ListTagsForResourceResponse,
    TagResourceRequest,
    TagResourceResponse,
    UntagResourceRequest,
    UntagResourceResponse,
)
from tasks.applications.registry import resolve
from tasks.applications.versions import change_application_tags, read_application
from tasks.deploy.fleet.fleet_registry import change_fleet_tags, change_robot_tags, read_fleet, read_robot
from tasks.simulate.batch.batch_jobs import describe_job
from tasks.simulate.plan.plan_batch import is_single, policy_and_tags
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import read
from tasks.storage.store_url import store_id
from tasks.storage.tags import (
    TAGS_AT_MOST,
    Change,
    Tags,
    are_in_record,
    change_tags,
    tags_of,
    with_tags,
    without_tags,
)
from tasks.storage.templates import change_template
from tasks.worlds.job.world_answers import describe_stored_world, describe_template

_MEMBER = "resourceArn"
_BATCH: JobKind = "simulation-job-batch"


def _list(gateway: Gateway, request: ListTagsForResourceRequest) -> ListTagsForResourceResponse:
    store, resource = gateway.store, _resource(gateway.store, request.resourceArn)
    return ListTagsForResourceResponse(tags=tags_of(store, resource, _tags_said(store, resource)))


def _tag(gateway: Gateway, request: TagResourceRequest) -> TagResourceResponse:
    resource = _resource(gateway.store, request.resourceArn)
    most = MOST_OWN_TAGS if resource.kind == "simulation-job" else TAGS_AT_MOST
    _change(gateway.store, resource, with_tags(request.tags, most))
    return TagResourceResponse()


def _untag(gateway: Gateway, request: UntagResourceRequest) -> UntagResourceResponse:
    _change(gateway.store, _resource(gateway.store, request.resourceArn), without_tags(request.tagKeys))
    return UntagResourceResponse()


def _resource(store: Store, text: str) -> Reference:
    return referenced(store, text, ROBOMAKER_KINDS, _MEMBER)


def _change(store: Store, resource: Reference, change: Change) -> None:
    """Changes tags where they are: in the resource's record, or beside it."""
    path = resource.path
    match resource.kind:
        case "robot":
            change_robot_tags(store, path, change)
        case "deployment-fleet":
            change_fleet_tags(store, path, change)
        case "robot-application" | "simulation-application":
            _application_tags(store, resource.kind, path)  # one that comes with Simyard has a record from now on
            change_application_tags(store, resource.kind, path, change)
        case _ if are_in_record(resource):
            change_template(store, path, lambda found: found.model_copy(update={"tags": change(found.tags)}))
        case _:
            change_tags(store, resource, lambda: _own(_tags_said(store, resource)), change)


def _tags_said(store: Store, resource: Reference) -> Tags:
    """Returns the tags in a resource's record or request, and those that Simyard gives it.

    Raises:
        ResourceNotFound: There is no such resource.
    """
    for kind, read_tags in _SAID.items():
        if kind == resource.kind:
            return read_tags(store, resource.path)
    raise ValueError(f"{resource.kind!r} is no kind of resource that has tags")


def _application_tags(store: Store, kind: ApplicationKind, name: str) -> Tags:
    found = read_application(store, kind, name)
    if found is None:
        resolve(store, kind, name)
        found = read_application(store, kind, name)
    return found.tags if found else {}


def _job_tags(kind: JobKind) -> Callable[[Store, str], Tags]:
    return lambda store, job: cast("Tags", read(store, kind, job).request.get("tags") or {})


def _batch_tags(store: Store, batch: str) -> Tags:
    record = read(store, _BATCH, batch)
    if is_single(record):  # CreateSimulationJob makes a job, and no batch that anybody has been told of
        raise missing(store, arn(_BATCH, store_id(store), batch), _BATCH, _MEMBER)
    return policy_and_tags(record)[1] or {}


def _own(tags: Tags) -> Tags:
    return {key: value for key, value in tags.items() if not is_reserved(key)}


_SAID: Mapping[ResourceKind, Callable[[Store, str], Tags]] = {
    "robot": lambda store, robot: read_robot(store, robot).tags,
    "deployment-fleet": lambda store, fleet: read_fleet(store, fleet).tags,
    "robot-application": lambda store, name: _application_tags(store, "robot-application", name),
    "simulation-application": lambda store, name: _application_tags(store, "simulation-application", name),
    "world-template": lambda store, template: describe_template(store, template).tags or {},
    "world": lambda store, world: describe_stored_world(store, world).tags or {},
    "simulation-job": lambda store, job: describe_job(store, job).tags or {},
    "simulation-job-batch": _batch_tags,
    "world-generation-job": _job_tags("world-generation-job"),
    "world-export-job": _job_tags("world-export-job"),
    "deployment-job": _job_tags("deployment-job"),
}
HANDLERS: Handlers = {"ListTagsForResource": _list, "TagResource": _tag, "UntagResource": _untag}
