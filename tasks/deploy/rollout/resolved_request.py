"""Turns a request for a deployment, or for a sync, into a plan, or reports every reason why that is not possible.

SyncDeploymentJob brings a fleet's latest deployment to those of its robots that do not run it.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Literal

from specs.arn import parse_reference
from specs.base import Fault
from specs.errors import BundleRefused, DocumentError, ObjectNotFound, ResourceNotFound, TrustRefused
from specs.field_types import Architecture
from specs.launched_file import IMAGE_FILE, ros_launch_file
from specs.pipeline.simulation_section import RollOutRules
from specs.program_file import built_for, start_fault
from specs.robomaker.bundle import Application, Version
from specs.robomaker.deployment import (
    CreateDeploymentJobRequest,
    DeploymentApplicationConfig,
    DeploymentConfig,
    DeploymentLaunchConfig,
)
from tasks.deploy.fleet import launch_environment
from tasks.deploy.fleet.fleet_registry import known_robot, members, read_desired, read_fleet, read_reported
from tasks.deploy.fleet.states import RobotRecord
from tasks.deploy.kit.local_agents import local_names, machine_architecture
from tasks.deploy.rollout.rollout_plan import Limits, RolloutPlan, digests_for, limits
from tasks.deploy.trust.trust_record import Signer
from tasks.storage.archives import read_bundle, safe_parts
from tasks.storage.base.keys import application_key, checked_name
from tasks.storage.base.store import Store, find_document
from tasks.storage.buckets import source_faults
from tasks.storage.jobs.records import JobRecord, read, records

_PATH = "deploymentApplicationConfigs.0"
_PUBLISHED = "a robot application that was published"
_SECTION_PATH = "deployment.deploymentApplicationConfigs[0]"
_TIMEOUT_S = 18_000  # docs/reference/robomaker.md, section 8
# RoboMaker states no defaults. With these a bad version reaches a fifth of a fleet, and stops before it reaches half.
_CONCURRENT_PERCENT = 20
_THRESHOLD_PERCENT = 40
SYNC = "sync"
"""The option of a queue entry, and the mark in a record's detail, that say that a job is a sync."""
_KIND = "deployment-job"


def plan_deployment(
    store: Store,
    request: CreateDeploymentJobRequest,
    digest: str,
    extra: RollOutRules | None = None,
    builds: Mapping[Architecture, str] | None = None,
) -> RolloutPlan:
    """Returns what the request comes to now.

    Args:
        store: Where fleet, robots and versions are.
        request: What to deploy where.
        digest: Of the bundle that was tested; the version must be that one.
        extra: Rules that RoboMaker's requests have no words for.
        builds: Digest of the bundle for each architecture; the version must have these and no others. None for any.

    Raises:
        ResourceNotFound: No such fleet, application or version.
        DocumentError: The version is another than was tested, a variable or file is not allowed, or the fleet is empty.
    """
    fleet = read_fleet(store, request.fleet)
    robots = members(store, fleet.name)
    version = _checked_version(store, request, digest, builds, _fleet_faults(fleet.name, robots, "fleet"))
    config = request.deploymentApplicationConfigs[0]
    rules = request.deploymentConfig or DeploymentConfig()
    bounds = bounds_for(len(robots), request)
    variables, tags = config.launchConfig.environmentVariables or {}, request.tags or {}
    return RolloutPlan(
        fleet=fleet.name,
        application=version.name,
        version=version.number,
        digest=version.digest,
        builds=version.digests,
        digests=digests_for(robots, version.digests),
        launch=config.launchConfig,
        environments={robot.name: launch_environment.environment(variables, robot.tags, tags) for robot in robots},
        condition=rules.downloadConditionFile,
        at_once=bounds.at_once,
        failures=bounds.failures,
        timeout_s=timeout_s(request),
        canaries=extra.canaryRobots if extra else 0,
        least_ended=extra.leastExecutedRobots if extra else 0,
    )


def bounds_for(robots: int, request: CreateDeploymentJobRequest) -> Limits:
    """Returns how many of so many robots a request has in flight at once, and how many failures stop it."""
    rules = request.deploymentConfig or DeploymentConfig()
    return limits(
        robots,
        concurrent_percent=rules.concurrentDeploymentPercentage or _CONCURRENT_PERCENT,
        threshold_percent=rules.failureThresholdPercentage or _THRESHOLD_PERCENT,
    )


