"""Closes an abandoned deployment job, so that a controller that was only paused asks no robot later.

A controller announces in its job's record whom it asks before it asks them, under its claim's epoch. So the record is
closed to older epochs first; then the object of each robot that was announced, and not asked, is changed: a write that
was under way meets an object that is not the one it read. What was asked of the robot before stays asked, byte for byte
but for white space behind it.
"""

from collections.abc import Iterator

from specs.errors import ObjectConflict, ObjectExists, ObjectNotFound
from specs.robomaker.failure_codes import JobFailureCode
from tasks.deploy.fleet.robots import NOTHING_ASKED, TOO_BIG, read_desired
from tasks.deploy.rollout.observation import phase_of, recorded_progress
from tasks.deploy.rollout.waves import Phase
from tasks.storage.base.keys import desired_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import Claim
from tasks.storage.jobs.records import JobRecord, advance, is_terminal

_KIND = "deployment-job"


def close_abandoned_job(
    store: Store, record: JobRecord, claim: Claim, reason: str, failure_code: JobFailureCode = ""
) -> JobRecord:
    """Returns the record of a deployment job that was left by its controller: Canceled, or as it had ended.

    Killed in between, it leaves a job that has not ended, and that the next one closes.

    Args:
        store: Where the job is.
        record: The job's.
        claim: On the job, which its controller has lost.
        reason: Why it is not continued.
        failure_code: RoboMaker's, of a job that is Failed; empty for one that is Canceled.

    Raises:
        StoreError: The store fails, or a later epoch has the job.
    """
    closed = advance(store, _KIND, record.id, record.status, only_from={record.status}, epoch=claim.epoch)
    while not is_terminal(closed) and closed.detail.get("epoch") != claim.epoch:  # its status changed meanwhile
        closed = advance(store, _KIND, record.id, closed.status, only_from={closed.status}, epoch=claim.epoch)
    if is_terminal(closed):
        return closed
    for robot in _announced_robots(closed):
        _change(store, robot, closed.id)
    status = "Failed" if failure_code else "Canceled"
    return advance(store, _KIND, record.id, status, failure_code=failure_code, failure_reason=reason, epoch=claim.epoch)


def _announced_robots(record: JobRecord) -> Iterator[str]:
    for robot, progress in recorded_progress(record).items():
        if phase_of(progress) is Phase.IN_FLIGHT:
            yield robot


def _change(store: Store, robot: str, job: str) -> None:
    """Changes what lies there for a robot, and asks nothing else of it; a robot that the job has asked stays asked."""
    key = desired_key(robot)
    while True:
        desired, etag = read_desired(store, robot)
        if desired and desired.deployment == job:
            return
        try:
            if not etag:
                store.create(key, NOTHING_ASKED)
            elif etag == TOO_BIG:
                store.replace(key, NOTHING_ASKED, store.etag(key))
            else:
                store.replace(key, store.get(key).body + b"\n", etag)
        except (ObjectConflict, ObjectExists, ObjectNotFound):  # who was paused has written, or a robot was deleted
            continue
        return
