"""The sections of a pipeline that test and deploy: the simulation batch and the deployment.

The rules beside them speak of several fields: variables that a request's robot and scenario share, and what a
deployment runs that no episode has tested.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Literal, cast

from pydantic import AfterValidator, Field

from specs.base import Spec
from specs.data.boxes import MOST_BOXES, Box, never_there
from specs.data.episode import CONTROL_HZ
from specs.data.people import MOST_PEOPLE, People
from specs.data.physics import PhysicalName, beyond_range, no_such_people
from specs.data.robots import MOST_ROBOTS
from specs.field_types import (
    GENERIC_PATTERN,
    Architecture,
    BagFormat,
    ClientRequestToken,
    EngineName,
    EnvironmentVariableKey,
    EnvironmentVariableValue,
    Integer,
    Number,
    PlainName,
    Reference,
    RobotTagMap,
    TagMap,
    WorldReference,
    text,
)
from specs.launched_file import names_ros_launch
from specs.pipeline.world_sections import Destination, Seed, WorldChoice
from specs.robomaker.bundle import Digest
from specs.robomaker.deployment import DeploymentConfig, DeploymentLaunchConfig, DeploymentVersion
from specs.robomaker.simulation import (
    MAX_BATCHED_JOB_DURATION_S,
    MAX_JOB_DURATION_S,
    MAX_REQUESTS,
    ApplicationUse,
    BatchedJobSettings,
    BatchPolicy,
    JobDuration,
    duration_rule,
)
from specs.rules import Finding, Location, Ruled, by_shape, distinct, items, member, part

_ROBOT, _SCENARIO = "robotApplications", "simulationApplications"
_LAUNCH, _VARIABLES = "launchConfig", "environmentVariables"
MAX_SEEDS = 10_000
MAX_LOCAL_AGENTS = 20
MIN_RECORDING_HZ, MAX_RECORDING_HZ = 0.1, CONTROL_HZ
AUDITED_LANES, MAX_AUDITED_LANES = 32, 256


# RoboMaker kept them apart, in containers of their own, and so are two launch files of ROS. Else one column, one sweep
# and one line of evidence stand for a variable, so two values under one name are refused instead of one being dropped.
def two_values(requests: Sequence[object], sweep: object) -> Iterator[Finding]:
    """Yields the variables that a request's robot and scenario give different values.

    Args:
        requests: As the document has them, right or wrong.
        sweep: The matrix's variables, whose values both applications get instead of their own.
    """
    for number, request in enumerate(requests):
        if all(runs_nodes(_launch(request, field)) for field in (_ROBOT, _SCENARIO)):
            continue
        robot, scenario = _variables(request, _ROBOT), _variables(request, _SCENARIO)
        for name in sorted((robot.keys() & scenario.keys()) - _mapping(sweep).keys()):
            if robot[name] != scenario[name]:
                yield _finding(number, name, robot[name], scenario[name])


def runs_nodes(launch: object) -> bool:
    """Returns whether a launch configuration, right or wrong, names a launch file of ROS, or only a command."""
    file = part(launch, "launchFile")
    return names_ros_launch(str(file)) if file else bool(part(launch, "command"))


def never_driven(requests: Sequence[object], sweep: object) -> Iterator[str]:
    """Yields the variables of robots and scenarios whose value the matrix replaces and never drives.

    Args:
        requests: As the document has them.
        sweep: The matrix's variables, each with its values.
    """
    values = _mapping(sweep)
    for request in requests:
        for field in (_ROBOT, _SCENARIO):
            for name, value in _variables(request, field).items():
                driven = values.get(name)
                if driven is not None and value not in items(driven):
                    yield f"createSimulationJobRequests[*].{field}[*].{_LAUNCH}.{_VARIABLES}.{name}"


def _finding(number: int, name: str, robots: object, scenarios: object) -> Finding:
    other = f"createSimulationJobRequests[{number}].{_ROBOT}[0].{_LAUNCH}.{_VARIABLES}.{name}"
    allowed = f"{robots!r} as in {other}, or another name: robot and scenario see the same variables"
    loc = ("createSimulationJobRequests", number, _SCENARIO, 0, _LAUNCH, _VARIABLES, name)
    return Finding(loc, scenarios, allowed)


def _variables(request: object, field: str) -> Mapping[str, object]:
    return _mapping(part(_launch(request, field), _VARIABLES))


def _launch(request: object, field: str) -> object:
    return part(next(iter(items(part(request, field))), None), _LAUNCH)


def _mapping(data: object) -> Mapping[str, object]:
    return cast("Mapping[str, object]", data) if isinstance(data, Mapping) else {}


Reason = Annotated[str, text(1, 255, GENERIC_PATTERN)]


class UntestedBuild(Spec):
    """A build that no episode drove, named by its digest, so that no other can be put in its place.

    Attributes:
        testedAs: The architecture whose build is driven in its place.
        digest: SHA-256 of the bundle, as `simyard app publish` printed it.
    """

    testedAs: Architecture = Field(title="Tested as")
    digest: Digest = Field(title="SHA-256")


UntestedBuilds = dict[Architecture, UntestedBuild]
UntestedVariables = Annotated[dict[EnvironmentVariableKey, Reason], Field(max_length=100)]


def unjudged(deployment: object, gate: object) -> Iterator[Finding]:
    """Yields what a raw deployment names as untested although no gate asks what was tested."""
    for name in ("untestedBuilds", "untestedVariables"):
        if part(deployment, name) is not None and gate is None:
            allowed = "a gate beside it; without one, nothing that ships needs to be tested"
            yield Finding(("deployment", name), part(deployment, name), allowed)


# The deployment's fields include what RoboMaker's requests have no words for.
class RollOutRules(Spec):
    """What a roll-out keeps to beyond RoboMaker's deploymentConfig."""

    canaryRobots: Annotated[Integer, Field(ge=0, le=1000)] = Field(
        default=0, title="Canaries", description="So many robots go first; a failure among them stops the roll-out."
    )
    leastExecutedRobots: Annotated[Integer, Field(ge=0, le=1000)] = Field(
        default=0,
        title="Least executed",
        description="The failure threshold counts once so many robots have ended.",
    )