def timeout_s(request: CreateDeploymentJobRequest) -> int:
    """Returns how long a robot may take, from being asked to its end."""
    rules = request.deploymentConfig or DeploymentConfig()
    return rules.robotDeploymentTimeoutInSeconds or _TIMEOUT_S


def preflight(
    store: Store,
    *,
    fleet: str,
    local_agents: int,
    launch: DeploymentLaunchConfig,
    version: Version,
    signer: Signer | None = None,
    source: str = "",
) -> list[Fault]:
    """Returns the faults of a pipeline's deployment that can be found before the pipeline begins.

    Args:
        store: Where fleet, robots and bundles are.
        fleet: Its name or ARN.
        local_agents: How many robots the run makes for itself; 0 for a fleet that has its own.
        launch: What is run on a robot.
        version: What is deployed.
        signer: Whose keys must vouch that robots which the run does not make belong to the fleet; None for nobody's.
        source: The folder that the bundle was just made of, for messages; empty if the store alone has it.
    """
    path = f"{_SECTION_PATH}.launchConfig"
    robots: list[Architecture] = [robot.architecture for robot in _known_members(store, fleet)]
    asked: list[Architecture] = [machine_architecture()] if local_agents else robots
    builds: list[tuple[str, list[Architecture]]] = [(digest, [built]) for built, digest in version.digests.items()]
    return [
        *(
            _local_faults(store, fleet, local_agents, version)
            if local_agents
            else _member_faults(store, fleet, version, signer)
        ),
        *outside_package(launch, path),
        *(
            fault
            for digest, built in builds or [(version.digest, asked)]
            for fault in _file_faults(store, launch, digest, built, here=local_agents > 0, source=source)
        ),
        *launch_environment.variable_faults(launch.environmentVariables or {}, f"{path}.environmentVariables"),
    ]


def _member_faults(store: Store, reference: str, version: Version, signer: Signer | None) -> list[Fault]:
    path = "deployment.fleet"
    try:
        name = read_fleet(store, reference).name
    except DocumentError as exc:
        return [fault.model_copy(update={"path": path}) for fault in exc.faults]
    robots = members(store, name)
    architectures: dict[str, Architecture] = {robot.name: robot.architecture for robot in robots}
    return [
        *_fleet_faults(name, robots, path),
        *_architecture_faults(architectures, version, path),
        *_unsigned_member_faults(signer, name, [*architectures], path),
    ]


def _unsigned_member_faults(signer: Signer | None, fleet: str, robots: list[str], path: str) -> Iterator[Fault]:
    try:
        if signer:
            signer.require_members(fleet, robots)
    except TrustRefused as exc:
        yield Fault(path=path, value=fleet, allowed=str(exc))


def _architecture_faults(robots: Mapping[str, Architecture], version: Version, path: str) -> Iterator[Fault]:
    for robot, architecture in robots.items():
        if version.builds and architecture not in version.digests:
            value = f"{robot}, of architecture {architecture}"
            allowed = f"robots for which version {version.number} of {version.name} has a bundle"
            allowed = f"{allowed}: {', '.join(version.digests)} (MissingRobotApplicationArchitecture)"
            yield Fault(path=path, value=value, allowed=allowed)


def _local_faults(store: Store, fleet: str, count: int, version: Version) -> list[Fault]:
    path = "deployment.fleet.name"
    try:
        checked_name(fleet)
        names = local_names(fleet, count)
        records = [known_robot(store, name) for name in names]
    except DocumentError as exc:
        return [fault.model_copy(update={"path": path}) for fault in exc.faults]
    taken = [record for record in records if record and record.fleet not in {"", fleet}]
    faults = [
        Fault(path=path, value=record.name, allowed=f"a robot without a fleet; it is in {record.fleet}")
        for record in taken
    ]
    made = machine_architecture()  # of those that are not there yet
    robots: dict[str, Architecture] = {
        name: record.architecture if record else made for name, record in zip(names, records, strict=True)
    }
    return [*faults, *_architecture_faults(robots, version, path)]


