"""What a request for a deployment comes to: which bytes, to whom, how many at a time; or every reason why not."""

from collections.abc import Iterator

from specs.arn import parse_reference
from specs.base import Fault
from specs.bundle import Application, Version
from specs.deployment import CreateDeploymentJobRequest, DeploymentApplicationConfig, DeploymentConfig
from specs.errors import BundleRefused, DocumentError, ObjectNotFound, ResourceNotFound
from tasks.deploy import environment
from tasks.deploy.controller import Plan
from tasks.deploy.fleets import read_fleet
from tasks.deploy.robots import members
from tasks.deploy.rollout import limits
from tasks.deploy.states import RobotRecord
from tasks.storage.archives import safe_parts
from tasks.storage.encoding import decoded
from tasks.storage.keys import application_key
from tasks.storage.store import Store

_PATH = "deploymentApplicationConfigs.0"
_TIMEOUT_S = 18_000  # semantics 8
# RoboMaker states no defaults. With these a bad version reaches a fifth of a fleet, and stops before it reaches half.
_CONCURRENT_PERCENT = 20
_THRESHOLD_PERCENT = 40


def plan_deployment(store: Store, request: CreateDeploymentJobRequest, digest: str) -> Plan:
    """Returns what the request comes to now.

    Args:
        store: Where fleet, robots and versions are.
        request: What to deploy where.
        digest: Of the bundle that was tested; the version must be that one.

    Raises:
        ResourceNotFound: No such fleet, application or version.
        DocumentError: The version is another than was tested, a variable or file is not allowed, or the fleet is empty.
    """
    fleet, _ = read_fleet(store, request.fleet)
    robots = members(store, fleet.name)
    config = request.deploymentApplicationConfigs[0]
    version = _version(store, config)
    faults = [*_faults(config, version, digest), *_fleet_faults(fleet.name, robots)]
    if faults:
        raise DocumentError(faults, source="deployment")
    rules = request.deploymentConfig or DeploymentConfig()
    bounds = limits(
        len(robots),
        concurrent_percent=rules.concurrentDeploymentPercentage or _CONCURRENT_PERCENT,
        threshold_percent=rules.failureThresholdPercentage or _THRESHOLD_PERCENT,
    )
    variables, tags = config.launchConfig.environmentVariables or {}, request.tags or {}
    return Plan(
        fleet=fleet.name,
        application=version.name,
        version=version.number,
        digest=version.digest,
        launch=config.launchConfig,
        environments={robot.name: environment.environment(variables, robot.tags, tags) for robot in robots},
        condition=rules.downloadConditionFile,
        at_once=bounds.at_once,
        failures=bounds.failures,
        timeout_s=rules.robotDeploymentTimeoutInSeconds or _TIMEOUT_S,
    )


def _version(store: Store, config: DeploymentApplicationConfig) -> Version:
    try:
        reference = parse_reference(config.application)
    except ValueError as exc:
        raise _missing("application", config.application, str(exc)) from exc
    if reference.kind not in {None, "robot-application"}:
        raise _missing("application", config.application, "the ARN of a robot-application")
    key = application_key("robot-application", reference.path)
    try:
        application = decoded(Application, store.get(key), store, key)
    except ObjectNotFound as exc:
        raise _missing("application", config.application, "a robot application that was published") from exc
    wanted = int(config.applicationVersion)
    found = next((version for version in application.versions if version.number == wanted), None)
    if found is None:
        raise _missing("applicationVersion", config.applicationVersion, f"1 to {len(application.versions)}")
    return found


def _faults(config: DeploymentApplicationConfig, version: Version, digest: str) -> Iterator[Fault]:
    if version.digest != digest:
        yield Fault(
            path=f"{_PATH}.applicationVersion",
            value=f"{version.number}, with digest {version.digest}",
            allowed=f"the version that was tested, with digest {digest}",
        )
    launch = config.launchConfig
    for field in ("preLaunchFile", "launchFile", "postLaunchFile"):
        name: str | None = getattr(launch, field)
        try:
            safe_parts(f"{launch.packageName}/{name or launch.launchFile}")
        except BundleRefused:
            yield Fault(path=f"{_PATH}.launchConfig.{field}", value=repr(name), allowed="a file inside the package")
    yield from environment.faults(launch.environmentVariables or {}, f"{_PATH}.launchConfig.environmentVariables")


def _fleet_faults(fleet: str, robots: list[RobotRecord]) -> Iterator[Fault]:
    if not robots:
        yield Fault(path="fleet", value=fleet, allowed="a fleet with at least one robot; register some")


def _missing(field: str, value: str, allowed: str) -> ResourceNotFound:
    return ResourceNotFound([Fault(path=f"{_PATH}.{field}", value=repr(value), allowed=allowed)], source="deployment")
