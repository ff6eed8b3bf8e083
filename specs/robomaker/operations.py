"""RoboMaker's interface as data: its operations, how many of what an account may have, the shapes by name."""

from collections.abc import Mapping
from functools import cache
from types import ModuleType
from typing import Annotated, Any, Literal, NamedTuple, get_origin

from specs import field_types
from specs.base import Spec
from specs.robomaker import applications, deployment, shared_operations, simulation, simulation_descriptions, world_jobs
from specs.settings import CountSetting

Right = Literal["read", "simulate", "deploy", "tag"]
"""What a key must be allowed for a call; for ``tag`` the kind of the tagged resource decides."""
ErrorName = Literal[
    "InvalidParameter",
    "InternalServer",
    "Throttling",
    "ResourceNotFound",
    "ResourceAlreadyExists",
    "LimitExceeded",
    "IdempotentParameterMismatch",
    "ConcurrentDeployment",
    "ServiceUnavailable",
]
"""RoboMaker's nine exceptions, without the word Exception."""
TAGS = "/tags/{resourceArn}"


# The errors are those that the interface documents for an operation; each operation may answer
# InvalidParameterException and InternalServerException besides.
class Operation(NamedTuple):
    """An operation of the interface.

    Attributes:
        name: Such as ``CreateFleet``; its request is ``CreateFleetRequest``, its answer ``CreateFleetResponse``.
        right: What a key must be allowed.
        errors: What it may answer.
        method: HTTP's.
        path: Of its URL; tags have the resource's ARN in it.
        pages: The answer's list that comes in pages; empty if there is none.
        idempotent: Whether SDKs fill in its ``clientRequestToken``.
    """

    name: str
    right: Right
    errors: tuple[ErrorName, ...]
    method: str
    path: str
    pages: str
    idempotent: bool

    @property
    def request(self) -> str:
        """The name of the shape of its request."""
        return f"{self.name}Request"

    @property
    def answer(self) -> str:
        """The name of the shape of its answer."""
        return f"{self.name}Response"


def _operation(
    name: str,
    right: Right,
    *errors: ErrorName,
    method: str = "POST",
    path: str = "",
    pages: str = "",
    idempotent: bool = False,
) -> Operation:
    own = path or f"/{name[0].lower()}{name[1:]}"
    return Operation(name, right, ("InvalidParameter", "InternalServer", *errors), method, own, pages, idempotent)


