"""DeleteFleet and DeleteRobot. A robot goes on running what it runs.

See docs/reference/robomaker.md, section 8.
"""

from specs.base import Fault
from specs.errors import ConcurrentDeployment, ObjectConflict
from tasks.deploy.fleet.fleets import read_fleet
from tasks.deploy.fleet.reservation import has_ended
from tasks.deploy.fleet.robots import deregister_robot, members, read_robot, robot_name
from tasks.deploy.fleet.states import FleetRecord
from tasks.storage.base.encoding import encode_document
from tasks.storage.base.keys import fleet_key, robot_record_key
from tasks.storage.base.store import Store


def delete_fleet(store: Store, reference: str) -> tuple[str, ...]:
    """Returns the names of the robots that are in no fleet now, because theirs was deleted.

    Raises:
        ResourceNotFound: No such fleet.
        ConcurrentDeployment: A deployment to it is under way.
    """
    fleet = _mark_deleted(store, reference)
    left = tuple(robot.name for robot in members(store, fleet.name))
    for robot in left:
        deregister_robot(store, robot)
    store.delete(fleet_key(fleet.name))
    return left


def _mark_deleted(store: Store, reference: str) -> FleetRecord:
    """Marks a fleet as deleted, and returns it; no deployment to it can begin any more."""
    while True:
        fleet, etag = read_fleet(store, reference, deleted=True)
        if fleet.deployment and not has_ended(store, fleet.deployment):
            allowed = "a fleet without an active deployment; cancel it, or wait"
            raise ConcurrentDeployment([Fault(path="fleet", value=fleet.name, allowed=allowed)], source="DeleteFleet")
        try:
            store.replace(fleet_key(fleet.name), encode_document(fleet.model_copy(update={"deleted": True})), etag)
        except ObjectConflict:
            continue
        return fleet


def delete_robot(store: Store, reference: str) -> str:
    """Returns the name of the robot that was deleted, also in the middle of a deployment; there it will not answer.

    Raises:
        ResourceNotFound: No such robot.
    """
    name = robot_name(reference)
    key = robot_record_key(name)
    if not store.exists(key):  # it is not read: a damaged record is deleted like any other
        read_robot(store, name)
    # Its desired state stays: a robot refuses a sequence that is lower than one it had, and may come back by this name.
    store.delete(key)
    return name