Operation = Literal["StartSimulationJobBatch", "CreateSimulationJob"]
Engine = Literal["auto", EngineName]
Seeds = Annotated[
    Annotated[Integer, Field(ge=1, le=MAX_SEEDS), member("number")]
    | Annotated[tuple[Seed, ...], Field(min_length=1, max_length=MAX_SEEDS), AfterValidator(distinct), member("list")],
    by_shape("how many seeds (1, 2, ...), or a list of seeds", number=(int, float), list=(list, tuple)),
]
VariableValues = Annotated[tuple[EnvironmentVariableValue, ...], Field(min_length=1), AfterValidator(distinct)]


Numbers = Annotated[tuple[Number, ...], Field(min_length=1, max_length=MAX_SEEDS), AfterValidator(distinct)]


class Matrix(Spec):
    """Multiplies every request: each world, with each seed, with each combination of variables.

    Attributes:
        environmentVariables: Lists of values by name, such as {"MAX_SPEED": ["0.4", "0.6"]}; every combination is
            driven.
        physics: Lists of values of physical parameters, such as {"robot.mass": [0.9, 1.1]}; every
            combination is driven, too.
    """

    worlds: WorldChoice = Field(default="all", title="Worlds", description="All worlds of this run, or named ones.")
    seeds: Seeds = Field(
        default=1, title="Seeds", description="How many episodes of each world, or the seeds themselves."
    )
    environmentVariables: dict[EnvironmentVariableKey, VariableValues] = Field(
        default_factory=dict, title="Environment variables"
    )
    # None, not empty: documents without them keep the digest that they had before there were such factors.
    physics: dict[PhysicalName, Numbers] | None = Field(default=None, title="Physics")

    @property
    def sweep(self) -> dict[str, tuple[str, ...]]:
        """Returns the values of all that is swept, as an episode's variables have them."""
        physics = {name: tuple(f"{each:.9g}" for each in values) for name, values in (self.physics or {}).items()}
        return {**self.environmentVariables, **physics}


