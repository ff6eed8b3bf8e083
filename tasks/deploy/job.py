"""A deployment job from its request to its end; run again with the same token, it continues where it was."""

import logging
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

from specs.base import Fault
from specs.deployment import CreateDeploymentJobRequest
from specs.digests import canonical_document
from specs.errors import ConcurrentDeployment, ObjectConflict, ResourceNotFound
from tasks.deploy.controller import Pace, Plan, roll_out
from tasks.deploy.fleets import fleet_name, read_fleet
from tasks.deploy.planning import check_request, plan_deployment
from tasks.storage.claim import claimed, claimed_unless_alive
from tasks.storage.encoding import encoded
from tasks.storage.keys import claim_key, fleet_key
from tasks.storage.records import JobRecord, advance, is_terminal, job_id, read, submit
from tasks.storage.store import Store

_LOG = logging.getLogger(__name__)
_KIND = "deployment-job"


def run_deployment_job(
    store: Store,
    request: CreateDeploymentJobRequest,
    *,
    digest: str,
    token: str,
    progress: Callable[[int, int], None],
    pace: Pace | None = None,
    robots: Callable[[], AbstractContextManager[object]] | None = None,
) -> JobRecord:
    """Returns the deployment job's record, Succeeded or Failed; an ended job is returned as it ended.

    Args:
        store: Where fleet, robots and versions are.
        request: What to deploy where.
        digest: Of the bundle that was tested; the version must be that one.
        token: The client request token.
        progress: Called with robots that have ended and robots in all, whenever that changes.
        pace: Clock and poll interval.
        robots: Makes the fleet's members, which answer inside its ``with`` block; entered only while the fleet is
            this job's, so that a job which is refused touches no robot. None: the fleet has its members already.

    Raises:
        ResourceNotFound: No such fleet, application or version.
        DocumentError: The version is another than was tested, a variable or file is not allowed, or the fleet is empty.
        ConcurrentDeployment: Another deployment to the fleet is under way.
        IdempotentParameterMismatch: The token came with another request before.
        StoreError: The store fails, or another process has taken the job over.
    """
    job = job_id(_KIND, token)
    with claimed(store, claim_key(_KIND, job)) as claim:
        known = _known(store, job)
        if known and is_terminal(known):
            return submit(store, _KIND, canonical_document(request), token)
        fleet = fleet_name(request.fleet)
        plan = _recorded_plan(known)
        if plan is None and robots is None:
            plan = plan_deployment(store, request, digest)
        elif plan is None:
            check_request(store, request, digest)
        _free_fleet(store, fleet, job)
        record = submit(store, _KIND, canonical_document(request), token)
        _take_fleet(store, fleet, job)
        with robots() if robots else nullcontext():
            plan = plan or plan_deployment(store, request, digest)
            detail = {"plan": plan.model_dump(mode="json")}
            record = advance(store, _KIND, record.id, "Preparing" if known is None else "InProgress", detail=detail)
            return roll_out(store, record, plan, claim, pace=pace or Pace(), progress=progress)


def _known(store: Store, job: str) -> JobRecord | None:
    try:
        return read(store, _KIND, job)
    except ResourceNotFound:
        return None


def _recorded_plan(record: JobRecord | None) -> Plan | None:
    """Returns what was planned at first: that is done, even if robots have joined or left since."""
    return Plan.model_validate(record.detail["plan"]) if record and "plan" in record.detail else None


def _take_fleet(store: Store, name: str, job: str) -> None:
    """Makes this job the fleet's one active deployment."""
    while True:
        _free_fleet(store, name, job)
        fleet, etag = read_fleet(store, name)
        if fleet.deployment == job:
            return
        try:
            store.replace(fleet_key(name), encoded(fleet.model_copy(update={"deployment": job})), etag)
        except ObjectConflict:  # somebody else wants it too: look again
            continue


def _free_fleet(store: Store, name: str, job: str) -> None:
    """Returns when no other deployment to the fleet is under way; one that nobody works on any more is canceled.

    Raises:
        ConcurrentDeployment: One is.
    """
    other = read_fleet(store, name)[0].deployment
    known = _known(store, other) if other and other != job else None
    if known is None or is_terminal(known):
        return
    with claimed_unless_alive(store, claim_key(_KIND, other)) as claim:
        if claim is None:
            fault = Fault(
                path="fleet", value=name, allowed=f"a fleet without an active deployment; wait for {known.arn}"
            )
            raise ConcurrentDeployment([fault], source="deployment")
        reason = f"nobody worked on it any more when {job} was asked for"
        ended = advance(store, _KIND, other, "Canceled", failure_reason=reason)
    _LOG.warning("deployment %s is %s: %s", other, ended.status, reason)
