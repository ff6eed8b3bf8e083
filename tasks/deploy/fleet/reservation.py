"""A fleet taken for a deployment job before anybody works on the job: from then on it is that job's alone.

The job is in the queue before its fleet is taken, and recorded after: a fleet whose job has no record yet is busy while
the job is queued, and free if its gateway died before it recorded anything and nobody queues it any more.
"""

from specs.base import Fault
from specs.errors import ConcurrentDeployment, ObjectConflict, ResourceNotFound
from specs.job_kinds import JobKind
from tasks.deploy.fleet.fleets import read_fleet
from tasks.storage.base.encoding import encode_document
from tasks.storage.base.keys import fleet_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.queue import is_queued
from tasks.storage.jobs.records import is_terminal, read

_KIND: JobKind = "deployment-job"


def reserve_fleet(store: Store, reference: str, job: str) -> None:
    """Makes a job its fleet's one active deployment, without a look at who works on another.

    Raises:
        ResourceNotFound: No such fleet.
        ConcurrentDeployment: Another deployment to it has not ended, or is about to begin.
    """
    while True:
        fleet, etag = read_fleet(store, reference)
        if fleet.deployment == job:
            return
        require_free(store, fleet.name, fleet.deployment)
        try:
            store.replace(fleet_key(fleet.name), encode_document(fleet.model_copy(update={"deployment": job})), etag)
        except ObjectConflict:  # another job wants it too: look again
            continue
        return


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
        raise ConcurrentDeployment([Fault(path="fleet", value=fleet, allowed=allowed)], source="request")


def has_ended(store: Store, deployment: str) -> bool:
    """Returns whether a fleet need not wait for a deployment: it has ended, or was never recorded and never will be."""
    try:
        return is_terminal(read(store, _KIND, deployment))
    except ResourceNotFound:
        return not is_queued(store, _KIND, deployment)
