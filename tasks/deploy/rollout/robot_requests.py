"""Writes a robot's desired state once for each deployment, and withdraws it if the robot has not answered.

A robot takes a desired state if its sequence is higher than that of the last one. The sequence is the controller's time
in milliseconds since 1970, or one more than the desired state that lies there, if that is more. The latter counts only
if the owner's own key has signed it: whoever can write to the store could otherwise use up the numbers. What the robot
reports never counts. So without a previous state, as when somebody has deleted it, the sequence grows with the clock;
and with it, a controller whose clock is behind that of the one before it is heard all the same.
"""

from collections.abc import Callable

from specs.errors import ObjectConflict, ObjectExists, ObjectNotFound, ObjectTooBig, StoreError
from tasks.deploy.fleet.robots import MOST_BYTES, TOO_BIG, parse_withdrawn, read_desired, read_reported
from tasks.deploy.fleet.states import MOST_SEQUENCE, Desired, Withdrawn
from tasks.storage.base.encoding import encode_document
from tasks.storage.base.keys import desired_key
from tasks.storage.base.store import Store


def ask_robot(
    store: Store,
    desired: Desired,
    sign: Callable[[Desired], Desired] | None = None,
    check: Callable[[], None] = lambda: None,
    own: Callable[[Desired], bool] | None = None,
) -> Desired:
    """Returns the desired state that the robot has for this deployment, written if there was none.

    Asking twice, also after a crash between two robots, asks once: a robot that has a desired state of this deployment
    keeps it, sequence and all. One that is not the owner's own is written over.

    Args:
        store: Where robots look.
        desired: What the robot shall run; its sequence is set here.
        sign: Signs it, or None.
        check: Called directly before the write; raises when this process may not ask any more.
        own: Whether the owner's key has signed a desired state as it stands; None where nothing is signed.

    Raises:
        StoreError: The store fails, or a later epoch of the deployment has asked the robot.
    """
    key = desired_key(desired.robot)
    while True:
        found, etag = read_desired(store, desired.robot)
        before = found if found and found.robot == desired.robot and (own is None or own(found)) else None
        if before and before.deployment == desired.deployment:
            if before.epoch > desired.epoch:
                raise StoreError(f"{store.url}: {key} is of epoch {before.epoch}; this process had {desired.epoch}")
            return before
        asked = before.sequence if before else _withdrawn(store, desired.robot, signed=sign is not None)
        new = desired.model_copy(update={"sequence": _next_sequence(asked, desired.issued_at_s)})
        new = sign(new) if sign else new
        try:
            etag = store.etag(key) if etag == TOO_BIG else etag
            check()
            store.replace(key, encode_document(new), etag) if etag else store.create(key, encode_document(new))
        except (ObjectExists, ObjectConflict, ObjectNotFound):
            continue
        return new


def _next_sequence(asked: int, now_s: float) -> int:
    """Returns the sequence of what is asked now, after what was asked last; 0 for nothing.

    The highest number leaves none for the next: nobody's clock has given it, so it does not count.
    """
    return max(int(now_s * 1000), asked + 1 if asked < MOST_SEQUENCE else 0, 1)


def _withdrawn(store: Store, robot: str, *, signed: bool) -> int:
    """Returns the sequence of what was withdrawn; 0 where things are signed, because that is not."""
    return 0 if signed else withdrawn_sequence(store, robot)


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