class Recordings(Spec):
    """Which episodes leave a recording of what the robot did, saw and touched.

    Attributes:
        bags: What ROS's tools read, besides: a file of each format for each recorded episode; none by default, but for
            requests with loggingConfig.recordAllRosTopics, whose episodes leave a rosbag unless this is an empty list.
    """

    episodes: Literal["failed", "all", "none"] = Field(
        default="failed",
        title="Episodes",
        description="Those of requests with loggingConfig.recordAllRosTopics are recorded in any case.",
    )
    rateHz: Annotated[Number, Field(ge=MIN_RECORDING_HZ, le=MAX_RECORDING_HZ)] = Field(
        default=10.0,
        title="Rate (Hz)",
        description="Samples a simulated second; the nearest of 20, 10, 6.7, 5, ... (20 / n) is kept, of 15 it is 20.",
    )
    picturesHz: Annotated[Number, Field(gt=0.0, le=MAX_RECORDING_HZ)] | None = Field(
        default=None,
        title="Pictures (Hz)",
        description="At most so many pictures a simulated second of each of a robot's cameras, and its last.",
    )
    # None, not empty: documents without them keep the digest that they had before there were such fields.
    bags: Annotated[tuple[BagFormat, ...], AfterValidator(distinct)] | None = Field(default=None, title="Bags")


class Audit(Spec):
    """How much of a batch is driven again on C MuJoCo, to show that its engine can be relied on."""

    lanes: Annotated[Integer, Field(ge=0, le=MAX_AUDITED_LANES)] = Field(
        default=AUDITED_LANES, title="Lanes", description="Episodes, a quarter of them failed ones; 0 audits nothing."
    )


PeopleChoice = Annotated[
    Annotated[Integer, Field(ge=1, le=MOST_PEOPLE), member("number")] | Annotated[People, member("People")],
    by_shape("how many people (1, 2, ...), or {count: ...}", number=(int, float), People=dict),
]


class PipelineWorldConfig(Spec):
    """The world of a request that names its own.

    Attributes:
        world: ``<generation>/<world>``, or an ARN.
    """

    world: WorldReference | None = None


class PipelineRobotApplication(ApplicationUse):
    """The robot application that is tested."""

    application: Reference = Field(title="Robot application", description="Name or ARN.")
    architecture: Architecture | None = Field(
        default=None,
        title="Architecture",
        description="Whose build is simulated, of a version with several; that for X86_64, if left out.",
    )


class PipelineSimulationApplication(ApplicationUse):
    """The scenario: where the robot starts, what it must do, what is measured.

    Attributes:
        worldConfigs: One world of this request's own, instead of the matrix's.
    """

    application: Reference = Field(title="Simulation application", description="Name or ARN.")
    worldConfigs: Annotated[tuple[PipelineWorldConfig, ...], Field(max_length=1)] | None = None


class PipelineJobRequest(BatchedJobSettings):
    """One job of the batch, before the matrix multiplies it.

    Attributes:
        robotApplications: The robot application that drives; exactly one.
        simulationApplications: The scenario that it is driven through; exactly one.
        physics: Values of physical parameters, each within its range; the matrix's win.
        seed: Its own, instead of the matrix's, which then has one alone.
    """

    maxJobDurationInSeconds: JobDuration = Field(
        title="Duration (s)",
        description="Simulated seconds at most; in a batch at most 691,200.",
        json_schema_extra={"minimum": 1, "maximum": MAX_JOB_DURATION_S},
    )
    robotApplications: Annotated[tuple[PipelineRobotApplication, ...], Field(min_length=1, max_length=1)] | None = None
    simulationApplications: (
        Annotated[tuple[PipelineSimulationApplication, ...], Field(min_length=1, max_length=1)] | None
    ) = None
    # None: documents without one keep the digest that they had before there was such a field.
    seed: Seed | None = Field(default=None, title="Seed")
    physics: dict[PhysicalName, Number] | None = Field(default=None, title="Physics")


