"""Calls about robot and simulation applications and their versions."""

from typing import TypeVar

from flows.gateway.gateway import Gateway, Handler, Handlers, one_more, path_of
from specs.base import Spec
from specs.errors import ResourceAlreadyExists
from specs.robomaker.applications import (
    CreateApplicationVersionRequest,
    CreateRobotApplicationRequest,
    CreateRobotApplicationResponse,
    CreateRobotApplicationVersionResponse,
    CreateSimulationApplicationRequest,
    CreateSimulationApplicationResponse,
    CreateSimulationApplicationVersionResponse,
    DeleteApplicationRequest,
    DeleteRobotApplicationResponse,
    DeleteSimulationApplicationResponse,
    DescribeRobotApplicationRequest,
    DescribeSimulationApplicationRequest,
    UpdateRobotApplicationRequest,
    UpdateRobotApplicationResponse,
    UpdateSimulationApplicationRequest,
    UpdateSimulationApplicationResponse,
)
from specs.robomaker.bundle import LATEST, ApplicationKind, Platform
from specs.robomaker.operations import APPLICATIONS
from tasks.applications.application_answers import describe_robot_application, describe_simulation_application
from tasks.applications.bucket_sources import (
    create_application,
    create_version,
    delete_application,
    update_application,
)
from tasks.applications.registry import applications
from tasks.applications.versions import read_application
from tasks.storage.base.keys import applications_prefix
from tasks.storage.base.store import Store
from tasks.storage.tags import require_free_keys

_ROBOT: ApplicationKind = "robot-application"
_SIMULATION: ApplicationKind = "simulation-application"
_MEMBER = "application"
A = TypeVar("A", bound=Spec)
_Creation = CreateRobotApplicationRequest | CreateSimulationApplicationRequest
_Question = DescribeRobotApplicationRequest | DescribeSimulationApplicationRequest


def _described(store: Store, kind: ApplicationKind, name: str, version: str) -> Spec:
    describe = describe_robot_application if kind == _ROBOT else describe_simulation_application
    return describe(store, name, version)


def _answer(shape: type[A], document: Spec) -> A:
    """Returns those members of a description that another answer has, too."""
    values = document.model_dump()
    return shape.model_validate({name: values[name] for name in shape.model_fields if name in values})


def _platform(request: _Creation | UpdateRobotApplicationRequest) -> Platform:
    suite, environment = request.robotSoftwareSuite, request.environment
    if isinstance(request, CreateSimulationApplicationRequest | UpdateSimulationApplicationRequest):
        return Platform(
            robot_software_suite=suite,
            simulation_software_suite=request.simulationSoftwareSuite,
            rendering_engine=request.renderingEngine,
            environment=environment,
        )
    return Platform(robot_software_suite=suite, environment=environment)


def _count(store: Store, kind: ApplicationKind) -> int:
    """Returns how many applications of a kind there are; reads them only where the deleted ones matter."""
    listed = len(store.keys(applications_prefix(kind)))
    return listed if listed < APPLICATIONS.value() else len(applications(store, kind))


def _create(kind: ApplicationKind, shape: type[Spec]) -> Handler:
    def answer(gateway: Gateway, request: _Creation) -> Spec:
        tags = request.tags or {}
        require_free_keys(tags, "tags")
        if read_application(gateway.store, kind, request.name):  # the name is what is wrong, whatever the quota is
            raise _taken(request.name, kind)
        with one_more(APPLICATIONS, lambda: _count(gateway.store, kind)):
            made = create_application(
                gateway.store, kind, request.name, request.sources or (), platform=_platform(request), tags=tags
            )
        return _answer(shape, _described(gateway.store, kind, made.name, LATEST))

    return answer


def _describe(kind: ApplicationKind) -> Handler:
    def answer(gateway: Gateway, request: _Question) -> Spec:
        name = path_of(gateway.store, request.application, kind, _MEMBER)
        return _described(gateway.store, kind, name, request.applicationVersion or LATEST)

    return answer


def _update(kind: ApplicationKind, shape: type[Spec]) -> Handler:
    def answer(gateway: Gateway, request: UpdateRobotApplicationRequest) -> Spec:
        name = path_of(gateway.store, request.application, kind, _MEMBER)
        update_application(
            gateway.store, kind, name, request.sources, request.currentRevisionId, platform=_platform(request)
        )
        return _answer(shape, _described(gateway.store, kind, name, LATEST))

    return answer


def _create_version(kind: ApplicationKind, shape: type[Spec]) -> Handler:
    def answer(gateway: Gateway, request: CreateApplicationVersionRequest) -> Spec:
        name = path_of(gateway.store, request.application, kind, _MEMBER)
        made = create_version(
            gateway.store,
            kind,
            name,
            request.currentRevisionId,
            etags=request.s3Etags,
            image_digest=request.imageDigest or "",
        )
        return _answer(shape, _described(gateway.store, kind, name, str(made.number)))

    return answer


def _delete(kind: ApplicationKind, shape: type[Spec]) -> Handler:
    def answer(gateway: Gateway, request: DeleteApplicationRequest) -> Spec:
        name = path_of(gateway.store, request.application, kind, _MEMBER)
        delete_application(gateway.store, kind, name, request.applicationVersion)
        return shape()

    return answer


def _taken(name: str, kind: ApplicationKind) -> ResourceAlreadyExists:
    return ResourceAlreadyExists.of("name", repr(name), f"a name that no {kind} has")


HANDLERS: Handlers = {
    "CreateRobotApplication": _create(_ROBOT, CreateRobotApplicationResponse),
    "CreateRobotApplicationVersion": _create_version(_ROBOT, CreateRobotApplicationVersionResponse),
    "CreateSimulationApplication": _create(_SIMULATION, CreateSimulationApplicationResponse),
    "CreateSimulationApplicationVersion": _create_version(_SIMULATION, CreateSimulationApplicationVersionResponse),
    "DeleteRobotApplication": _delete(_ROBOT, DeleteRobotApplicationResponse),
    "DeleteSimulationApplication": _delete(_SIMULATION, DeleteSimulationApplicationResponse),
    "DescribeRobotApplication": _describe(_ROBOT),
    "DescribeSimulationApplication": _describe(_SIMULATION),
    "UpdateRobotApplication": _update(_ROBOT, UpdateRobotApplicationResponse),
    "UpdateSimulationApplication": _update(_SIMULATION, UpdateSimulationApplicationResponse),
}
