"""What a key may do: its rights, and the resources that it is limited to.

A deployment, and a robot in a fleet, are that fleet's: who is limited to one fleet reaches no robot and no deployment
of another. A call that makes something without a name, and a list, need the whole kind: what they are about is not
known before they are done.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

from specs.arn import ResourceKind, parse_reference, resource_kind
from specs.base import Spec
from specs.errors import AccessRefused
from specs.robomaker.operations import Operation
from tasks.gateway.access.access_keys import AccessKey, KeyRight
from tasks.gateway.rest_json import with_arns

FleetOf = Callable[[ResourceKind, str], str]
"""The fleet that a robot is in, or that a deployment is of; empty if there is none."""
_OF_FLEETS: frozenset[ResourceKind | None] = frozenset({"deployment-fleet", "robot", "deployment-job"})
_NAMED: Mapping[str, ResourceKind] = {
    "CreateFleet": "deployment-fleet",
    "CreateRobot": "robot",
    "CreateRobotApplication": "robot-application",
    "CreateSimulationApplication": "simulation-application",
    "CreateWorldTemplate": "world-template",
    "UpdateWorldTemplate": "world-template",
}
"""What has the name that its request says."""
WHOLE: Mapping[str, tuple[ResourceKind, ...]] = {
    "CreateSimulationJob": ("simulation-job", "simulation-job-batch"),
    "StartSimulationJobBatch": ("simulation-job", "simulation-job-batch"),
    "CreateWorldExportJob": ("world-export-job",),
    "CreateWorldGenerationJob": ("world-generation-job",),
    "ListDeploymentJobs": ("deployment-fleet",),
    "ListFleets": ("deployment-fleet",),
    "ListRobotApplications": ("robot-application",),
    "ListRobots": ("deployment-fleet", "robot"),
    "ListSimulationApplications": ("simulation-application",),
    "ListSimulationJobBatches": ("simulation-job-batch",),
    "ListSimulationJobs": ("simulation-job",),
    "ListWorldExportJobs": ("world-export-job",),
    "ListWorldGenerationJobs": ("world-generation-job",),
    "ListWorldTemplates": ("world-template",),
    "ListWorlds": ("world",),
}
"""The kinds of which an operation needs all."""


class _Named(NamedTuple):
    kind: ResourceKind | None
    path: str
    text: str


def check_right(key: AccessKey, operation: Operation, document: Spec, store_id: str, fleet_of: FleetOf) -> None:
    """Passes if a key may make a call.

    Args:
        key: Whose signature was checked.
        operation: What is asked for.
        document: The request, checked, with ARNs in Simyard's own form.
        store_id: Of the store that is asked.
        fleet_of: Says which fleet something belongs to.

    Raises:
        AccessRefused: The right is missing, or something that the call is about is outside the key's limits.
    """
    right = right_for(operation, document)
    if right not in key.rights:
        raise _denied(key, operation, f"it lacks the right {right}")
    if not key.scopes:
        return
    for kind in _whole_kinds(operation, document):
        if not any(scope.covers_all(kind, store_id) for scope in key.scopes):
            raise _denied(key, operation, f"that needs all of {kind}/*, and its limits are narrower")
    for named in _named(operation, document):
        if not _covered(key, named, store_id, fleet_of):
            raise _denied(key, operation, f"its limits do not cover {_shown(named)!r}")


def right_for(operation: Operation, document: Spec) -> KeyRight:
    """Returns the right that a call needs; for tags the kind of the tagged resource says it."""
    if operation.right != "tag":
        return operation.right
    return "deploy" if any(resource_kind(text) in _OF_FLEETS for text in request_arns(document)) else "simulate"


def request_arns(document: Spec) -> tuple[str, ...]:
    """Returns the ARNs of all resources that a request names, each once."""
    found: dict[str, None] = {}

    def note(text: str) -> str:
        found[text] = None
        return text

    with_arns(document.model_dump(mode="json", exclude_none=True), type(document), note)
    return tuple(found)


def _whole_kinds(operation: Operation, document: Spec) -> tuple[ResourceKind, ...]:
    unnamed = operation.name.startswith("Create") and operation.name in _NAMED and not getattr(document, "name", None)
    return (_NAMED[operation.name],) if unnamed else WHOLE.get(operation.name, ())


def _named(operation: Operation, document: Spec) -> Iterator[_Named]:
    for text in request_arns(document):
        try:
            reference = parse_reference(text)
            yield _Named(reference.kind, reference.path, text)
        except ValueError:  # an ARN of nothing that a limit could cover
            yield _Named(None, "", text)
    name = getattr(document, "name", None)
    if operation.name in _NAMED and name is not None:
        yield _Named(_NAMED[operation.name], str(name), str(name))


def is_within(key: AccessKey, kind: ResourceKind, path: str, store_id: str, fleet_of: FleetOf) -> bool:
    """Returns whether a resource is within the limits of a key; whether it may read is another question."""
    return not key.scopes or _covered(key, _Named(kind, path, ""), store_id, fleet_of)


def _covered(key: AccessKey, named: _Named, store_id: str, fleet_of: FleetOf) -> bool:
    if named.kind is None:
        return False
    kind, path = named.kind, named.path
    if kind in {"robot", "deployment-job"}:
        fleet = fleet_of(kind, path)
        if kind == "deployment-job" or fleet:
            kind, path = "deployment-fleet", fleet
    return bool(path) and any(scope.covers(kind, path, store_id) for scope in key.scopes)


def _shown(named: _Named) -> str:
    """Returns what ``simyard access add --on`` takes; of a text that is no ARN, the text."""
    return (f"{named.kind}/{named.path}" if named.kind and named.path else named.text)[:300]


def _denied(key: AccessKey, operation: Operation, why: str) -> AccessRefused:
    return AccessRefused("AccessDeniedException", f"the access key {key.name} may not {operation.name}: {why}")
