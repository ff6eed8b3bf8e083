"""SyncDeploymentJob: what a fleet ran last, on those of its robots that do not run it (semantics 8).

They joined later, were away, or failed; with a failed one, a sync is how only the failed are tried again.
"""

from collections.abc import Mapping

from specs.base import Fault
from specs.deployment import CreateDeploymentJobRequest
from specs.errors import ResourceNotFound
from tasks.deploy import environment
from tasks.deploy.fleets import read_fleet
from tasks.deploy.plan import Plan, digests_for
from tasks.deploy.planning import bounds_for
from tasks.deploy.robots import members, read_desired, read_reported
from tasks.storage.records import JobRecord, read, records
from tasks.storage.store import Store

_KIND = "deployment-job"


def latest_deployment(store: Store, fleet: str) -> JobRecord:
    """Returns the fleet's last deployment job that was planned, however it ended; ``fleet`` is its name or ARN.

    Raises:
        ResourceNotFound: No such fleet, or nothing was deployed to it yet.
    """
    record, _ = read_fleet(store, fleet)
    last = read(store, _KIND, record.deployment) if record.deployment else None
    if last is not None and "plan" not in last.detail:
        # It was killed before it was planned, and asked nobody: what counts is the one before it.
        planned = [job for job in records(store, _KIND) if _plan_of(job).get("fleet") == record.name]
        last = planned[-1] if planned else None
    if last is None:
        fault = Fault(path="fleet", value=repr(fleet), allowed="a fleet to which something was deployed")
        raise ResourceNotFound([fault], source="SyncDeploymentJob")
    return last


def sync_request(last: JobRecord, token: str) -> CreateDeploymentJobRequest:
    """Returns a deployment's request made again under another token; a sync has no tags."""
    document = {name: value for name, value in last.request.items() if name != "tags"}
    return CreateDeploymentJobRequest.model_validate({**document, "clientRequestToken": token})


def plan_sync(store: Store, last: JobRecord) -> Plan:
    """Returns the last deployment's plan for those members of its fleet that are not in sync with it.

    Bytes and launch are those of the last plan, whatever was published since; shares are of those that take part, and
    variables follow robots' tags.
    """
    plan = Plan.model_validate(last.detail["plan"])
    request = CreateDeploymentJobRequest.model_validate(last.request)
    # Those of the plan, not of the request: a signature may stand under the plan.
    variables, tags = plan.launch.environmentVariables or {}, request.tags or {}
    robots = members(store, plan.fleet)
    plan = plan.model_copy(update={"digests": digests_for(robots, plan.builds)})
    wanted = {robot.name: environment.environment(variables, robot.tags, tags) for robot in robots}
    given = {robot: each for robot, each in wanted.items() if not _runs(store, robot, plan, each)}
    bounds = bounds_for(len(given), request)
    return plan.model_copy(update={"environments": given, "at_once": bounds.at_once, "failures": bounds.failures})


def _runs(store: Store, robot: str, plan: Plan, variables: Mapping[str, str]) -> bool:
    """Returns whether a robot runs the plan's bytes as the plan launches them, with these variables."""
    desired, _ = read_desired(store, robot)
    reported = read_reported(store, robot)
    if desired is None or reported is None:
        return False
    wanted = (plan.digest_for(robot), plan.launch, dict(variables))
    answered = (reported.deployment, reported.sequence) == (desired.deployment, desired.sequence)
    return answered and reported.status == "InSync" and (desired.digest, desired.launch, desired.environment) == wanted


def _plan_of(job: JobRecord) -> Mapping[str, object]:
    plan = job.detail.get("plan")
    return plan if isinstance(plan, dict) else {}