_ALL = (
    _operation("BatchDeleteWorlds", "simulate", "Throttling"),
    _operation("BatchDescribeSimulationJob", "read", "Throttling", "ResourceNotFound"),
    _operation("CancelDeploymentJob", "deploy", "Throttling", "ResourceNotFound"),
    _operation("CancelSimulationJob", "simulate", "Throttling", "ResourceNotFound"),
    _operation("CancelSimulationJobBatch", "simulate", "Throttling", "ResourceNotFound"),
    _operation("CancelWorldExportJob", "simulate", "Throttling", "ResourceNotFound"),
    _operation("CancelWorldGenerationJob", "simulate", "Throttling", "ResourceNotFound"),
    _operation(
        "CreateDeploymentJob",
        "deploy",
        "Throttling",
        "ResourceNotFound",
        "LimitExceeded",
        "IdempotentParameterMismatch",
        "ConcurrentDeployment",
        idempotent=True,
    ),
    _operation("CreateFleet", "deploy", "Throttling", "LimitExceeded"),
    _operation("CreateRobot", "deploy", "Throttling", "ResourceAlreadyExists", "LimitExceeded"),
    _operation(
        "CreateRobotApplication",
        "simulate",
        "Throttling",
        "ResourceAlreadyExists",
        "LimitExceeded",
        "IdempotentParameterMismatch",
    ),
    _operation(
        "CreateRobotApplicationVersion", "simulate", "Throttling", "LimitExceeded", "IdempotentParameterMismatch"
    ),
    _operation(
        "CreateSimulationApplication",
        "simulate",
        "Throttling",
        "ResourceAlreadyExists",
        "LimitExceeded",
        "IdempotentParameterMismatch",
    ),
    _operation(
        "CreateSimulationApplicationVersion", "simulate", "Throttling", "LimitExceeded", "IdempotentParameterMismatch"
    ),
    _operation(
        "CreateSimulationJob",
        "simulate",
        "Throttling",
        "ResourceNotFound",
        "LimitExceeded",
        "IdempotentParameterMismatch",
        "ServiceUnavailable",
        idempotent=True,
    ),
    _operation(
        "CreateWorldExportJob",
        "simulate",
        "Throttling",
        "ResourceNotFound",
        "IdempotentParameterMismatch",
        "ServiceUnavailable",
        idempotent=True,
    ),
    _operation(
        "CreateWorldGenerationJob",
        "simulate",
        "Throttling",
        "ResourceNotFound",
        "LimitExceeded",
        "IdempotentParameterMismatch",
        "ServiceUnavailable",
        idempotent=True,
    ),
    _operation(
        "CreateWorldTemplate", "simulate", "Throttling", "ResourceNotFound", "ResourceAlreadyExists", "LimitExceeded"
    ),
    _operation("DeleteFleet", "deploy", "Throttling"),
    _operation("DeleteRobot", "deploy", "Throttling"),
    _operation("DeleteRobotApplication", "simulate", "Throttling"),
    _operation("DeleteSimulationApplication", "simulate", "Throttling"),
    _operation("DeleteWorldTemplate", "simulate", "Throttling", "ResourceNotFound"),
    _operation("DeregisterRobot", "deploy", "Throttling", "ResourceNotFound"),
    _operation("DescribeDeploymentJob", "read", "Throttling", "ResourceNotFound"),
    _operation("DescribeFleet", "read", "Throttling", "ResourceNotFound"),
    _operation("DescribeRobot", "read", "Throttling", "ResourceNotFound"),
    _operation("DescribeRobotApplication", "read", "Throttling", "ResourceNotFound"),
    _operation("DescribeSimulationApplication", "read", "Throttling", "ResourceNotFound"),
    _operation("DescribeSimulationJob", "read", "Throttling", "ResourceNotFound"),
    _operation("DescribeSimulationJobBatch", "read", "ResourceNotFound"),
    _operation("DescribeWorld", "read", "Throttling", "ResourceNotFound"),
    _operation("DescribeWorldExportJob", "read", "Throttling", "ResourceNotFound"),
    _operation("DescribeWorldGenerationJob", "read", "Throttling", "ResourceNotFound"),
    _operation("DescribeWorldTemplate", "read", "Throttling", "ResourceNotFound"),
    _operation("GetWorldTemplateBody", "read", "Throttling", "ResourceNotFound"),
    _operation("ListDeploymentJobs", "read", "Throttling", "ResourceNotFound", pages="deploymentJobs"),
    _operation("ListFleets", "read", "Throttling", "ResourceNotFound", pages="fleetDetails"),
    _operation("ListRobotApplications", "read", "Throttling", pages="robotApplicationSummaries"),
    _operation("ListRobots", "read", "Throttling", "ResourceNotFound", pages="robots"),
    _operation("ListSimulationApplications", "read", "Throttling", pages="simulationApplicationSummaries"),
    _operation("ListSimulationJobBatches", "read", pages="simulationJobBatchSummaries"),
    _operation("ListSimulationJobs", "read", "Throttling", pages="simulationJobSummaries"),
    _operation("ListTagsForResource", "read", "Throttling", "ResourceNotFound", method="GET", path=TAGS),
    _operation("ListWorldExportJobs", "read", "Throttling", pages="worldExportJobSummaries"),
    _operation("ListWorldGenerationJobs", "read", "Throttling", pages="worldGenerationJobSummaries"),
    _operation("ListWorldTemplates", "read", "Throttling", pages="templateSummaries"),
    _operation("ListWorlds", "read", "Throttling", pages="worldSummaries"),
    _operation("RegisterRobot", "deploy", "Throttling", "ResourceNotFound", "LimitExceeded"),
    _operation("RestartSimulationJob", "simulate", "Throttling", "ResourceNotFound", "LimitExceeded"),
    _operation(
        "StartSimulationJobBatch",
        "simulate",
        "Throttling",
        "LimitExceeded",
        "IdempotentParameterMismatch",
        idempotent=True,
    ),
    _operation(
        "SyncDeploymentJob",
        "deploy",
        "Throttling",
        "ResourceNotFound",
        "LimitExceeded",
        "IdempotentParameterMismatch",
        "ConcurrentDeployment",
        idempotent=True,
    ),
    _operation("TagResource", "tag", "Throttling", "ResourceNotFound", method="POST", path=TAGS),
    _operation("UntagResource", "tag", "Throttling", "ResourceNotFound", method="DELETE", path=TAGS),
    _operation("UpdateRobotApplication", "simulate", "Throttling", "ResourceNotFound", "LimitExceeded"),
    _operation("UpdateSimulationApplication", "simulate", "Throttling", "ResourceNotFound", "LimitExceeded"),
    _operation("UpdateWorldTemplate", "simulate", "Throttling", "ResourceNotFound"),
)
OPERATIONS: Mapping[str, Operation] = {each.name: each for each in _ALL}
"""All operations, by name."""
Location = Literal["uri", "querystring", "body"]
"""Where a member of a request is sent."""