class SimulationBatch(Ruled):
    """Simulates; takes a StartSimulationJobBatch request as it stands, or stands for a single CreateSimulationJob.

    Attributes:
        batchPolicy: How long it may take, and how much at once.
        outputLocation: Bucket and folder of the results; the store, if left out.
        matrix: What multiplies every request.
        createSimulationJobRequests: What is driven, from 1 to 1000 of them; each is multiplied by the matrix.
        engine: What simulates; auto takes the fastest that can, on this machine.
        people: Who walks in each world while the robot drives; nobody, if left out.
        boxes: What is put into each world while the robot drives; nothing, if left out.
        robots: How many robots of its application drive in each world together; one, if left out.
        recordings: Which episodes can be looked at afterwards.
        audit: How much is driven again on C MuJoCo.
        tags: At most 50 keys and values.
        clientRequestToken: Makes the request only once, however often it is sent; left out, the run has its own.
    """

    operation: Operation = Field(
        default="StartSimulationJobBatch", title="Call", description="Which of RoboMaker's calls this stands for."
    )
    batchPolicy: BatchPolicy | None = Field(default=None, title="Policy")
    outputLocation: Destination | None = Field(default=None, title="Output location")
    matrix: Matrix = Field(default_factory=Matrix, title="Matrix")
    createSimulationJobRequests: Annotated[
        tuple[PipelineJobRequest, ...], Field(min_length=1, max_length=MAX_REQUESTS)
    ] = Field(title="Requests")
    engine: Engine = Field(default="auto", title="Engine")
    # None, not empty: documents without them keep the digest that they had before there was such a field.
    people: PeopleChoice | None = Field(default=None, title="People")
    boxes: Annotated[tuple[Box, ...], Field(min_length=1, max_length=MOST_BOXES)] | None = Field(
        default=None, title="Boxes"
    )
    robots: Annotated[Integer, Field(ge=1, le=MOST_ROBOTS)] | None = Field(default=None, title="Robots")
    recordings: Recordings = Field(default_factory=Recordings, title="Recordings")
    audit: Audit = Field(default_factory=Audit, title="Parity audit")
    tags: TagMap | None = Field(default=None, title="Tags of the batch")
    clientRequestToken: ClientRequestToken | None = Field(default=None, title="Token")

    @classmethod
    def findings(cls, data: object) -> Iterator[Finding]:
        """Yields jobs that last too long for a batch, too many jobs for a call, and what excludes one another."""
        requests = items(part(data, "createSimulationJobRequests"))
        yield from _with_several_robots(data, requests)
        yield from never_there(part(data, "boxes"))
        yield from _unphysical(part(part(data, "matrix"), "physics"), ("matrix", "physics"), part(data, "people"))
        for number, request in enumerate(requests):
            where = ("createSimulationJobRequests", number, "physics")
            yield from _unphysical(part(request, "physics"), where, part(data, "people"))
        if (people := part(data, "people")) is not None and part(data, "boxes") is not None:
            yield Finding(("people",), people, "nothing; nobody walks in a world into which boxes are put")
        yield from two_values(requests, part(part(data, "matrix"), "environmentVariables"))
        yield from _two_seeds(requests, part(part(data, "matrix"), "seeds"))
        if part(data, "operation") == "CreateSimulationJob":
            if len(requests) > 1:
                allowed = "one; a CreateSimulationJob makes one job"
                yield Finding(("createSimulationJobRequests",), f"{len(requests)} requests", allowed)
            return
        for number, request in enumerate(requests):
            seconds = part(request, "maxJobDurationInSeconds")
            if type(seconds) is int and MAX_BATCHED_JOB_DURATION_S < seconds <= MAX_JOB_DURATION_S:
                loc = ("createSimulationJobRequests", number, "maxJobDurationInSeconds")
                yield Finding(loc, seconds, duration_rule(MAX_BATCHED_JOB_DURATION_S, " in a batch"))


def _unphysical(physics: object, where: Location, people: object) -> Iterator[Finding]:
    """Yields raw physical parameters, which stand somewhere, that are beyond their range or of people who are not."""
    yield from beyond_range(physics, where)
    for name, allowed in no_such_people(_mapping(physics), people):
        yield Finding((*where, name), part(physics, name), allowed)


