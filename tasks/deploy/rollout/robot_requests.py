"""Writes a robot's desired state once for each deployment, and withdraws it if the robot has not answered."""

from collections.abc import Callable

from specs.errors import ObjectConflict, ObjectExists, ObjectNotFound, ObjectTooBig, StoreError
from tasks.deploy.fleet.robots import MOST_BYTES, TOO_BIG, parse_withdrawn, read_desired, read_reported
from tasks.deploy.fleet.states import Desired, Withdrawn
from tasks.storage.base.encoding import encode_document
from tasks.storage.base.keys import desired_key
from tasks.storage.base.store import Store


def ask_robot(
    store: Store,
    desired: Desired,
    sign: Callable[[Desired], Desired] | None = None,
    check: Callable[[], None] = lambda: None,
) -> Desired:
    """Returns the desired state that the robot has for this deployment, written if there was none.

    Asking twice, also after a crash between two robots, asks once: a robot that has a desired state of this deployment
    keeps it, sequence and all. The sequence of a new one is higher than that of the one before it and of the robot's
    report, so that an old state that is put back, or deleted, does not make the robot deaf.

    Args:
        store: Where robots look.
        desired: What the robot shall run; its sequence is set here.
        sign: Signs it, or None.
        check: Called directly before the write; raises when this process may not ask any more.

    Raises:
        StoreError: The store fails, or a later epoch of the deployment has asked the robot.
    """
    key = desired_key(desired.robot)
    while True:
        before, etag = read_desired(store, desired.robot)
        if before and before.deployment == desired.deployment:
            if before.epoch > desired.epoch:
                raise StoreError(f"{store.url}: {key} is of epoch {before.epoch}; this process had {desired.epoch}")
            return before
        reported = read_reported(store, desired.robot)
        asked = before.sequence if before else withdrawn_sequence(store, desired.robot)
        seen = max(asked, reported.sequence if reported else 0)
        new = desired.model_copy(update={"sequence": seen + 1})
        new = sign(new) if sign else new
        try:
            etag = store.etag(key) if etag == TOO_BIG else etag
            check()
            store.replace(key, encode_document(new), etag) if etag else store.create(key, encode_document(new))
        except (ObjectExists, ObjectConflict, ObjectNotFound):
            continue
        return new


def withdraw_request(store: Store, robot: str, deployment: str, check: Callable[[], None] = lambda: None) -> bool:
    """Returns whether a robot is asked nothing of a deployment any more; one that has answered stays asked.

    The sequence stays behind: a robot that has just read what is withdrawn takes what it is asked next all the same.

    Args:
        store: Where robots look.
        robot: The robot's name.
        deployment: The job's id.
        check: Called directly before the write; raises when this process may not withdraw any more.

    Raises:
        StoreError: The store fails.
    """
    key = desired_key(robot)
    while True:
        before, etag = read_desired(store, robot)
        if before is None or before.deployment != deployment:
            return True
        reported = read_reported(store, robot)
        if reported and reported.deployment == deployment:
            return False
        try:
            check()
            store.replace(key, encode_document(Withdrawn(withdrawn=before.sequence)), etag)
        except (ObjectConflict, ObjectNotFound):
            continue
        return True


def withdrawn_sequence(store: Store, robot: str) -> int:
    """Returns the sequence of what was withdrawn from a robot last; 0 if nothing lies there in its place."""
    try:
        found = parse_withdrawn(store.get(desired_key(robot), MOST_BYTES).body)
    except (ObjectNotFound, ObjectTooBig):
        return 0
    return found.withdrawn if found else 0
