"""Deployment jobs, fleets and robots: RoboMaker's requests and answers."""

from typing import Annotated, Literal

from pydantic import Field

from specs.base import Spec
from specs.field_types import (
    NUMBER_PATTERN,
    Architecture,
    Arn,
    ClientRequestToken,
    Command,
    CreatedAt,
    EnvironmentVariableMap,
    FilteredPage,
    GenericString,
    Id,
    Integer,
    Name,
    Number,
    PaginationToken,
    Path,
    RobotTagMap,
    S3Object,
    TagMap,
    text,
)
from specs.robomaker.failure_codes import DeploymentJobErrorCode
from specs.rules import Within

DeploymentStatus = Literal["Pending", "Preparing", "InProgress", "Failed", "Succeeded", "Canceled"]
RobotStatus = Literal["Available", "Registered", "PendingNewDeployment", "Deploying", "Failed", "InSync", "NoResponse"]
RobotDeploymentStep = Literal[
    "Validating",
    "DownloadingExtracting",
    "ExecutingDownloadCondition",
    "ExecutingPreLaunch",
    "Launching",
    "ExecutingPostLaunch",
    "Finished",
]
Percentage = Annotated[Integer, Field(ge=1, le=100)]
PercentDone = Annotated[Number, Field(ge=0, le=100)]
DeploymentVersion = Annotated[str, text(1, 255, NUMBER_PATTERN)]
DeploymentTimeout = Annotated[Integer, Within(60, 604_800, "seconds")]


class DeploymentConfig(Spec):
    """How a roll-out proceeds: share of the fleet at once, share of failures that stops it, patience with a robot.

    Attributes:
        robotDeploymentTimeoutInSeconds: A robot that has not finished after so long has failed; from 60 seconds to a
            week (604,800).
    """

    concurrentDeploymentPercentage: Percentage | None = Field(
        default=None, title="At once (%)", description="Share of the fleet that is deployed to at the same time."
    )
    failureThresholdPercentage: Percentage | None = Field(
        default=None,
        title="Failure threshold (%)",
        description="The roll-out stops when this share of the fleet has failed.",
    )
    robotDeploymentTimeoutInSeconds: DeploymentTimeout | None = Field(default=None, title="Timeout of a robot (s)")
    downloadConditionFile: S3Object | None = Field(
        default=None, title="Download condition", description="A script; a robot on which it fails does not download."
    )


class DeploymentLaunchConfig(Spec):
    """What is run on the robot: files of the bundle.

    Attributes:
        packageName: Folder in the application's bundle.
        preLaunchFile: Script in that folder that is run before the launch, and must succeed.
        launchFile: Program in that folder that then keeps running.
        postLaunchFile: Script in that folder that is run after the launch, and must succeed.
        environmentVariables: At most 20, capital names and texts; the programs are given them.
    """

    packageName: Command = Field(title="Package")
    preLaunchFile: Path | None = Field(default=None, title="Run before")
    launchFile: Command = Field(title="Launch file")
    postLaunchFile: Path | None = Field(default=None, title="Run after")
    environmentVariables: EnvironmentVariableMap | None = Field(default=None, title="Environment variables")


class DeploymentApplicationConfig(Spec):
    """Which version of which application is deployed."""

    application: Arn
    applicationVersion: DeploymentVersion
    launchConfig: DeploymentLaunchConfig


DeploymentApplicationConfigs = Annotated[tuple[DeploymentApplicationConfig, ...], Field(min_length=1, max_length=1)]


class CreateDeploymentJobRequest(Spec):
    """Asks for an application to be rolled out to a fleet."""

    deploymentConfig: DeploymentConfig | None = None
    clientRequestToken: ClientRequestToken
    fleet: Arn
    deploymentApplicationConfigs: DeploymentApplicationConfigs
    tags: RobotTagMap | None = None


class SyncDeploymentJobRequest(Spec):
    """Asks for a fleet to be brought to its latest deployment."""

    clientRequestToken: ClientRequestToken
    fleet: Arn


class DescribeDeploymentJobRequest(Spec):
    """Asks about a deployment job."""

    job: Arn


class CancelDeploymentJobRequest(Spec):
    """Asks that a deployment be stopped."""

    job: Arn


class CancelDeploymentJobResponse(Spec):
    """Says nothing."""


class ListDeploymentJobsRequest(FilteredPage):
    """Asks for the deployment jobs."""


class DeploymentJob(Spec):
    """A deployment job."""

    arn: Arn | None = None
    fleet: Arn | None = None
    status: DeploymentStatus | None = None
    deploymentApplicationConfigs: DeploymentApplicationConfigs | None = None
    deploymentConfig: DeploymentConfig | None = None
    failureReason: GenericString | None = None
    failureCode: DeploymentJobErrorCode | None = None
    createdAt: CreatedAt | None = None


class ProgressDetail(Spec):
    """How far a robot has come."""

    currentProgress: RobotDeploymentStep | None = None
    percentDone: PercentDone | None = None
    estimatedTimeRemainingSeconds: Integer | None = None
    targetResource: GenericString | None = None