def _with_several_robots(data: object, requests: Sequence[object]) -> Iterator[Finding]:
    """Yields what a raw section asks for that there is only for a robot that is alone in its world."""
    robots = part(data, "robots")
    if type(robots) is not int or robots <= 1:
        return
    alone = f"only a robot that is alone in its world has it, and there are {robots} robots"
    if (engine := part(data, "engine")) not in (None, "auto", "planar"):
        yield Finding(("engine",), engine, f"auto or planar; {alone}")
    if (boxes := part(data, "boxes")) is not None:
        yield Finding(("boxes",), boxes, f"nothing; {alone}")
    # A document with its defaults spelled out asks for no more than one without them.
    if (lanes := part(part(data, "audit"), "lanes")) not in (None, 0, AUDITED_LANES):
        yield Finding(("audit", "lanes"), lanes, f"0, or nothing; {alone}")
    if (pictures := part(part(data, "recordings"), "picturesHz")) is not None:
        yield Finding(("recordings", "picturesHz"), pictures, f"nothing; {alone}")
    if part(data, "operation") == "CreateSimulationJob":
        yield Finding(("robots",), robots, "1; a CreateSimulationJob makes one job, and each robot is one")
    for number, field in itertools.product(range(len(requests)), (_ROBOT, _SCENARIO)):
        if runs_nodes(_launch(requests[number], field)):
            loc = ("createSimulationJobRequests", number, field, 0, _LAUNCH)
            yield Finding(loc, "nodes of ROS", f"a module or a policy; {alone}")


def _two_seeds(requests: Sequence[object], seeds: object) -> Iterator[Finding]:
    """Yields the seeds of requests that the matrix multiplies by several."""
    if seeds in (None, 1) or len(items(seeds)) == 1:
        return
    for number, request in enumerate(requests):
        if (seed := part(request, "seed")) is not None:
            allowed = "nothing, or matrix.seeds 1: a request with a seed of its own is driven once"
            yield Finding(("createSimulationJobRequests", number, "seed"), seed, allowed)


class LocalFleet(Spec):
    """A fleet of robot agents that the run starts on this machine, for a demonstration.

    Attributes:
        name: What the fleet is called.
        localAgents: For a demonstration; they end with the run.
    """

    name: PlainName = Field(title="Fleet")
    localAgents: Annotated[Integer, Field(ge=0, le=MAX_LOCAL_AGENTS)] = Field(default=0, title="Robots on this machine")


class PipelineDeployedApplication(Spec):
    """The application that is deployed.

    Attributes:
        launchConfig: What is run on the robot.
    """

    application: Reference = Field(title="Robot application", description="Name or ARN.")
    applicationVersion: DeploymentVersion | None = Field(
        default=None,
        title="Version",
        description='A number such as "3"; the version that this run has tested, if left out.',
    )
    launchConfig: DeploymentLaunchConfig


class Deployment(Spec):
    """Rolls an application out to a fleet; takes a CreateDeploymentJob request as it stands.

    Attributes:
        fleet: Name or ARN of a fleet, or one on this machine for a demonstration.
        deploymentConfig: How many robots at once, and what stops it.
        rollOut: Canaries, and when the failure threshold begins to count.
        deploymentApplicationConfigs: The application, exactly one.
        untestedBuilds: By architecture, each build that ships although no episode drives it, and which stands for it.
        untestedVariables: By name, each variable that robots get otherwise than every episode, and why.
        tags: At most 50 keys and values; robots see them as variables.
        clientRequestToken: Makes the request only once, however often it is sent; left out, the run has its own.
    """

    fleet: Annotated[
        Annotated[Reference, member("text")] | Annotated[LocalFleet, member("LocalFleet")],
        by_shape("a name, an ARN, or {name: ..., localAgents: ...}", text=str, LocalFleet=dict),
    ] = Field(title="Fleet")
    deploymentConfig: DeploymentConfig | None = Field(default=None, title="Roll-out")
    rollOut: RollOutRules = Field(default_factory=RollOutRules, title="Rules beyond RoboMaker's")
    deploymentApplicationConfigs: Annotated[
        tuple[PipelineDeployedApplication, ...], Field(min_length=1, max_length=1)
    ] = Field(title="Application")
    # None, not empty: documents without them keep the digest that they had before there were such fields.
    untestedBuilds: UntestedBuilds | None = Field(default=None, title="Builds that are not simulated")
    untestedVariables: UntestedVariables | None = Field(default=None, title="Variables that differ from the simulation")
    trust: Literal["signed", "unsigned"] = Field(
        default="signed",
        title="Trust",
        description="Signed with the keys in SIMYARD_KEYS; unsigned, robots that verify refuse it.",
    )
    tags: RobotTagMap | None = Field(default=None, title="Tags of the job")
    clientRequestToken: ClientRequestToken | None = Field(default=None, title="Token")
