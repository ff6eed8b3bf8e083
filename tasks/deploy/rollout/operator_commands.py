"""Commands of an operator to a deployment that is under way: pause, resume, cancel; and its end if it was abandoned.

An abandoned job is closed so that a controller that was only paused asks no robot later.
"""

from collections.abc import Iterable, Iterator
from contextlib import suppress
from typing import Literal

from pydantic import JsonValue

from specs.errors import DocumentError, ObjectConflict, ObjectExists, ObjectNotFound, ResourceNotFound
from specs.robomaker.failure_codes import JobFailureCode
from tasks.deploy.fleet.fleet_registry import NOTHING_ASKED, TOO_BIG, read_desired, read_fleet
from tasks.deploy.fleet.reservation import has_ended
from tasks.deploy.rollout.controller import CANCELED, COMMAND
from tasks.deploy.rollout.observation import phase_of, recorded_progress
from tasks.deploy.rollout.rollout_plan import Phase
from tasks.deploy.trust.trust_record import Signer
from tasks.storage.base.keys import claim_key, desired_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import Claim, hold_claim_unless_alive
from tasks.storage.jobs.records import JobRecord, advance, is_terminal, read

_KIND = "deployment-job"


# A controller announces in its job's record whom it asks before it asks them, under its claim's epoch. So the record
# is closed to older epochs first; then the object of each robot that was announced, and not asked, is changed: a
# write that was under way meets an object that is not the one it read. What was asked of the robot before stays
# asked, byte for byte but for white space behind it.
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


# The wish stands in the job's record, where its controller looks before each step; so it reaches a controller on
# another machine, and one that takes over.
def steer(store: Store, job: str, command: Literal["go", "pause", "cancel"]) -> JobRecord:
    """Returns the record of a deployment job of which that is wanted now.

    Paused, it asks no further robot; those that were asked finish. Cancelled, it asks no further robot ever; when those
    that were asked have ended it is Canceled, at once if no controller is alive.

    Raises:
        ResourceNotFound: No such job.
        DocumentError: It has ended, or is being cancelled.
    """
    before = read(store, _KIND, job)
    if is_terminal(before):
        raise _refused(job, f"a deployment that is under way; this one is {before.status}")
    if CANCELED in before.detail and command != "cancel":
        raise _refused(job, "a deployment that is not being canceled")
    if command == "go" and before.detail.get(COMMAND) != "pause":
        raise _refused(job, "a deployment that is paused")
    # A key of its own, so that who resumes at the same moment does not take a cancellation back.
    detail: dict[str, JsonValue] = {CANCELED: True} if command == "cancel" else {COMMAND: command}
    record = advance(store, _KIND, job, before.status, only_from={before.status}, detail=detail)
    while not detail.items() <= record.detail.items() and not is_terminal(record):  # its status changed meanwhile
        record = advance(store, _KIND, job, record.status, only_from={record.status}, detail=detail)
    return _close_if_abandoned(store, record) if command == "cancel" else record


def request_cancellation(store: Store, job: str) -> JobRecord:
    """Returns the record of a deployment job that is to be canceled, without a look at who works on it.

    Raises:
        ResourceNotFound: No such job.
        DocumentError: It has ended otherwise.
    """
    record = read(store, _KIND, job)
    while CANCELED not in record.detail and record.status != "Canceled":
        if is_terminal(record):
            raise _refused(record.arn, f"a deployment that is under way; this one is {record.status}")
        record = advance(store, _KIND, job, record.status, only_from={record.status}, detail={CANCELED: True})
    return record


def command_of(store: Store, job: str) -> str:
    """Returns what is wanted of a deployment: ``go``, ``pause`` or ``cancel``.

    Raises:
        ResourceNotFound: No such job.
    """
    detail = read(store, _KIND, job).detail
    return "cancel" if CANCELED in detail else str(detail.get(COMMAND, "go"))


def withdraw_canceled(store: Store, signer: Signer, in_force: Iterable[str]) -> tuple[str, ...]:
    """Returns those of the deployments in force that were canceled without a key at hand; they are withdrawn now.

    Args:
        store: Where the jobs are.
        signer: Whose keys have put them in force.
        in_force: Their ids.
    """
    canceled: list[str] = []
    for job in in_force:
        with suppress(ResourceNotFound):  # forgotten since (`simyard gc`)
            record = read(store, _KIND, job)
            if record.status == "Canceled" or CANCELED in record.detail:
                signer.withdraw(job)
                canceled.append(job)
    return tuple(canceled)


def active_deployment(store: Store, fleet: str) -> str:
    """Returns the id of the deployment that is under way on a fleet, by the fleet's name or ARN; or an empty text.

    Raises:
        ResourceNotFound: No such fleet.
    """
    job = read_fleet(store, fleet).deployment
    return job if job and not has_ended(store, job) else ""


def _close_if_abandoned(store: Store, record: JobRecord) -> JobRecord:
    with hold_claim_unless_alive(store, claim_key(_KIND, record.id)) as claim:
        if claim is None:
            return record
        reason = "canceled on request, when nobody worked on it"
        return close_abandoned_job(store, record, claim, reason)


def _refused(value: str, allowed: str) -> DocumentError:
    return DocumentError.of("arn", repr(value), allowed, source="simyard")
