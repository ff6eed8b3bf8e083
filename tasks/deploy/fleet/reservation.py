"""A fleet is taken for one deployment job; fleets and robots that no job has are deleted.

A fleet is taken before anybody works on the job: from then on it is that job's alone. A deleted robot goes on running
what it runs.
"""

from specs.errors import ConcurrentDeployment, ResourceNotFound
from specs.job_kinds import JobKind
from tasks.deploy.fleet.fleet_registry import change_fleet, deregister_robot, members, read_robot, robot_name
from tasks.deploy.fleet.states import FleetRecord
from tasks.storage.base.keys import fleet_key, robot_record_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.queue import is_queued
from tasks.storage.jobs.records import is_terminal, read

_KIND: JobKind = "deployment-job"


# The job is in the queue before its fleet is taken, and recorded after: a fleet whose job has no record yet is busy
# while the job is queued, and free if its gateway died before it recorded anything and nobody queues it any more.
def reserve_fleet(store: Store, reference: str, job: str) -> None:
    """Makes a job its fleet's one active deployment, without a look at who works on another.

    Raises:
        ResourceNotFound: No such fleet.
        ConcurrentDeployment: Another deployment to it has not ended, or is about to begin.
    """

    def taken(fleet: FleetRecord) -> FleetRecord:
        if fleet.deployment == job:
            return fleet
        require_free(store, fleet.name, fleet.deployment)
        return fleet.model_copy(update={"deployment": job})

    change_fleet(store, reference, taken)


def require_free(store: Store, fleet: str, deployment: str) -> None:
    """Does nothing for a fleet whose last deployment has ended.

    Args:
        store: Where the fleet is.
        fleet: Its name.
        deployment: Id of its last deployment; empty if there was none.

    Raises:
        ConcurrentDeployment: It has not.
    """
    if deployment and not has_ended(store, deployment):
        allowed = f"a fleet without an active deployment; {deployment} has not ended: wait for it, or cancel it"
        raise ConcurrentDeployment.of("fleet", fleet, allowed, source="request")


def has_ended(store: Store, deployment: str) -> bool:
    """Returns whether a fleet need not wait for a deployment: it has ended, or was never recorded and never will be."""
    try:
        return is_terminal(read(store, _KIND, deployment))
    except ResourceNotFound:
        return not is_queued(store, _KIND, deployment)


# See docs/reference/robomaker.md, section 8.
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

    def marked(fleet: FleetRecord) -> FleetRecord:
        if fleet.deployment and not has_ended(store, fleet.deployment):
            allowed = "a fleet without an active deployment; cancel it, or wait"
            raise ConcurrentDeployment.of("fleet", fleet.name, allowed, source="DeleteFleet")
        return fleet.model_copy(update={"deleted": True})

    return change_fleet(store, reference, marked, deleted=True)


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
