"""A deployment job from its request to its end; run again with the same token, it continues where it was."""

import logging
from collections.abc import Callable, Collection, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import partial

from specs.base import canonical_document
from specs.errors import ConcurrentDeployment, ResourceNotFound, TrustRefused
from specs.field_types import Architecture
from specs.pipeline.simulation_section import RollOutRules
from specs.robomaker.deployment import CreateDeploymentJobRequest
from tasks.deploy.fleet.fleet_registry import change_fleet, fleet_name, read_fleet
from tasks.deploy.fleet.reservation import require_free
from tasks.deploy.fleet.states import FleetRecord
from tasks.deploy.rollout.controller import ControllerPace, control_rollout
from tasks.deploy.rollout.observation import progress_document
from tasks.deploy.rollout.operator_commands import close_abandoned_job
from tasks.deploy.rollout.resolved_request import (
    check_request,
    latest_deployment,
    plan_deployment,
    plan_sync,
    sync_request,
)
from tasks.deploy.rollout.rollout_plan import RolloutPlan
from tasks.deploy.trust.trust_record import Admission, Signer, check_recorded_plan, sign_plan
from tasks.storage.base.keys import claim_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.claim import hold_claim, hold_claim_unless_alive
from tasks.storage.jobs.queue import is_queued
from tasks.storage.jobs.records import JobRecord, advance, is_terminal, job_id, read, submit

_LOG = logging.getLogger(__name__)
_KIND = "deployment-job"


@dataclass(frozen=True)
class _Work:
    """A deployment job's request, and what it comes to.

    Attributes:
        plan: Says what it comes to, once the fleet has its members.
        check: Refuses what can never be planned, while the fleet may have none yet.
        follows: The deployment that this one is a sync of, or empty.
    """

    request: CreateDeploymentJobRequest
    plan: Callable[[], RolloutPlan]
    check: Callable[[], None]
    follows: str = ""


def run_deployment_job(
    store: Store,
    request: CreateDeploymentJobRequest,
    *,
    digest: str,
    token: str,
    progress: Callable[[int, int], None],
    rules: RollOutRules | None = None,
    pace: ControllerPace | None = None,
    robots: Callable[[], AbstractContextManager[Collection[str] | None]] | None = None,
    signer: Signer | None = None,
    builds: Mapping[Architecture, str] | None = None,
) -> JobRecord:
    """Returns the deployment job's record, Succeeded, Failed or Canceled; an ended job is returned as it ended.

    Args:
        store: Where fleet, robots and versions are.
        request: What to deploy where.
        digest: Of the bundle that was tested; the version must be that one.
        token: The client request token.
        progress: Called with robots that have ended and robots in all, whenever that changes.
        rules: What RoboMaker's request has no words for.
        pace: Clock and poll interval.
        robots: Makes the fleet's members and yields their names; they answer inside its ``with`` block, entered only
            while the fleet is this job's: a job that is refused touches no robot. None: the fleet has its members.
        signer: Signs for the bundle and for what is asked of each robot; None asks unsigned, and the record says so.
        builds: Digest of the bundle for each architecture; the version must have these and no others. None for any.

    Raises:
        ResourceNotFound: No such fleet, application or version.
        DocumentError: The version is another than was tested, a variable or file is not allowed, or the fleet is empty.
        ConcurrentDeployment: Another deployment to the fleet is under way.
        IdempotentParameterMismatch: The token came with another request before.
        TrustRefused: The signer cannot vouch for it, or for its robots; or it was withdrawn.
        StoreError: The store fails, or another process has taken the job over.
    """
    work = _Work(
        request,
        plan=lambda: plan_deployment(store, request, digest, rules, builds),
        check=lambda: check_request(store, request, digest, builds),
    )
    return _run(store, work, token, progress, pace=pace or ControllerPace(), robots=robots, signer=signer)


def run_sync_job(
    store: Store,
    fleet: str,
    *,
    token: str,
    progress: Callable[[int, int], None],
    only_failed: bool = False,
    pace: ControllerPace | None = None,
    signer: Signer | None = None,
) -> JobRecord:
    """Returns the record of a job that brings a fleet to its latest deployment, Succeeded, Failed or Canceled.

    Where every robot is in sync the job asks none, and is Succeeded at once.

    Args:
        store: Where fleet and robots are.
        fleet: Its name or ARN.
        token: The client request token.
        progress: Called with robots that have ended and robots in all, whenever that changes.
        only_failed: Whether to try again those that failed or did not answer, and no others.
        pace: Clock and poll interval.
        signer: As for a deployment; it must have signed the one that is synced.

    Raises:
        ResourceNotFound: No such fleet, or nothing was deployed to it yet.
        ConcurrentDeployment: A deployment to the fleet is under way.
        IdempotentParameterMismatch: The token came with another fleet before.
        TrustRefused: The signer has not signed what was deployed last, or it is another fleet's, or was withdrawn.
        StoreError: The store fails, or another process has taken the job over.
    """
    last, name = latest_deployment(store, fleet), read_fleet(store, fleet).name
    check_recorded_plan(signer, last, name)
    known = _find_job(store, job_id(_KIND, token))
    request = CreateDeploymentJobRequest.model_validate(known.request) if known else sync_request(last, token)
    if fleet_name(request.fleet) != name:
        submit(store, _KIND, canonical_document(sync_request(last, token)), token)  # refuses: the token is another's
    plan = partial(plan_sync, store, last, only_failed=only_failed)
    work = _Work(request, plan=plan, check=lambda: None, follows=last.id)
    return _run(store, work, token, progress, pace=pace or ControllerPace(), robots=None, signer=signer)


