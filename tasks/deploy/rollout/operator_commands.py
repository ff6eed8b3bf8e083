"""Commands of an operator to a deployment that is under way: pause, resume, cancel.

The wish stands in the job's record, where its controller looks before each step; so it reaches a controller on another
machine, and one that takes over.
"""

from collections.abc import Iterable
from contextlib import suppress
from typing import Literal

from pydantic import JsonValue

from specs.base import Fault
from specs.errors import DocumentError, ResourceNotFound
from tasks.deploy.fleet.fleets import read_fleet
from tasks.deploy.fleet.reservation import has_ended
from tasks.deploy.rollout.controller import CANCELED, WISH
from tasks.deploy.rollout.job_end import close_abandoned_job
from tasks.deploy.trust.trust_record import Signer
from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import hold_claim_unless_alive
from tasks.storage.jobs.records import JobRecord, advance, is_terminal, read

_KIND = "deployment-job"


def steer(store: Store, job: str, wish: Literal["go", "pause", "cancel"]) -> JobRecord:
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
    if CANCELED in before.detail and wish != "cancel":
        raise _refused(job, "a deployment that is not being canceled")
    if wish == "go" and before.detail.get(WISH) != "pause":
        raise _refused(job, "a deployment that is paused")
    # A key of its own, so that who resumes at the same moment does not take a cancellation back.
    detail: dict[str, JsonValue] = {CANCELED: True} if wish == "cancel" else {WISH: wish}
    record = advance(store, _KIND, job, before.status, only_from={before.status}, detail=detail)
    while not detail.items() <= record.detail.items() and not is_terminal(record):  # its status changed meanwhile
        record = advance(store, _KIND, job, record.status, only_from={record.status}, detail=detail)
    return _close_if_abandoned(store, record) if wish == "cancel" else record


def wish_deployment_canceled(store: Store, job: str) -> JobRecord:
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


def wish_of(store: Store, job: str) -> str:
    """Returns what is wanted of a deployment: ``go``, ``pause`` or ``cancel``.

    Raises:
        ResourceNotFound: No such job.
    """
    detail = read(store, _KIND, job).detail
    return "cancel" if CANCELED in detail else str(detail.get(WISH, "go"))


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
    job = read_fleet(store, fleet)[0].deployment
    return job if job and not has_ended(store, job) else ""


def _close_if_abandoned(store: Store, record: JobRecord) -> JobRecord:
    with hold_claim_unless_alive(store, claim_key(_KIND, record.id)) as claim:
        if claim is None:
            return record
        reason = "canceled on request, when nobody worked on it"
        return close_abandoned_job(store, record, claim, reason)


def _refused(value: str, allowed: str) -> DocumentError:
    return DocumentError([Fault(path="arn", value=repr(value), allowed=allowed)], source="simyard")
