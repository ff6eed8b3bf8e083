"""Calls about fleets, robots and deployment jobs."""

import logging
import time
from dataclasses import replace

from pydantic import JsonValue

from flows.gateway.admission import Admission, Document, NewRecord, admit, answer_of
from flows.gateway.gateway import Gateway, Handlers, one_more, path_of
from specs.arn import arn
from specs.base import canonical_document
from specs.errors import ResourceAlreadyExists, ResourceNotFound
from specs.job_kinds import JobKind
from specs.robomaker.deployment import (
    CancelDeploymentJobRequest,
    CancelDeploymentJobResponse,
    CreateDeploymentJobRequest,
    CreateDeploymentJobResponse,
    CreateFleetRequest,
    CreateFleetResponse,
    CreateRobotRequest,
    CreateRobotResponse,
    DeleteFleetRequest,
    DeleteFleetResponse,
    DeleteRobotRequest,
    DeleteRobotResponse,
    DeregisterRobotRequest,
    DeregisterRobotResponse,
    DescribeDeploymentJobRequest,
    DescribeDeploymentJobResponse,
    DescribeFleetRequest,
    DescribeFleetResponse,
    DescribeRobotRequest,
    DescribeRobotResponse,
    RegisterRobotRequest,
    RegisterRobotResponse,
    SyncDeploymentJobRequest,
    SyncDeploymentJobResponse,
)
from specs.robomaker.operations import DEPLOYMENTS, FLEET_ROBOTS, FLEETS, ROBOTS
from tasks.applications.registry import resolve
from tasks.deploy.fleet.fleet_registry import (
    add_robot,
    create_fleet,
    deregister_robot,
    fleets,
    known_robot,
    members,
    read_fleet,
    read_robot,
    register_robot,
    robot_count,
)
from tasks.deploy.fleet.reservation import delete_fleet, delete_robot, require_free, reserve_fleet
from tasks.deploy.fleet.states import FleetRecord, RobotRecord
from tasks.deploy.fleet_descriptions import describe_deployment_job, describe_fleet, describe_robot
from tasks.deploy.rollout.operator_commands import request_cancellation
from tasks.deploy.rollout.resolved_request import SYNC, latest_deployment, plan_deployment, sync_request
from tasks.deploy.trust.trust_record import vouch_queued
from tasks.storage.base.store import Store
from tasks.storage.jobs.queue import enqueue
from tasks.storage.jobs.records import JobRecord, job_id
from tasks.storage.store_url import store_id
from tasks.storage.tags import require_free_keys

_LOG = logging.getLogger(__name__)
_DEPLOYMENT: JobKind = "deployment-job"


# The gateway has no keys of fleets and signs nothing. Where keys vouch for members, a robot that is registered here
# is a member by the store's records alone: nothing is deployed to it until who has the keys vouches for it
# (docs/operate/fleet-trust.md), as after a `simyard fleet register` without keys. So a key of this interface never
# lets anybody bring a robot of their own into a signed fleet.
def _create_fleet(gateway: Gateway, request: CreateFleetRequest) -> CreateFleetResponse:
    """Makes a fleet; a name that is taken has no error in RoboMaker's interface, so it answers with the one there."""
    require_free_keys(request.tags or {}, "tags")
    made = _known_fleet(gateway.store, request.name)
    if made is None:
        with one_more(FLEETS, lambda: len(fleets(gateway.store))):
            made = create_fleet(gateway.store, request.name, request.tags)
    return CreateFleetResponse(
        arn=arn("deployment-fleet", store_id(gateway.store), made.name),
        name=made.name,
        createdAt=made.created_at_s,
        tags=made.tags or None,
    )


def _describe_fleet(gateway: Gateway, request: DescribeFleetRequest) -> DescribeFleetResponse:
    return describe_fleet(gateway.store, _fleet(gateway.store, request.fleet))


def _delete_fleet(gateway: Gateway, request: DeleteFleetRequest) -> DeleteFleetResponse:
    name = _fleet(gateway.store, request.fleet)
    left = delete_fleet(gateway.store, name)
    _remind(gateway.store, f"simyard fleet delete {name}, with keys", f"{name} and its {len(left)} robots")
    return DeleteFleetResponse()


def _create_robot(gateway: Gateway, request: CreateRobotRequest) -> CreateRobotResponse:
    require_free_keys(request.tags or {}, "tags")
    if known_robot(gateway.store, request.name):  # the name is what is wrong, whatever the quota is
        raise ResourceAlreadyExists.of("name", repr(request.name), "a name that no robot has")
    record = RobotRecord(
        name=request.name,
        architecture=request.architecture,
        created_at_s=time.time(),
        tags=request.tags or {},
        greengrass_group=request.greengrassGroupId,
    )
    with one_more(ROBOTS, lambda: robot_count(gateway.store)):
        made = add_robot(gateway.store, record)
    return CreateRobotResponse(
        arn=arn("robot", store_id(gateway.store), made.name),
        name=made.name,
        createdAt=made.created_at_s,
        greengrassGroupId=made.greengrass_group,
        architecture=made.architecture,
        tags=made.tags or None,
    )


def _describe_robot(gateway: Gateway, request: DescribeRobotRequest) -> DescribeRobotResponse:
    return describe_robot(gateway.store, _robot(gateway.store, request.robot))


def _delete_robot(gateway: Gateway, request: DeleteRobotRequest) -> DeleteRobotResponse:
    name = delete_robot(gateway.store, _robot(gateway.store, request.robot))
    _remind(gateway.store, f"simyard fleet delete-robot {name}, with keys", name)
    return DeleteRobotResponse()