def _run(
    store: Store,
    work: _Work,
    token: str,
    progress: Callable[[int, int], None],
    *,
    pace: ControllerPace,
    robots: Callable[[], AbstractContextManager[Collection[str] | None]] | None,
    signer: Signer | None,
) -> JobRecord:
    job, document = job_id(_KIND, token), canonical_document(work.request)
    with hold_claim(store, claim_key(_KIND, job)) as claim:
        known = _find_job(store, job)
        if known and is_terminal(known):
            return submit(store, _KIND, document, token)
        fleet = fleet_name(work.request.fleet)
        check_recorded_plan(signer, known, fleet)
        plan = _recorded_plan(known)
        if plan is None and robots is None:
            plan = work.plan()
            _check_fleet(plan, fleet, signer)
        elif plan is None:
            work.check()
        _free_fleet(store, read_fleet(store, fleet), job)
        record = submit(store, _KIND, document, token)
        _take_fleet(store, fleet, job)
        with robots() if robots else nullcontext(()) as own:
            plan = plan or work.plan()
            _check_fleet(plan, fleet)
            detail = sign_plan(signer, _admission(work, plan, job, own or ()), plan.model_dump(mode="json"))
            if (lacking := plan.lacking()) and _recorded_plan(known) is None:
                detail = {**detail, "progress": progress_document(lacking)}
            status = "Preparing" if known is None or known.status == "Pending" else "InProgress"
            record = advance(store, _KIND, record.id, status, detail=detail, epoch=claim.epoch)
            return control_rollout(store, record, plan, claim, pace=pace, progress=progress, signer=signer)


def _check_fleet(plan: RolloutPlan, fleet: str, signer: Signer | None = None) -> None:
    """Does nothing for a plan for the fleet's own robots, of whom the signer's keys say that they are.

    Raises:
        TrustRefused: It is for others.
    """
    if plan.fleet != fleet:
        what = f"the plan is for the robots of {plan.fleet!r}, and the request for {fleet!r}"
        raise TrustRefused(f"{what}; find out who writes to the store, and make a new deployment")
    if signer:
        signer.require_members(fleet, [*plan.environments])


def _admission(work: _Work, plan: RolloutPlan, job: str, own: Collection[str]) -> Admission:
    digests = list(dict.fromkeys([plan.digest, *plan.builds.values()]))
    ours = [robot for robot in plan.environments if robot in own]
    return Admission(plan.fleet, job, digests, robots=[*plan.environments], own=ours, follows=work.follows)


def _find_job(store: Store, job: str) -> JobRecord | None:
    try:
        return read(store, _KIND, job)
    except ResourceNotFound:
        return None


def _recorded_plan(record: JobRecord | None) -> RolloutPlan | None:
    """Returns what was planned at first: that is done, even if robots have joined or left since."""
    return RolloutPlan.model_validate(record.detail["plan"]) if record and "plan" in record.detail else None


def _take_fleet(store: Store, name: str, job: str) -> None:
    """Makes this job the fleet's one active deployment."""

    def taken(fleet: FleetRecord) -> FleetRecord:
        _free_fleet(store, fleet, job)
        return fleet if fleet.deployment == job else fleet.model_copy(update={"deployment": job})

    change_fleet(store, name, taken)


def _free_fleet(store: Store, fleet: FleetRecord, job: str) -> None:
    """Returns when no other deployment to the fleet is under way or queued; an abandoned one is canceled.

    Raises:
        ConcurrentDeployment: One is.
    """
    other, name = fleet.deployment, fleet.name
    if not other or other == job:
        return
    known = _find_job(store, other)
    if known is not None and is_terminal(known):
        return
    if is_queued(store, _KIND, other):  # a worker takes it, though nobody may have yet
        require_free(store, name, other)
    if known is None:
        return
    with hold_claim_unless_alive(store, claim_key(_KIND, other)) as claim:
        if claim is None:
            raise ConcurrentDeployment.of(
                "fleet", name, f"a fleet without an active deployment; wait for {known.arn}", source="deployment"
            )
        reason = f"nobody worked on it any more when {job} was asked for"
        ended = close_abandoned_job(store, known, claim, reason)
    _LOG.warning("deployment %s is %s: %s", other, ended.status, reason)
