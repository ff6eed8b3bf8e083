"""Simulation jobs and batches: RoboMaker's requests and answers, and the applications that a job launches."""

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, JsonValue

from specs.base import Spec
from specs.field_types import (
    GENERIC_PATTERN,
    Arn,
    Arns,
    Boolean,
    BoxedBoolean,
    ClientRequestToken,
    Command,
    EnvironmentVariableMap,
    FilteredPage,
    IamRole,
    Integer,
    Name,
    NonEmptyString,
    OutputLocation,
    Path,
    S3Bucket,
    S3KeyOrPrefix,
    TagMap,
    Version,
    text,
)
from specs.rules import Within, broken
from specs.settings import MIN_JOB_DURATION

UploadBehavior = Literal["UPLOAD_ON_TERMINATE", "UPLOAD_ROLLING_AUTO_REMOVE"]
ExitBehavior = Literal["FAIL", "RESTART"]
UnrestrictedCommand = Annotated[str, text(1, 1024, GENERIC_PATTERN)]
Port = Annotated[Integer, Field(ge=1, le=65535)]
NonSystemPort = Annotated[Integer, Field(ge=1024, le=65535)]

DEPRECATED: dict[str, JsonValue] = {"deprecated": True}
"""Marks a field in the JSON schema; pydantic's own mark would warn whenever an old document is read."""
MAX_JOB_DURATION_S = 1_209_600
MAX_BATCHED_JOB_DURATION_S = 691_200
MAX_BATCH_TIMEOUT_S = 1_209_600
MAX_REQUESTS = 1000


class PortMapping(Spec):
    """A port of the job and the application's port behind it.

    Attributes:
        jobPort: Port of the job that was forwarded. Kept; has no effect.
        applicationPort: Port that the application listened on. Kept; has no effect.
        enableOnPublicIp: Whether it was open on the job's public address. Kept; has no effect.
    """

    jobPort: Port
    applicationPort: NonSystemPort
    enableOnPublicIp: Boolean | None = None


class PortForwardingConfig(Spec):
    """Ports that RoboMaker forwarded.

    Attributes:
        portMappings: At most 10 of them.
    """

    portMappings: Annotated[tuple[PortMapping, ...], Field(max_length=10)] | None = None


class LaunchConfig(Spec):
    """What is launched in a simulation job.

    Attributes:
        environmentVariables: At most 20, capital names and texts; the application is given them.
        portForwardingConfig: Kept; has no effect.
        streamUI: Whether RoboMaker streamed a desktop. Kept; has no effect.
        command: What is run in a container image, if there is no launchFile; else without effect.
    """

    packageName: Command | None = Field(
        default=None, title="Package", description="Folder in the application's bundle."
    )
    launchFile: Command | None = Field(
        default=None, title="Launch file", description="ROS launch file of that package, or module, without .py."
    )
    environmentVariables: EnvironmentVariableMap | None = Field(default=None, title="Environment variables")
    portForwardingConfig: PortForwardingConfig | None = None
    streamUI: Boolean | None = None
    command: tuple[NonEmptyString, ...] | None = None


class UploadConfiguration(Spec):
    """Files that RoboMaker uploaded to the output location.

    Attributes:
        name: What the upload is called.
        path: Files that were uploaded.
        uploadBehavior: At the job's end, or again and again. Kept; has no effect.
    """

    name: Name
    path: Path
    uploadBehavior: UploadBehavior


UploadConfigurations = Annotated[tuple[UploadConfiguration, ...], Field(max_length=10)]


class Tool(Spec):
    """A program that RoboMaker ran beside the applications.

    Attributes:
        streamUI: Whether its window was streamed.
        name: What the tool is called.
        command: What was run.
        streamOutputToCloudWatch: Whether what it printed was kept.
        exitBehavior: Whether its end was the job's, or it was started again.
    """

    streamUI: BoxedBoolean | None = None
    name: Name
    command: UnrestrictedCommand
    streamOutputToCloudWatch: BoxedBoolean | None = None
    exitBehavior: ExitBehavior | None = None


Tools = Annotated[tuple[Tool, ...], Field(max_length=10)]


class WorldConfig(Spec):
    """A world that a simulation application is given."""

    world: Arn | None = None


class ApplicationUse(Spec):
    """What the configurations of robot and simulation applications have in common.

    Attributes:
        launchConfig: Which file of the bundle is run, and with which variables.
        uploadConfigurations: At most 10. Kept; has no effect.
        useDefaultUploadConfigurations: Kept; has no effect.
        tools: At most 10. Kept; has no effect.
        useDefaultTools: Kept; has no effect.
    """

    applicationVersion: Version | None = Field(
        default=None, title="Version", description='A number such as "3", or $LATEST, which is also the default.'
    )
    launchConfig: LaunchConfig
    uploadConfigurations: UploadConfigurations | None = None
    useDefaultUploadConfigurations: BoxedBoolean | None = Field(default=None, json_schema_extra=DEPRECATED)
    tools: Tools | None = None
    useDefaultTools: BoxedBoolean | None = Field(default=None, json_schema_extra=DEPRECATED)


