"""SyncDeploymentJob: brings a fleet's latest deployment to those of its robots that do not run it.

See docs/reference/robomaker.md, section 8.

They joined later, were away, or failed; with a failed one, a sync is how only the failed are tried again.
"""

from collections.abc import Iterable, Mapping
from typing import Literal

from specs.base import Fault
from specs.errors import ResourceNotFound, TrustRefused
from specs.robomaker.deployment import CreateDeploymentJobRequest
from tasks.deploy.fleet import launch_environment
from tasks.deploy.fleet.fleets import read_fleet
from tasks.deploy.fleet.robots import members, read_desired, read_reported
from tasks.deploy.fleet.states import RobotRecord
from tasks.deploy.rollout.resolved_request import bounds_for
from tasks.deploy.rollout.rollout_plan import RolloutPlan, digests_for
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord, read, records

SYNC = "sync"
"""The option of a queue entry, and the mark in a record's detail, that say that a job is a sync."""
_KIND = "deployment-job"


def latest_deployment(store: Store, fleet: str) -> JobRecord:
    """Returns the fleet's last deployment job that was planned, however it ended; ``fleet`` is its name or ARN.

    Raises:
        ResourceNotFound: No such fleet, or nothing was deployed to it yet.
        TrustRefused: The store's records name another fleet's.
    """
    record, _ = read_fleet(store, fleet)
    last = _recorded(store, record.deployment)
    if record.deployment and (last is None or "plan" not in last.detail):
        # It waits, or was killed before it was planned, and asked no robot: the deployment before it counts.
        planned = [job for job in records(store, _KIND) if _plan_of(job).get("fleet") == record.name]
        last = planned[-1] if planned else None
    if last is None:
        fault = Fault(path="fleet", value=repr(fleet), allowed="a fleet to which something was deployed")
        raise ResourceNotFound([fault], source="SyncDeploymentJob")
    if (planned := _plan_of(last).get("fleet")) != record.name:
        what = f"{last.id!r:.100}, the last deployment of {record.name!r} by the store's records, is {planned!r:.100}'s"
        raise TrustRefused(f"{what}; find out who writes to the store, and make a new deployment")
    return last


def _recorded(store: Store, job: str) -> JobRecord | None:
    try:
        return read(store, _KIND, job) if job else None
    except ResourceNotFound:  # its fleet is taken before it is recorded
        return None


def sync_request(last: JobRecord, token: str) -> CreateDeploymentJobRequest:
    """Returns a deployment's request made again under another token; a sync has no tags."""
    document = {name: value for name, value in last.request.items() if name != "tags"}
    return CreateDeploymentJobRequest.model_validate({**document, "clientRequestToken": token})


def plan_sync(store: Store, last: JobRecord, *, only_failed: bool = False) -> RolloutPlan:
    """Returns the last deployment's plan for those members of its fleet that are not in sync with it.

    Only the failed are those that were asked and failed, or did not answer; not those that joined later, or that a
    roll-out which stopped had left as they were. Bytes and launch are those of the last plan, whatever was published
    since; shares are of those that take part, and variables follow robots' tags. A robot for whose architecture the
    version has no bundle is left out (`robots_without_build` names them).
    """
    plan = RolloutPlan.model_validate(last.detail["plan"])
    request = CreateDeploymentJobRequest.model_validate(last.request)
    # Those of the plan, not of the request: a signature may stand under the plan.
    variables, tags = plan.launch.environmentVariables or {}, request.tags or {}
    robots = members(store, plan.fleet)
    plan = plan.model_copy(update={"digests": digests_for(robots, plan.builds)})
    wanted = {robot.name: launch_environment.environment(variables, robot.tags, tags) for robot in robots}
    lacking = {"failed"} if only_failed else {"failed", "other"}
    never = robots_without_build(robots, plan)
    asked = {robot: each for robot, each in wanted.items() if robot not in never}
    given = {robot: each for robot, each in asked.items() if _standing(store, robot, plan, each) in lacking}
    bounds = bounds_for(len(given), request)
    return plan.model_copy(update={"environments": given, "at_once": bounds.at_once, "failures": bounds.failures})


def robots_without_build(robots: Iterable[RobotRecord], plan: RolloutPlan) -> tuple[str, ...]:
    """Returns the robots that can never run a plan's version: it has no bundle for their architecture."""
    return tuple(robot.name for robot in robots if plan.builds and robot.architecture not in plan.builds)


def _standing(
    store: Store, robot: str, plan: RolloutPlan, variables: Mapping[str, str]
) -> Literal["in sync", "failed", "other"]:
    """Returns whether a robot runs the plan's bytes as the plan launches them, with these variables, or failed to."""
    desired, _ = read_desired(store, robot)
    if desired is None or (desired.digest, desired.launch) != (plan.digest_for(robot), plan.launch):
        return "other"
    reported = read_reported(store, robot)
    answered = reported is not None and (reported.deployment, reported.sequence) == (
        desired.deployment,
        desired.sequence,
    )
    if reported is None or not answered or reported.status != "InSync":
        return "failed"
    return "in sync" if desired.environment == dict(variables) else "other"


def _plan_of(job: JobRecord) -> Mapping[str, object]:
    plan = job.detail.get("plan")
    return plan if isinstance(plan, dict) else {}