class RobotDeployment(Spec):
    """A deployment job as one robot has it."""

    arn: Arn | None = None
    deploymentStartTime: CreatedAt | None = None
    deploymentFinishTime: CreatedAt | None = None
    status: RobotStatus | None = None
    progressDetail: ProgressDetail | None = None
    failureReason: GenericString | None = None
    failureCode: DeploymentJobErrorCode | None = None


class CreateDeploymentJobResponse(DeploymentJob):
    """The deployment job that was made."""

    tags: TagMap | None = None


class SyncDeploymentJobResponse(DeploymentJob):
    """The deployment job that a fleet is brought up to date with."""


class DescribeDeploymentJobResponse(DeploymentJob):
    """A deployment job and how far each robot has come."""

    robotDeploymentSummary: tuple[RobotDeployment, ...] | None = None
    tags: TagMap | None = None


class ListDeploymentJobsResponse(Spec):
    """A page of deployment jobs."""

    deploymentJobs: Annotated[tuple[DeploymentJob, ...], Field(max_length=200)] | None = None
    nextToken: PaginationToken | None = None


class CreateFleetRequest(Spec):
    """Asks for a fleet."""

    name: Name
    tags: TagMap | None = None


class CreateFleetResponse(Spec):
    """The fleet that was made."""

    arn: Arn | None = None
    name: Name | None = None
    createdAt: CreatedAt | None = None
    tags: TagMap | None = None


class CreateRobotRequest(Spec):
    """Asks for a robot."""

    name: Name
    architecture: Architecture
    greengrassGroupId: Id
    tags: RobotTagMap | None = None


class CreateRobotResponse(Spec):
    """The robot that was made."""

    arn: Arn | None = None
    name: Name | None = None
    createdAt: CreatedAt | None = None
    greengrassGroupId: Id | None = None
    architecture: Architecture | None = None
    tags: TagMap | None = None


class RegisterRobotRequest(Spec):
    """Asks for a robot to join a fleet."""

    fleet: Arn
    robot: Arn


class RegisterRobotResponse(Spec):
    """The fleet and the robot that joined it."""

    fleet: Arn | None = None
    robot: Arn | None = None


class DeregisterRobotRequest(Spec):
    """Asks for a robot to leave a fleet."""

    fleet: Arn
    robot: Arn


class DeregisterRobotResponse(Spec):
    """The fleet and the robot that left it."""

    fleet: Arn | None = None
    robot: Arn | None = None


class DeleteFleetRequest(Spec):
    """Asks for a fleet to be deleted."""

    fleet: Arn


class DeleteFleetResponse(Spec):
    """Says nothing."""


class DeleteRobotRequest(Spec):
    """Asks for a robot to be deleted."""

    robot: Arn


class DeleteRobotResponse(Spec):
    """Says nothing."""


class DescribeFleetRequest(Spec):
    """Asks about a fleet."""

    fleet: Arn


class Robot(Spec):
    """A robot of a fleet; RoboMaker spelt the Greengrass group differently here."""

    arn: Arn | None = None
    name: Name | None = None
    fleetArn: Arn | None = None
    status: RobotStatus | None = None
    greenGrassGroupId: Id | None = None
    createdAt: CreatedAt | None = None
    architecture: Architecture | None = None
    lastDeploymentJob: Arn | None = None
    lastDeploymentTime: CreatedAt | None = None


Robots = tuple[Robot, ...]
"""The interface says at most 1000: a fleet that has more is not cut off."""


class Fleet(Spec):
    """A fleet in a list."""

    name: Name | None = None
    arn: Arn | None = None
    createdAt: CreatedAt | None = None
    lastDeploymentStatus: DeploymentStatus | None = None
    lastDeploymentJob: Arn | None = None
    lastDeploymentTime: CreatedAt | None = None


class DescribeFleetResponse(Fleet):
    """A fleet and its robots."""

    robots: Robots | None = None
    tags: TagMap | None = None


class DescribeRobotRequest(Spec):
    """Asks about a robot."""

    robot: Arn


class DescribeRobotResponse(Spec):
    """A robot."""

    arn: Arn | None = None
    name: Name | None = None
    fleetArn: Arn | None = None
    status: RobotStatus | None = None
    greengrassGroupId: Id | None = None
    createdAt: CreatedAt | None = None
    architecture: Architecture | None = None
    lastDeploymentJob: Arn | None = None
    lastDeploymentTime: CreatedAt | None = None
    tags: TagMap | None = None


class ListFleetsRequest(FilteredPage):
    """Asks for the fleets."""


class ListFleetsResponse(Spec):
    """A page of fleets."""

    fleetDetails: Annotated[tuple[Fleet, ...], Field(max_length=200)] | None = None
    nextToken: PaginationToken | None = None


class ListRobotsRequest(FilteredPage):
    """Asks for the robots."""


class ListRobotsResponse(Spec):
    """A page of robots."""

    robots: Robots | None = None
    nextToken: PaginationToken | None = None