def _known_members(store: Store, reference: str) -> list[RobotRecord]:
    """Returns the robots of a fleet; none of one that is not there, which is a fault of its own."""
    try:
        return members(store, read_fleet(store, reference).name)
    except DocumentError:
        return []


def _file_faults(
    store: Store,
    launch: DeploymentLaunchConfig,
    digest: str,
    robots: Collection[Architecture],
    *,
    here: bool,
    source: str,
) -> Iterator[Fault]:
    """Yields what is wrong with the files that robots of some architectures launch of a bundle.

    Args:
        store: Where the bundle is.
        launch: What is launched.
        digest: Of the bundle.
        robots: Their architectures.
        here: Whether they are on this machine, which then has to have what scripts need.
        source: The folder that it was just made of, if any, before the names of files.
    """
    path = f"{_SECTION_PATH}.launchConfig"
    outside = {fault.path for fault in outside_package(launch, path)}
    try:
        found, heads = read_bundle(store, digest, launch_files(launch).values())
    except (ObjectNotFound, BundleRefused) as exc:
        yield Fault(path=f"{_SECTION_PATH}.application", value=digest, allowed=f"a bundle that is whole: {exc}")
        return
    if IMAGE_FILE in found:
        return  # its programs lie in its layers
    of_ros = ros_launch_file(found, launch.packageName, launch.launchFile) is not None  # which need not be executable
    for field, name in launch_files(launch).items():
        place = f"{path}.{field}"
        if place in outside or (field, of_ros) == ("launchFile", True):
            continue
        shown = f"{source}/{name}" if source else name
        why = program_fault(shown, heads.get(name), robots, executable=found.get(name, False), here=here)
        if why:
            yield Fault(path=place, value=repr(getattr(launch, field)), allowed=f"a file that can be started; {why}")


def program_fault(
    name: str, head: bytes | None, robots: Collection[Architecture], *, executable: bool, here: bool
) -> str:
    """Returns why a bundle's file cannot be started on robots, and what to do; empty if nothing is known to be wrong.

    Args:
        name: What to call it.
        head: Its first bytes; None if it is not there.
        robots: Their architectures, if they are known.
        executable: Whether its mode says so.
        here: Whether the robots are on this machine, which then has to have what the file needs.
    """
    if head is None:
        return f"the bundle has no {name}"
    if not executable:
        return f"{name} is not executable: chmod +x {name}"
    if wrong := start_fault(head, name):
        return wrong
    built, others = built_for(head), sorted({*robots} - {built_for(head)})
    if built and others:
        return f"{name} is compiled for {built}, and not for robots of {', '.join(others)}"
    if here and (absent := launch_environment.absent_program(head)):
        return f"{name}, line 1: needs {absent}, which this machine lacks: install it, or name another interpreter"
    return ""


def interpreter_notes(store: Store, launch: DeploymentLaunchConfig, version: Version) -> Iterator[str]:
    """Yields a line for each program that a version's scripts need on robots elsewhere, and that is not here.

    Raises:
        ObjectNotFound: The store has no such bundle.
        BundleRefused: It has another digest, or is not a plain tar.
    """
    for digest in dict.fromkeys(version.digests.values() or [version.digest]):
        _, heads = read_bundle(store, digest, launch_files(launch).values())
        for name, head in heads.items():
            if absent := launch_environment.absent_program(head):
                yield f"{name} needs {absent} on each robot; this machine has none"


def check_request(
    store: Store, request: CreateDeploymentJobRequest, digest: str, builds: Mapping[Architecture, str] | None = None
) -> None:
    """Does nothing for a request that can be planned as soon as its fleet has members; arguments as there.

    Raises:
        ResourceNotFound: No such fleet, application or version.
        DocumentError: The version is another than was tested, or a variable or file is not allowed.
    """
    read_fleet(store, request.fleet)
    _checked_version(store, request, digest, builds, ())


def _checked_version(
    store: Store,
    request: CreateDeploymentJobRequest,
    digest: str,
    builds: Mapping[Architecture, str] | None,
    fleet_faults: Iterable[Fault],
) -> Version:
    config = request.deploymentApplicationConfigs[0]
    version = _version(store, config)
    faults = [*_faults(config, version, digest), *_other_builds(version, builds), *fleet_faults]
    faults += source_faults(store, version, f"{_PATH}.applicationVersion")
    if faults:
        raise DocumentError(faults, source="deployment")
    return version