def location(operation: Operation, member: str) -> Location:
    """Returns where a member of an operation's request is sent: what the path does not name, GET and DELETE query."""
    if f"{{{member}}}" in operation.path:
        return "uri"
    return "body" if operation.method == "POST" else "querystring"


STATUSES: Mapping[ErrorName, int] = {"InternalServer": 500, "ServiceUnavailable": 503}
"""The HTTP status of an error; 400 where none is named (docs/reference/robomaker.md, section 1)."""


GENERATION_JOBS = CountSetting("SIMYARD_MAX_GENERATION_JOBS", 100, "world generation jobs at a time")
EXPORT_JOBS = CountSetting("SIMYARD_MAX_EXPORT_JOBS", 100, "world export jobs at a time")
BATCHES = CountSetting("SIMYARD_MAX_BATCHES", 100, "simulation job batches at a time")
SIMULATION_JOBS = CountSetting("SIMYARD_MAX_SIMULATION_JOBS", 1000, "single simulation jobs at a time")
DEPLOYMENTS = CountSetting("SIMYARD_MAX_DEPLOYMENTS", 100, "deployment jobs at a time")
APPLICATIONS = CountSetting("SIMYARD_MAX_APPLICATIONS", 100, "applications of a kind")
TEMPLATES = CountSetting("SIMYARD_MAX_TEMPLATES", 100, "world templates")
FLEETS = CountSetting("SIMYARD_MAX_FLEETS", 20, "fleets")
ROBOTS = CountSetting("SIMYARD_MAX_ROBOTS", 1000, "robots")
FLEET_ROBOTS = CountSetting("SIMYARD_MAX_FLEET_ROBOTS", 1000, "robots of a fleet")


_MODULES: tuple[ModuleType, ...] = (
    field_types,
    applications,
    deployment,
    simulation,
    simulation_descriptions,
    shared_operations,
    world_jobs,
)


@cache
def document_shapes() -> Mapping[str, type[Spec]]:
    """Returns the document class of each shape that is a structure, and of what several of them have in common."""
    return {
        name: value
        for module in _MODULES
        for name, value in vars(module).items()
        if isinstance(value, type) and issubclass(value, Spec) and value.__module__ == module.__name__
    }


@cache
def aliases() -> Mapping[str, Any]:
    """Returns the types of texts, numbers, lists and maps that have the name of a shape, by name."""
    return {
        name: value
        for module in _MODULES
        for name, value in vars(module).items()
        if get_origin(value) in {Annotated, Literal, tuple} and not name.startswith("_")
    }
