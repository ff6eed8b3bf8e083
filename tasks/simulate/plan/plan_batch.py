"""Makes a batch's plan of a document's simulation section, with all references resolved.

Also reads the request in a batch's record, of a batch or of a single job.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import NamedTuple, cast

from pydantic import JsonValue

from specs.arn import parse_reference
from specs.base import Fault
from specs.data.episode import ApplicationLaunch
from specs.data.people import People
from specs.errors import DocumentError, KeptFaults
from specs.field_types import Architecture, OutputLocation, TagMap
from specs.launched_file import (
    IMAGE_FILE,
    is_ros2,
    module_file,
    module_name,
    ros_launch_file,
    simulated_file,
)
from specs.pipeline.section_requests import REQUESTS, undriven_faults
from specs.pipeline.simulation_section import PipelineJobRequest, PipelineRobotApplication, SimulationBatch
from specs.pipeline.simulation_section import PipelineSimulationApplication as ScenarioUse
from specs.robomaker.bundle import ApplicationKind, Version
from specs.robomaker.simulation import (
    BatchPolicy,
    CreateSimulationJobRequest,
    DataSourceConfig,
    StartSimulationJobBatchRequest,
)
from tasks.simulate.data.data_sources import DATA_PREFIX, PinnedSource, data_variable, unpinned, within_limits
from tasks.simulate.plan.batch_plan import BatchPlan, JobTemplate, lane_count
from tasks.simulate.plan.episode_layout import Layout
from tasks.storage.jobs.records import JobRecord

FindVersion = Callable[[ApplicationKind, str, str | None], Version]
FindData = Callable[[DataSourceConfig], PinnedSource]
FindFiles = Callable[[str], Collection[str]]
"""Gives the names of the files of a bundle, by its digest."""
DEFAULT_TIMEOUT_S = 86_400.0
DEFAULT_OUTPUT = OutputLocation(s3Bucket="results")


def plan_batch(
    section: SimulationBatch,
    worlds: Sequence[str],
    world_digests: Mapping[str, str],
    find_version: FindVersion,
    find_data: FindData = unpinned,
    *,
    find_files: FindFiles | None = None,
) -> BatchPlan:
    """Returns the plan of a batch.

    Args:
        section: The document's section.
        worlds: ``<generation>/<world>`` of each world of the matrix.
        world_digests: SHA-256 of each world's document, for all worlds that the batch uses.
        find_version: Gives the version that an application reference means.
        find_data: Gives a data source with the content that it has now.
        find_files: Asked for the bundles of robots that name a launch file as those of ROS are; None where modules
            alone are launched.

    Raises:
        DocumentError: A request lacks an application or a launch configuration; tells of all requests at once.
    """
    requests, policy = section.createSimulationJobRequests, section.batchPolicy
    named = [fault for number, request in enumerate(requests) for fault in _twice_named(number, request)]
    if faults := [*undriven_faults(section), *named]:
        raise DocumentError(faults)
    data = [within_limits(tuple(map(find_data, request.dataSources or ()))) for request in requests]
    launches, faults = _Launches(find_version, find_files), KeptFaults()
    swept = frozenset(section.matrix.environmentVariables)
    several = section.robots if section.robots != 1 else None
    templates = [
        faults.keep(
            lambda number=number, request=request: _template(number, request, launches, data[number], swept, several)
        )
        for number, request in enumerate(requests)
    ]
    if faults:
        raise _first_of_each(faults.together())
    plan = BatchPlan(
        templates=tuple(each for each in templates if each),
        worlds=tuple(worlds),
        seeds=seed_list(section),
        sweep=section.matrix.sweep,
        lanes=1,
        timeout_s=float((policy and policy.timeoutInSeconds) or DEFAULT_TIMEOUT_S),
        world_digests=dict(world_digests),
        engine="planar" if several and section.engine == "auto" else section.engine,
        data_sources={source.digest: source for sources in data for source in sources},
        recordings=section.recordings,
        audit=0 if several else section.audit.lanes,
        robots=several,
        boxes=section.boxes,
        people=People(count=section.people) if isinstance(section.people, int) else section.people,
    )
    return plan.model_copy(
        update={"lanes": lane_count(policy and policy.maxConcurrency, Layout(plan).episodes, plan.sharing)}
    )


def seed_list(section: SimulationBatch) -> tuple[int, ...]:
    """Returns the matrix's seeds: those listed, or 0 to n-1."""
    seeds = section.matrix.seeds
    return tuple(range(seeds)) if isinstance(seeds, int) else tuple(seeds)


def matrix_worlds(section: SimulationBatch, worlds: Sequence[str]) -> list[str]:
    """Returns ``<generation>/<world>`` of each world of the matrix; ``worlds`` are those that ``all`` means."""
    chosen = worlds if section.matrix.worlds == "all" else section.matrix.worlds
    return list(dict.fromkeys(parse_reference(world).path for world in chosen))