class RobotApplicationConfig(ApplicationUse):
    """The robot application of a simulation job."""

    application: Arn


class SimulationApplicationConfig(ApplicationUse):
    """The simulation application of a simulation job."""

    application: Arn
    worldConfigs: Annotated[tuple[WorldConfig, ...], Field(max_length=1)] | None = None


RobotApplicationConfigs = Annotated[tuple[RobotApplicationConfig, ...], Field(min_length=1, max_length=1)]
SimulationApplicationConfigs = Annotated[tuple[SimulationApplicationConfig, ...], Field(min_length=1, max_length=1)]


def duration_rule(most_s: int, where: str = "") -> str:
    """Returns which durations a job may have, in plain words."""
    return f"from {MIN_JOB_DURATION.value():,} to {most_s:,} seconds{where}"


def _lasting(most_s: int, where: str = "") -> AfterValidator:
    def check(seconds: int) -> int:
        if MIN_JOB_DURATION.value() <= seconds <= most_s:
            return seconds
        raise broken(duration_rule(most_s, where))

    return AfterValidator(check)


FailureBehavior = Literal["Fail", "Continue"]
DataSourceType = Literal["Prefix", "Archive", "File"]
ComputeType = Literal["CPU", "GPU_AND_CPU"]
# Why a simulation job failed or was stopped, as RoboMaker names it; rows, records and answers carry it.
SimulationJobErrorCode = Literal[
    "InternalServiceError",
    "RobotApplicationCrash",
    "SimulationApplicationCrash",
    "RobotApplicationHealthCheckFailure",
    "SimulationApplicationHealthCheckFailure",
    "BadPermissionsRobotApplication",
    "BadPermissionsSimulationApplication",
    "BadPermissionsS3Object",
    "BadPermissionsS3Output",
    "BadPermissionsCloudwatchLogs",
    "SubnetIpLimitExceeded",
    "ENILimitExceeded",
    "BadPermissionsUserCredentials",
    "InvalidBundleRobotApplication",
    "InvalidBundleSimulationApplication",
    "InvalidS3Resource",
    "ThrottlingError",
    "LimitExceeded",
    "MismatchedEtag",
    "RobotApplicationVersionMismatchedEtag",
    "SimulationApplicationVersionMismatchedEtag",
    "ResourceNotFound",
    "RequestThrottled",
    "BatchTimedOut",
    "BatchCanceled",
    "InvalidInput",
    "WrongRegionS3Bucket",
    "WrongRegionS3Output",
    "WrongRegionRobotApplication",
    "WrongRegionSimulationApplication",
    "UploadContentMismatchError",
]
SimulationUnit = Annotated[Integer, Field(ge=1, le=15)]
GPUUnit = Annotated[Integer, Field(ge=0, le=1)]
JobDuration = Annotated[Integer, _lasting(MAX_JOB_DURATION_S)]
BatchedJobDuration = Annotated[Integer, _lasting(MAX_BATCHED_JOB_DURATION_S, " in a batch")]
Subnets = Annotated[tuple[NonEmptyString, ...], Field(min_length=1, max_length=16)]
SecurityGroups = Annotated[tuple[NonEmptyString, ...], Field(min_length=1, max_length=5)]


class LoggingConfig(Spec):
    """What is recorded of a job: everything, whatever comes of it, if RoboMaker was to record all topics.

    Attributes:
        recordAllRosTopics: Records this request's episodes, whatever the batch's recordings say.
    """

    recordAllRosTopics: BoxedBoolean | None = Field(default=None, json_schema_extra=DEPRECATED)


class DataSourceConfig(Spec):
    """Files from a bucket that a job reads.

    Attributes:
        name: What the application knows the files by.
        s3Bucket: Bucket that they are in.
        s3Keys: Keys of the files, from 1 to 100; of type Prefix, what the keys begin with.
        type: Prefix (all keys that begin so), Archive (unpacked), or File.
        destination: Where the application finds them.
    """

    name: Name
    s3Bucket: S3Bucket
    s3Keys: Annotated[tuple[S3KeyOrPrefix, ...], Field(min_length=1, max_length=100)]
    type: DataSourceType | None = None
    destination: Path | None = None


class VPCConfig(Spec):
    """The network that RoboMaker put a job in.

    Attributes:
        subnets: From 1 to 16.
        securityGroups: From 1 to 5.
        assignPublicIp: Whether the job had a public address.
    """

    subnets: Subnets
    securityGroups: SecurityGroups | None = None
    assignPublicIp: Boolean | None = None


