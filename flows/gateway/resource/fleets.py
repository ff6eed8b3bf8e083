"""Calls about fleets and robots.

The gateway has no keys of fleets and signs nothing. Where keys vouch for members, a robot that is registered here is a
member by the store's records alone: nothing is deployed to it until who has the keys vouches for it
(docs/operate/fleet-trust.md), as after a `simyard fleet register` without keys. So a key of this interface never lets
anybody bring a robot of their own into a signed fleet.
"""

import logging
import time

from flows.gateway.gateway import Gateway, Handlers
from flows.gateway.references import path_of
from flows.gateway.resource.quota import one_more
from specs.arn import arn
from specs.base import Fault
from specs.errors import ResourceAlreadyExists, ResourceNotFound
from specs.interface.quotas import FLEET_ROBOTS, FLEETS, ROBOTS
from specs.robomaker.fleet import (
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
    DescribeFleetRequest,
    DescribeFleetResponse,
    DescribeRobotRequest,
    DescribeRobotResponse,
    RegisterRobotRequest,
    RegisterRobotResponse,
)
from tasks.deploy.answers.describe import describe_fleet, describe_robot
from tasks.deploy.fleet.deletion import delete_fleet, delete_robot
from tasks.deploy.fleet.fleets import create_fleet, fleets, read_fleet
from tasks.deploy.fleet.robots import (
    add_robot,
    deregister_robot,
    known_robot,
    members,
    read_robot,
    register_robot,
    robot_count,
)
from tasks.deploy.fleet.states import FleetRecord, RobotRecord
from tasks.storage.base.store import Store
from tasks.storage.store_url import store_id
from tasks.storage.tags import require_free_keys

_LOG = logging.getLogger(__name__)


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
        fault = Fault(path="name", value=repr(request.name), allowed="a name that no robot has")
        raise ResourceAlreadyExists([fault])
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
    if read_robot(store, robot)[0].fleet != fleet:
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
    return there if there < FLEET_ROBOTS.most() else len(members(store, fleet))


def _known_fleet(store: Store, name: str) -> FleetRecord | None:
    try:
        return read_fleet(store, name)[0]
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


HANDLERS: Handlers = {
    "CreateFleet": _create_fleet,
    "CreateRobot": _create_robot,
    "DeleteFleet": _delete_fleet,
    "DeleteRobot": _delete_robot,
    "DeregisterRobot": _deregister,
    "DescribeFleet": _describe_fleet,
    "DescribeRobot": _describe_robot,
    "RegisterRobot": _register,
}