def requested_worlds(section: SimulationBatch) -> list[str]:
    """Returns ``<generation>/<world>`` of each world that a request brings for itself alone."""
    own = [world for request in section.createSimulationJobRequests for world in _own_worlds(request)]
    return list(dict.fromkeys(parse_reference(world).path for world in own))


def output_location(section: SimulationBatch) -> OutputLocation:
    """Returns where the batch's tables go: the section's place, else the one that its requests agree on.

    RoboMaker has the location in each request; a batch here has one table, so they must be the same.

    Raises:
        DocumentError: The requests name different places, and the section none.
    """
    if section.outputLocation is not None:
        return section.outputLocation
    asked = [request.outputLocation for request in section.createSimulationJobRequests if request.outputLocation]
    places = {f"{place.s3Bucket}/{place.s3Prefix or ''}": place for place in asked}
    if len(places) > 1:
        path = "simulationBatch.createSimulationJobRequests[*].outputLocation"
        allowed = "one place for the whole batch, as simulationBatch.outputLocation"
        raise DocumentError.of(path, ", ".join(sorted(places)), allowed)
    return next(iter(places.values()), DEFAULT_OUTPUT)


def _template(  # noqa: PLR0917 - of a request
    number: int,
    request: PipelineJobRequest,
    launches: "_Launches",
    data: Sequence[PinnedSource],
    swept: frozenset[str],
    several: int | None,
) -> JobTemplate:
    where = f"{REQUESTS}[{number}]"
    robot = next(iter(request.robotApplications or ()), None)
    scenario = next(iter(request.simulationApplications or ()))
    faults, place, own = KeptFaults(), f"{where}.simulationApplications[0]", f"{where}.robotApplications[0]"
    driver = faults.keep(lambda: launches.resolved(own, "robot-application", robot)) if robot else None
    judge = faults.keep(lambda: launches.resolved(place, "simulation-application", scenario))
    if faults or judge is None:
        raise faults.together()
    if several and any(launches.is_image(each) or each.starts_nodes for each in (driver, judge) if each):
        allowed = f"modules or a policy; nodes of ROS drive alone in their world, and there are {several} robots"
        raise DocumentError.of(own, "nodes of ROS", allowed)
    if fault := _judge_fault(where, driver, judge, launches.is_image):
        raise DocumentError([fault])
    judging = scenario.launchConfig.environmentVariables or {}
    driving = (robot and robot.launchConfig.environmentVariables) or {}
    both = judging.keys() & driving.keys() - swept
    other = {name: value for name, value in judging.items() if name in both and driving[name] != value}
    if other and not judge.starts_nodes:
        allowed = "the robot application's values, or other names: a module sees the same variables"
        raise DocumentError.of(f"{place}.launchConfig.environmentVariables", repr(other), allowed)
    return JobTemplate(
        robot=driver or judge,
        scenario=judge,
        judge_environment=other or None,
        environment={
            **judging,
            **driving,
            **{name: f"{factor:.9g}" for name, factor in (request.physics or {}).items()},
            **{data_variable(source.name): f"{DATA_PREFIX}{source.digest}" for source in data},
        },
        duration_s=float(request.maxJobDurationInSeconds),
        failure_behavior=request.failureBehavior or "Fail",
        worlds=tuple(parse_reference(world).path for world in _own_worlds(request)),
        seed=request.seed,
        record=bool(request.loggingConfig and request.loggingConfig.recordAllRosTopics),
    )


def _judge_fault(
    where: str,
    robot: ApplicationLaunch | None,
    judge: ApplicationLaunch,
    is_image: Callable[[ApplicationLaunch], bool],
) -> Fault | None:
    """Returns why a robot application and a simulation application do not go together; None if they do.

    Which ROS lies in an image is known where it is unpacked.
    """
    place = f"{where}.simulationApplications[0].launchConfig.launchFile"
    if robot is None and not judge.starts_nodes:
        allowed = f"one: {judge.name} launches a module, which only judges; a launch file of ROS may be alone"
        return Fault(path=f"{where}.robotApplications", value="none", allowed=allowed)
    if not judge.starts_nodes:
        return None
    images = [is_image(each) for each in (robot, judge) if each]
    known = not any(images) and robot and robot.starts_nodes
    if robot and not images[0] and (not robot.starts_nodes or (known and _kind(robot) != _kind(judge))):
        kind = "container image" if images[1] else f"launch file of ROS {_kind(judge)}"
        allowed = f"a module, as the robot application's {robot.launch_file} is no {kind} as this one is"
        return Fault(path=place, value=repr(judge.launched), allowed=allowed)
    return None


def _kind(launch: ApplicationLaunch) -> int:
    return 2 if is_ros2(launch.launch_file) else 1


def _first_of_each(refusal: DocumentError) -> DocumentError:
    """Returns a refusal that names what many requests have in common once, where the first of them has it."""
    first: dict[tuple[str, str], Fault] = {}
    for fault in refusal.faults:
        first.setdefault((fault.value, fault.allowed), fault)
    return type(refusal)([*first.values()])


