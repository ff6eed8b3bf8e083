"""What RoboMaker answers about simulation jobs and batches."""

from typing import Annotated, Literal

from pydantic import Field

from specs.base import Spec
from specs.field_types import (
    Arn,
    Arns,
    Boolean,
    ClientRequestToken,
    CreatedAt,
    FailedAt,
    GenericString,
    IamRole,
    Integer,
    LastStartedAt,
    LastUpdatedAt,
    Name,
    OutputLocation,
    PaginationToken,
    Path,
    S3Bucket,
    S3Etag,
    S3KeyOrPrefix,
    TagMap,
)
from specs.robomaker.simulation import (
    BatchPolicy,
    ComputeType,
    DataSourceType,
    FailureBehavior,
    GPUUnit,
    JobDuration,
    LoggingConfig,
    RobotApplicationConfigs,
    SecurityGroups,
    SimulationApplicationConfigs,
    SimulationJobBatchErrorCode,
    SimulationJobBatchStatus,
    SimulationJobErrorCode,
    SimulationJobRequest,
    SimulationUnit,
    Subnets,
)

SimulationJobStatus = Literal[
    "Pending",
    "Preparing",
    "Running",
    "Restarting",
    "Completed",
    "Failed",
    "RunningFailed",
    "Terminating",
    "Terminated",
    "Canceled",
]


class S3KeyOutput(Spec):
    """A file that a job read."""

    s3Key: S3KeyOrPrefix | None = None
    etag: S3Etag | None = None


class DataSource(Spec):
    """Files from a bucket that a job read."""

    name: Name | None = None
    s3Bucket: S3Bucket | None = None
    s3Keys: tuple[S3KeyOutput, ...] | None = None
    type: DataSourceType | None = None
    destination: Path | None = None


class VPCConfigResponse(Spec):
    """The network that a job was in."""

    subnets: Subnets | None = None
    securityGroups: SecurityGroups | None = None
    vpcId: GenericString | None = None
    assignPublicIp: Boolean | None = None


class NetworkInterface(Spec):
    """The addresses that a job had."""

    networkInterfaceId: GenericString | None = None
    privateIpAddress: GenericString | None = None
    publicIpAddress: GenericString | None = None


class ComputeResponse(Spec):
    """The machine that a job had."""

    simulationUnitLimit: SimulationUnit | None = None
    computeType: ComputeType | None = None
    gpuUnitLimit: GPUUnit | None = None


class CreateSimulationJobResponse(Spec):
    """The simulation job that was made."""

    arn: Arn | None = None
    status: SimulationJobStatus | None = None
    lastStartedAt: LastStartedAt | None = None
    lastUpdatedAt: LastUpdatedAt | None = None
    failureBehavior: FailureBehavior | None = None
    failureCode: SimulationJobErrorCode | None = None
    clientRequestToken: ClientRequestToken | None = None
    outputLocation: OutputLocation | None = None
    loggingConfig: LoggingConfig | None = None
    maxJobDurationInSeconds: JobDuration | None = None
    simulationTimeMillis: Integer | None = None
    iamRole: IamRole | None = None
    robotApplications: RobotApplicationConfigs | None = None
    simulationApplications: SimulationApplicationConfigs | None = None
    dataSources: tuple[DataSource, ...] | None = None
    tags: TagMap | None = None
    vpcConfig: VPCConfigResponse | None = None
    compute: ComputeResponse | None = None


class SimulationJob(CreateSimulationJobResponse):
    """A simulation job."""

    name: Name | None = None
    failureReason: GenericString | None = None
    networkInterface: NetworkInterface | None = None


class DescribeSimulationJobResponse(SimulationJob):
    """A simulation job, asked for alone."""


class BatchDescribeSimulationJobResponse(Spec):
    """Several simulation jobs, and those that could not be described."""

    jobs: tuple[SimulationJob, ...] | None = None
    unprocessedJobs: Arns | None = None


class SimulationJobSummary(Spec):
    """A simulation job in a list."""

    arn: Arn | None = None
    lastUpdatedAt: LastUpdatedAt | None = None
    name: Name | None = None
    status: SimulationJobStatus | None = None
    simulationApplicationNames: tuple[Name, ...] | None = None
    robotApplicationNames: tuple[Name, ...] | None = None
    dataSourceNames: tuple[Name, ...] | None = None
    computeType: ComputeType | None = None


SimulationJobSummaries = tuple[SimulationJobSummary, ...]
"""The interface says at most 100, and batches have 1000 jobs: lists are not cut off.

See docs/reference/robomaker.md, section 4.
"""


class ListSimulationJobsResponse(Spec):
    """A page of simulation jobs."""

    simulationJobSummaries: SimulationJobSummaries
    nextToken: PaginationToken | None = None


class FailedCreateSimulationJobRequest(Spec):
    """An entry of a batch that never became a job."""

    request: SimulationJobRequest | None = None
    failureReason: GenericString | None = None
    failureCode: SimulationJobErrorCode | None = None
    failedAt: FailedAt | None = None


class StartSimulationJobBatchResponse(Spec):
    """The batch that was started."""

    arn: Arn | None = None
    status: SimulationJobBatchStatus | None = None
    createdAt: CreatedAt | None = None
    clientRequestToken: ClientRequestToken | None = None
    batchPolicy: BatchPolicy | None = None
    failureCode: SimulationJobBatchErrorCode | None = None
    failureReason: GenericString | None = None
    failedRequests: tuple[FailedCreateSimulationJobRequest, ...] | None = None
    pendingRequests: Annotated[tuple[SimulationJobRequest, ...], Field(min_length=1)] | None = None
    createdRequests: SimulationJobSummaries | None = None
    tags: TagMap | None = None


class DescribeSimulationJobBatchResponse(StartSimulationJobBatchResponse):
    """A batch; an empty list of pending requests is left out (docs/reference/robomaker.md, section 1)."""

    lastUpdatedAt: LastUpdatedAt | None = None


class SimulationJobBatchSummary(Spec):
    """A batch in a list."""

    arn: Arn | None = None
    lastUpdatedAt: LastUpdatedAt | None = None
    createdAt: CreatedAt | None = None
    status: SimulationJobBatchStatus | None = None
    failedRequestCount: Integer | None = None
    pendingRequestCount: Integer | None = None
    createdRequestCount: Integer | None = None


class ListSimulationJobBatchesResponse(Spec):
    """A page of batches."""

    simulationJobBatchSummaries: tuple[SimulationJobBatchSummary, ...] | None = None
    nextToken: PaginationToken | None = None