def _register(gateway: Gateway, request: RegisterRobotRequest) -> RegisterRobotResponse:
    store = gateway.store
    fleet, robot = _fleet(store, request.fleet), _robot(store, request.robot)
    read_fleet(store, fleet)
    if read_robot(store, robot).fleet != fleet:
        with one_more(FLEET_ROBOTS, lambda: _member_count(store, fleet)):
            register_robot(store, fleet, robot)
        _remind(store, f"simyard fleet vouch {fleet} {robot}", robot)
    return RegisterRobotResponse(fleet=request.fleet, robot=request.robot)


def _deregister(gateway: Gateway, request: DeregisterRobotRequest) -> DeregisterRobotResponse:
    store = gateway.store
    fleet, robot = _fleet(store, request.fleet), _robot(store, request.robot)
    read_fleet(store, fleet)
    deregister_robot(store, robot, fleet)
    _remind(store, f"simyard fleet deregister {robot}, with keys", robot)
    return DeregisterRobotResponse(fleet=request.fleet, robot=request.robot)


def _member_count(store: Store, fleet: str) -> int:
    """Returns how many robots a fleet has; reads them only where the store has enough to fill it."""
    there = robot_count(store)
    return there if there < FLEET_ROBOTS.value() else len(members(store, fleet))


def _known_fleet(store: Store, name: str) -> FleetRecord | None:
    try:
        return read_fleet(store, name)
    except ResourceNotFound:
        return None


def _fleet(store: Store, text: str) -> str:
    return path_of(store, text, "deployment-fleet", "fleet")


def _robot(store: Store, text: str) -> str:
    return path_of(store, text, "robot", "robot")


def _remind(store: Store, command: str, whom: str) -> None:
    """Logs what is left to who has the keys, where there are any."""
    if next(iter(store.keys("trust")), None):
        _LOG.warning("%s changed without a signature; what the keys vouch for is as it was: %s", whom, command)


def _create_deployment(gateway: Gateway, request: CreateDeploymentJobRequest) -> CreateDeploymentJobResponse:
    """Answers CreateDeploymentJob: the job waits for a worker, and its fleet takes no other until it has ended."""
    store, token, asked = gateway.store, request.clientRequestToken, canonical_document(request)
    fleet = path_of(store, request.fleet, "deployment-fleet", "fleet")
    path_of(store, request.deploymentApplicationConfigs[0].application, "robot-application", "application")

    def checked() -> NewRecord:
        use = request.deploymentApplicationConfigs[0]
        require_free(store, fleet, read_fleet(store, fleet).deployment)
        version = resolve(store, "robot-application", use.application, use.applicationVersion)
        plan_deployment(store, request, version.digest)
        job = job_id(_DEPLOYMENT, token)
        return NewRecord(asked, vouch_queued(job, asked, version.digest, version.digests))

    record = _admit(gateway, fleet, Admission(_DEPLOYMENT, token, asked, _asked_in, checked, DEPLOYMENTS))
    return answer_of(CreateDeploymentJobResponse, describe_deployment_job(store, record.id), store)


def _sync_deployment(gateway: Gateway, request: SyncDeploymentJobRequest) -> SyncDeploymentJobResponse:
    """Answers SyncDeploymentJob: a job of its own, as at RoboMaker, also where no robot lacks anything."""
    store, token = gateway.store, request.clientRequestToken
    fleet = path_of(store, request.fleet, "deployment-fleet", "fleet")
    # What the fleet's latest deployment is may change; what was asked for is the fleet.
    asked: Document = {"fleet": arn("deployment-fleet", store_id(store), fleet), SYNC: True}

    def checked() -> NewRecord:
        require_free(store, fleet, read_fleet(store, fleet).deployment)
        last = sync_request(latest_deployment(store, fleet), token)
        recorded: Document = {**canonical_document(last), "fleet": asked["fleet"]}
        return NewRecord(recorded)

    options: dict[str, JsonValue] = {SYNC: True}
    admission = Admission(_DEPLOYMENT, token, asked, _synced_in, checked, DEPLOYMENTS, options)
    record = _admit(gateway, fleet, admission)
    return answer_of(SyncDeploymentJobResponse, describe_deployment_job(store, record.id), store)


def _describe_deployment(gateway: Gateway, request: DescribeDeploymentJobRequest) -> DescribeDeploymentJobResponse:
    """Answers DescribeDeploymentJob."""
    store = gateway.store
    described = describe_deployment_job(store, path_of(store, request.job, _DEPLOYMENT, "job"))
    return answer_of(DescribeDeploymentJobResponse, described, store)


def _cancel_deployment(gateway: Gateway, request: CancelDeploymentJobRequest) -> CancelDeploymentJobResponse:
    """Answers CancelDeploymentJob: robots that were asked finish, no other is asked."""
    store = gateway.store
    record = request_cancellation(store, path_of(store, request.job, _DEPLOYMENT, "job"))
    enqueue(store, _DEPLOYMENT, record.id, _options(record))  # who worked on it may have died: a worker ends it
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
    "CreateFleet": _create_fleet,
    "CreateRobot": _create_robot,
    "DeleteFleet": _delete_fleet,
    "DeleteRobot": _delete_robot,
    "DeregisterRobot": _deregister,
    "DescribeFleet": _describe_fleet,
    "DescribeRobot": _describe_robot,
    "RegisterRobot": _register,
    "CreateDeploymentJob": _create_deployment,
    "SyncDeploymentJob": _sync_deployment,
    "DescribeDeploymentJob": _describe_deployment,
    "CancelDeploymentJob": _cancel_deployment,
}