class _Launches(NamedTuple):
    """Launch configurations, resolved with what finds versions and the files of their bundles."""

    find_version: FindVersion
    find_files: FindFiles | None

    def resolved(
        self, where: str, kind: ApplicationKind, use: PipelineRobotApplication | ScenarioUse
    ) -> ApplicationLaunch:
        """Returns what is launched; ``where`` is where the document says it."""
        try:
            version = self.find_version(kind, use.application, use.applicationVersion)
            asked = use.architecture if isinstance(use, PipelineRobotApplication) else None
            architecture = _simulated_architecture(version, asked)
        except DocumentError as exc:
            placed = [fault.model_copy(update={"path": f"{where}.{fault.path}"}) for fault in exc.faults]
            raise type(exc)(placed, exc.source) from exc
        digest = version.digests[architecture] if architecture else version.digest
        package, named = use.launchConfig.packageName or "", use.launchConfig.launchFile or ""
        return ApplicationLaunch(
            name=version.name,
            version=str(version.number),
            digest=digest,
            package=package,
            launch_file=module_name(named) if self._is_module(kind, digest, package, named) else named,
            architecture=architecture,
            command=None if named else use.launchConfig.command,
        )

    def is_image(self, launch: ApplicationLaunch) -> bool:
        """Returns whether a container image is launched."""
        return self.find_files is not None and IMAGE_FILE in self.find_files(launch.digest)

    def _is_module(self, kind: ApplicationKind, digest: str, package: str, named: str) -> bool:
        """Returns whether a module is launched, which loses its ending; other files keep it."""
        if module_name(named) == named or self.find_files is None:
            return True
        files, module = self.find_files(digest), module_file(package, named)
        if IMAGE_FILE in files:
            return False
        if kind == "simulation-application":  # documents from before say x.launch, and mean the module beside it
            return module in files or ros_launch_file(files, package, named) is None
        return simulated_file(files, package, named) == module


def _simulated_architecture(version: Version, asked: Architecture | None) -> Architecture | None:
    """Returns which of a version's builds is simulated: that for X86_64 if nobody asks; None where there is but one.

    See docs/reference/robomaker.md, section 3.
    """
    if not version.builds and asked:
        allowed = f"nothing: version {version.number} of {version.name} has one bundle for all architectures"
        raise DocumentError.of("architecture", asked, allowed)
    if not version.builds or (asked or "X86_64") in version.digests:
        return (asked or "X86_64") if version.builds else None
    value = f"{version.name} version {version.number}, for {', '.join(version.digests)}"
    if asked is None:
        raise DocumentError.of("applicationVersion", value, "a version with an X86_64 source")
    raise DocumentError.of("architecture", asked, f"an architecture of {value}")


def _own_worlds(request: PipelineJobRequest) -> list[str]:
    scenarios = request.simulationApplications or ()
    return [config.world for scenario in scenarios for config in scenario.worldConfigs or () if config.world]


def _twice_named(number: int, request: PipelineJobRequest) -> list[Fault]:
    variables = [data_variable(source.name) for source in request.dataSources or ()]
    if len(set(variables)) == len(variables):
        return []
    allowed = "names that stay different in capital letters with _ for -, as variables have them"
    return [Fault(path=f"{REQUESTS}[{number}].dataSources", value=", ".join(variables), allowed=allowed)]


Document = dict[str, JsonValue]
_ENTRIES = "createSimulationJobRequests"


# See docs/reference/robomaker.md, sections 3 and 4.
def entries(record: JobRecord) -> list[Document]:
    """Returns the entries of a batch's request; a CreateSimulationJob is its own only entry."""
    request = _request(record)
    return cast("list[Document]", request[_ENTRIES]) if _ENTRIES in request else [dict(request)]


def is_single(record: JobRecord) -> bool:
    """Returns whether CreateSimulationJob made it, so that its only job is no batch's entry."""
    return _ENTRIES not in _request(record)


def policy_and_tags(record: JobRecord) -> tuple[BatchPolicy | None, TagMap | None]:
    """Returns a batch's policy and its own tags; a single job has neither, its tags are the job's."""
    if is_single(record):
        return None, None
    request = StartSimulationJobBatchRequest.model_validate(_request(record))
    return request.batchPolicy, request.tags


def recorded_location(record: JobRecord) -> OutputLocation:
    """Returns where the batch's tables go: its entries have the place, and agree on it."""
    if is_single(record):
        return CreateSimulationJobRequest.model_validate(_request(record)).outputLocation or DEFAULT_OUTPUT
    request = StartSimulationJobBatchRequest.model_validate(_request(record))
    places = (entry.outputLocation for entry in request.createSimulationJobRequests if entry.outputLocation)
    return next(places, DEFAULT_OUTPUT)


def _request(record: JobRecord) -> Mapping[str, JsonValue]:
    return cast("Mapping[str, JsonValue]", record.request["request"])