class Compute(Spec):
    """The machine that RoboMaker gave a job.

    Attributes:
        simulationUnitLimit: Kept; has no effect.
        computeType: CPU, or both.
        gpuUnitLimit: Kept; has no effect.
    """

    simulationUnitLimit: SimulationUnit | None = None
    computeType: ComputeType | None = None
    gpuUnitLimit: GPUUnit | None = None


class JobSettings(Spec):
    """What a single job and an entry of a batch have in common, besides the applications.

    Attributes:
        outputLocation: Bucket and folder of this job's results; the batch's own, if left out.
        loggingConfig: Whether everything is recorded.
        failureBehavior: Fail ends the job when it fails; Continue leaves it RunningFailed until its batch has ended.
        dataSources: Files from buckets that the application reads, from 1 to 6 of them.
        vpcConfig: Kept; has no effect.
        compute: Kept; has no effect.
        tags: At most 50 keys and values, to find the jobs by.
    """

    outputLocation: OutputLocation | None = Field(default=None, title="Output location")
    loggingConfig: LoggingConfig | None = None
    failureBehavior: FailureBehavior | None = Field(default=None, title="Failure behaviour")
    dataSources: Annotated[tuple[DataSourceConfig, ...], Field(min_length=1, max_length=6)] | None = None
    vpcConfig: VPCConfig | None = None
    compute: Compute | None = None
    tags: TagMap | None = None


class CreateSimulationJobRequest(JobSettings):
    """Asks for one simulation job."""

    clientRequestToken: ClientRequestToken | None = None
    maxJobDurationInSeconds: JobDuration
    iamRole: IamRole
    robotApplications: RobotApplicationConfigs | None = None
    simulationApplications: SimulationApplicationConfigs | None = None


class BatchedJobSettings(JobSettings):
    """What an entry of a batch has besides the applications and its duration, in a request as in a pipeline.

    Attributes:
        iamRole: Kept; has no effect.
        useDefaultApplications: Kept; has no effect.
    """

    iamRole: IamRole | None = None
    useDefaultApplications: BoxedBoolean | None = None


class SimulationJobRequest(BatchedJobSettings):
    """One job of a batch."""

    maxJobDurationInSeconds: BatchedJobDuration
    robotApplications: RobotApplicationConfigs | None = None
    simulationApplications: SimulationApplicationConfigs | None = None


class DescribeSimulationJobRequest(Spec):
    """Asks about a simulation job."""

    job: Arn


class BatchDescribeSimulationJobRequest(Spec):
    """Asks about several simulation jobs."""

    jobs: Arns


class CancelSimulationJobRequest(Spec):
    """Asks that a simulation job be stopped."""

    job: Arn


class CancelSimulationJobResponse(Spec):
    """Says nothing."""


class RestartSimulationJobRequest(Spec):
    """Asks that a simulation job begin anew."""

    job: Arn


class RestartSimulationJobResponse(Spec):
    """Says nothing."""


class ListSimulationJobsRequest(FilteredPage):
    """Asks for the simulation jobs."""


SimulationJobBatchStatus = Literal[
    "Pending", "InProgress", "Failed", "Completed", "Canceled", "Canceling", "Completing", "TimingOut", "TimedOut"
]
SimulationJobBatchErrorCode = Literal["InternalServiceError"]
CreateSimulationJobRequests = Annotated[tuple[SimulationJobRequest, ...], Field(min_length=1, max_length=MAX_REQUESTS)]


class BatchPolicy(Spec):
    """How long a batch may take and how many of its jobs may be active at once."""

    timeoutInSeconds: Annotated[Integer, Within(1, MAX_BATCH_TIMEOUT_S, "seconds")] | None = Field(
        default=None, title="Timeout (s)", description="Wall-clock seconds for the whole batch."
    )
    maxConcurrency: Annotated[Integer, Within(1, 1_000_000, "jobs")] | None = Field(
        default=None, title="Concurrency", description="Jobs that are simulated side by side."
    )


class StartSimulationJobBatchRequest(Spec):
    """Asks for many simulation jobs."""

    clientRequestToken: ClientRequestToken | None = None
    batchPolicy: BatchPolicy | None = None
    createSimulationJobRequests: CreateSimulationJobRequests
    tags: TagMap | None = None


class DescribeSimulationJobBatchRequest(Spec):
    """Asks about a batch."""

    batch: Arn


class CancelSimulationJobBatchRequest(Spec):
    """Asks that a batch be stopped."""

    batch: Arn


class CancelSimulationJobBatchResponse(Spec):
    """Says nothing."""


class ListSimulationJobBatchesRequest(FilteredPage):
    """Asks for the batches."""