def _version(store: Store, config: DeploymentApplicationConfig) -> Version:
    try:
        reference = parse_reference(config.application)
    except ValueError as exc:
        raise _missing("application", config.application, str(exc)) from exc
    if reference.kind not in {None, "robot-application"}:
        raise _missing("application", config.application, "the ARN of a robot-application")
    application = find_document(store, application_key("robot-application", reference.path), Application)
    if application is None or application.deleted:
        raise _missing("application", config.application, _PUBLISHED)
    wanted = int(config.applicationVersion)
    found = next((version for version in application.versions if version.number == wanted), None)
    if found is None:
        raise _missing("applicationVersion", config.applicationVersion, application.numbers)
    return found


def _faults(config: DeploymentApplicationConfig, version: Version, digest: str) -> Iterator[Fault]:
    if version.digest != digest:
        yield Fault(
            path=f"{_PATH}.applicationVersion",
            value=f"{version.number}, with digest {version.digest}",
            allowed=f"the version that was tested, with digest {digest}",
        )
    yield from outside_package(config.launchConfig, f"{_PATH}.launchConfig")
    names = config.launchConfig.environmentVariables or {}
    yield from launch_environment.variable_faults(names, f"{_PATH}.launchConfig.environmentVariables")


def _other_builds(version: Version, builds: Mapping[Architecture, str] | None) -> Iterator[Fault]:
    if builds is not None and version.digests != builds:
        value, allowed = _builds_text(version.digests), f"the version as it was tested, with {_builds_text(builds)}"
        yield Fault(path=f"{_PATH}.applicationVersion", value=f"{version.number}, with {value}", allowed=allowed)


def _builds_text(builds: Mapping[Architecture, str]) -> str:
    return ", ".join(f"{digest} for {each}" for each, digest in builds.items()) or "one bundle for all architectures"


def launch_files(launch: DeploymentLaunchConfig) -> dict[str, str]:
    """Returns what a launch configuration runs, ``<package>/<file>`` in the bundle, by the field that names it."""
    named = {"preLaunchFile": launch.preLaunchFile, "launchFile": launch.launchFile}
    named["postLaunchFile"] = launch.postLaunchFile
    return {field: f"{launch.packageName}/{name}" for field, name in named.items() if name is not None}


def outside_package(launch: DeploymentLaunchConfig, path: str) -> Iterator[Fault]:
    """Yields a fault for each launch file that is no file of the package; ``path`` is where the document has them."""
    for field, name in launch_files(launch).items():
        try:
            safe_parts(name)
        except BundleRefused:
            yield Fault(path=f"{path}.{field}", value=repr(getattr(launch, field)), allowed="a file inside the package")


def _fleet_faults(fleet: str, robots: list[RobotRecord], path: str) -> Iterator[Fault]:
    if not robots:
        yield Fault(path=path, value=fleet, allowed="a fleet with at least one robot; simyard fleet register adds one")


def _missing(field: str, value: str, allowed: str) -> ResourceNotFound:
    return ResourceNotFound.of(f"{_PATH}.{field}", repr(value), allowed, source="deployment")


def latest_deployment(store: Store, fleet: str) -> JobRecord:
    """Returns the fleet's last deployment job that was planned, however it ended; ``fleet`` is its name or ARN.

    Raises:
        ResourceNotFound: No such fleet, or nothing was deployed to it yet.
        TrustRefused: The store's records name another fleet's.
    """
    record = read_fleet(store, fleet)
    last = _recorded(store, record.deployment)
    if record.deployment and (last is None or "plan" not in last.detail):
        # It waits, or was killed before it was planned, and asked no robot: the deployment before it counts.
        planned = [job for job in records(store, _KIND) if _plan_of(job).get("fleet") == record.name]
        last = planned[-1] if planned else None
    if last is None:
        raise ResourceNotFound.of(
            "fleet", repr(fleet), "a fleet to which something was deployed", source="SyncDeploymentJob"
        )
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
