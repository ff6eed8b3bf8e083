"""Turns a request for a deployment into a plan, or reports every reason why that is not possible."""

from collections.abc import Iterable, Iterator, Mapping

from specs.arn import parse_reference
from specs.base import Fault
from specs.bundle.launched_file import ros_launch_file
from specs.errors import BundleRefused, DocumentError, ObjectNotFound, ResourceNotFound, TrustRefused
from specs.field_types import Architecture
from specs.pipeline.simulation_section import RollOutRules
from specs.robomaker.bundle import Application, Version
from specs.robomaker.deployment import (
    CreateDeploymentJobRequest,
    DeploymentApplicationConfig,
    DeploymentConfig,
    DeploymentLaunchConfig,
)
from tasks.deploy.fleet import launch_environment
from tasks.deploy.fleet.fleets import read_fleet
from tasks.deploy.fleet.robots import known_robot, members
from tasks.deploy.fleet.states import RobotRecord
from tasks.deploy.kit.local_agents import local_names, machine_architecture
from tasks.deploy.rollout.rollout_plan import RolloutPlan, digests_for
from tasks.deploy.rollout.waves import Limits, limits
from tasks.deploy.trust.trust_record import Signer
from tasks.storage.archives import list_bundle_files, safe_parts
from tasks.storage.base.encoding import decode_document
from tasks.storage.base.key_rules import checked_name
from tasks.storage.base.keys import application_key
from tasks.storage.base.store import Store
from tasks.storage.buckets import source_faults

_PATH = "deploymentApplicationConfigs.0"
_PUBLISHED = "a robot application that was published"
_SECTION_PATH = "deployment.deploymentApplicationConfigs[0]"
_TIMEOUT_S = 18_000  # docs/reference/robomaker.md, section 8
# RoboMaker states no defaults. With these a bad version reaches a fifth of a fleet, and stops before it reaches half.
_CONCURRENT_PERCENT = 20
_THRESHOLD_PERCENT = 40


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
    fleet, _ = read_fleet(store, request.fleet)
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
) -> list[Fault]:
    """Returns the faults of a pipeline's deployment that can be found before the pipeline begins.

    Args:
        store: Where fleet, robots and bundles are.
        fleet: Its name or ARN.
        local_agents: How many robots the run makes for itself; 0 for a fleet that has its own.
        launch: What is run on a robot.
        version: What is deployed.
        signer: Whose keys must vouch that robots which the run does not make belong to the fleet; None for nobody's.
    """
    path = f"{_SECTION_PATH}.launchConfig"
    bundles = dict.fromkeys(version.digests.values() or [version.digest])
    return [
        *(
            _local_faults(store, fleet, local_agents, version)
            if local_agents
            else _member_faults(store, fleet, version, signer)
        ),
        *outside_package(launch, path),
        *(fault for digest in bundles for fault in _file_faults(store, launch, digest, path)),
        *launch_environment.variable_faults(launch.environmentVariables or {}, f"{path}.environmentVariables"),
    ]


def _member_faults(store: Store, reference: str, version: Version, signer: Signer | None) -> list[Fault]:
    path = "deployment.fleet"
    try:
        name = read_fleet(store, reference)[0].name
    except DocumentError as exc:
        return [fault.model_copy(update={"path": path}) for fault in exc.faults]
    robots = members(store, name)
    architectures: dict[str, Architecture] = {robot.name: robot.architecture for robot in robots}
    return [
        *_fleet_faults(name, robots, path),
        *_architecture_faults(architectures, version, path),
        *_stranger_faults(signer, name, [*architectures], path),
    ]


def _stranger_faults(signer: Signer | None, fleet: str, robots: list[str], path: str) -> Iterator[Fault]:
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


def _file_faults(store: Store, launch: DeploymentLaunchConfig, digest: str, path: str) -> Iterator[Fault]:
    outside = {fault.path for fault in outside_package(launch, path)}
    try:
        found = list_bundle_files(store, digest)
    except (ObjectNotFound, BundleRefused) as exc:
        yield Fault(path=f"{_SECTION_PATH}.application", value=digest, allowed=f"a bundle that is whole: {exc}")
        return
    of_ros = ros_launch_file(found, launch.packageName, launch.launchFile) is not None  # which need not be executable
    for field, name in launch_files(launch).items():
        place = f"{path}.{field}"
        if found.get(name) or place in outside or (field, of_ros) == ("launchFile", True):
            continue
        wrong = "is not executable: chmod +x it and publish again" if name in found else "is not in the bundle"
        yield Fault(path=place, value=repr(getattr(launch, field)), allowed=f"an executable file; {name} {wrong}")


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
    key = application_key("robot-application", reference.path)
    try:
        application = decode_document(Application, store.get(key), store, key)
    except ObjectNotFound as exc:
        raise _missing("application", config.application, _PUBLISHED) from exc
    if application.deleted:
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
    return ResourceNotFound([Fault(path=f"{_PATH}.{field}", value=repr(value), allowed=allowed)], source="deployment")
