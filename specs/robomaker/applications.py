"""Robot and simulation applications: RoboMaker's requests and answers."""

from typing import Annotated, Literal

from pydantic import Field

from specs.base import Spec
from specs.field_types import (
    Architecture,
    Arn,
    FilteredPage,
    LastUpdatedAt,
    Name,
    PaginationToken,
    S3Bucket,
    S3Etag,
    S3Key,
    TagMap,
    Version,
    text,
)

RobotSoftwareSuiteType = Literal["ROS", "ROS2", "General"]
# The last three are Simyard's own (docs/reference/deviations.md): RoboMaker ended before them.
RobotSoftwareSuiteVersionType = Literal["Kinetic", "Melodic", "Dashing", "Foxy", "Noetic", "Humble", "Jazzy"]
SimulationSoftwareSuiteType = Literal["Gazebo", "RosbagPlay", "SimulationRuntime"]
SimulationSoftwareSuiteVersionType = Annotated[
    str, text(0, 1024, "7|9|11|Kinetic|Melodic|Dashing|Foxy|Noetic|Humble|Jazzy")
]
RenderingEngineType = Literal["OGRE"]
RenderingEngineVersionType = Annotated[str, text(1, 4, "1.x")]
RepositoryUrl = Annotated[str, text(1, 1024, ".+")]
RevisionId = Annotated[str, text(1, 40, r"[a-zA-Z0-9_.\-]*")]
ImageDigest = Annotated[str, text(0, 72, "[Ss][Hh][Aa]256:[0-9a-fA-F]{64}")]
VersionQualifier = Annotated[str, text(1, 255, "ALL")]


class SourceConfig(Spec):
    """Where a bundle lies."""

    s3Bucket: S3Bucket | None = None
    s3Key: S3Key | None = None
    architecture: Architecture | None = None


class Source(SourceConfig):
    """Where a bundle lies, and which content was there."""

    etag: S3Etag | None = None


class RobotSoftwareSuite(Spec):
    """What a robot application is written for."""

    name: RobotSoftwareSuiteType | None = None
    version: RobotSoftwareSuiteVersionType | None = None


class SimulationSoftwareSuite(Spec):
    """What a simulation application is written for."""

    name: SimulationSoftwareSuiteType | None = None
    version: SimulationSoftwareSuiteVersionType | None = None


class RenderingEngine(Spec):
    """What draws the simulation."""

    name: RenderingEngineType | None = None
    version: RenderingEngineVersionType | None = None


class Environment(Spec):
    """A container image, where there is no bundle."""

    uri: RepositoryUrl | None = None


class ApplicationVersionAnswer(Spec):
    """What all answers about both kinds of application have in common."""

    arn: Arn | None = None
    name: Name | None = None
    version: Version | None = None
    sources: tuple[Source, ...] | None = None
    robotSoftwareSuite: RobotSoftwareSuite | None = None
    lastUpdatedAt: LastUpdatedAt | None = None
    revisionId: RevisionId | None = None
    environment: Environment | None = None


class ApplicationAnswer(ApplicationVersionAnswer):
    """The same, with the tags of the application."""

    tags: TagMap | None = None


class CreateApplicationVersionRequest(Spec):
    """Asks for a version of what an application's sources are now."""

    application: Arn
    currentRevisionId: RevisionId | None = None
    s3Etags: tuple[S3Etag, ...] | None = None
    imageDigest: ImageDigest | None = None


class DeleteApplicationRequest(Spec):
    """Asks for an application, or one of its versions, to be deleted."""

    application: Arn
    applicationVersion: Version | None = None


class CreateRobotApplicationRequest(Spec):
    """Asks for a robot application."""

    name: Name
    sources: tuple[SourceConfig, ...] | None = None
    robotSoftwareSuite: RobotSoftwareSuite
    tags: TagMap | None = None
    environment: Environment | None = None


class CreateRobotApplicationResponse(ApplicationAnswer):
    """The robot application that was made."""


class DescribeRobotApplicationRequest(Spec):
    """Asks about a version of a robot application."""

    application: Arn
    applicationVersion: Version | None = None


class DescribeRobotApplicationResponse(ApplicationAnswer):
    """A version of a robot application."""

    imageDigest: ImageDigest | None = None


class CreateSimulationApplicationRequest(Spec):
    """Asks for a simulation application."""

    name: Name
    sources: tuple[SourceConfig, ...] | None = None
    simulationSoftwareSuite: SimulationSoftwareSuite
    robotSoftwareSuite: RobotSoftwareSuite
    renderingEngine: RenderingEngine | None = None
    tags: TagMap | None = None
    environment: Environment | None = None


class CreateSimulationApplicationResponse(ApplicationAnswer):
    """The simulation application that was made."""

    simulationSoftwareSuite: SimulationSoftwareSuite | None = None
    renderingEngine: RenderingEngine | None = None


class DescribeSimulationApplicationRequest(Spec):
    """Asks about a version of a simulation application."""

    application: Arn
    applicationVersion: Version | None = None


class DescribeSimulationApplicationResponse(CreateSimulationApplicationResponse):
    """A version of a simulation application."""

    imageDigest: ImageDigest | None = None


class ApplicationsPage(FilteredPage):
    """Asks for applications; ``ALL`` for every version of each."""

    versionQualifier: VersionQualifier | None = None


class ListRobotApplicationsRequest(ApplicationsPage):
    """Asks for the robot applications."""


class RobotApplicationSummary(Spec):
    """A robot application in a list."""

    name: Name | None = None
    arn: Arn | None = None
    version: Version | None = None
    lastUpdatedAt: LastUpdatedAt | None = None
    robotSoftwareSuite: RobotSoftwareSuite | None = None


class ListRobotApplicationsResponse(Spec):
    """A page of robot applications."""

    robotApplicationSummaries: Annotated[tuple[RobotApplicationSummary, ...], Field(max_length=100)] | None = None
    nextToken: PaginationToken | None = None


class ListSimulationApplicationsRequest(ApplicationsPage):
    """Asks for the simulation applications."""


class SimulationApplicationSummary(RobotApplicationSummary):
    """A simulation application in a list."""

    simulationSoftwareSuite: SimulationSoftwareSuite | None = None


class ListSimulationApplicationsResponse(Spec):
    """A page of simulation applications."""

    simulationApplicationSummaries: (
        Annotated[tuple[SimulationApplicationSummary, ...], Field(max_length=100)] | None
    ) = None
    nextToken: PaginationToken | None = None


class CreateRobotApplicationVersionRequest(CreateApplicationVersionRequest):
    """Asks for a version of a robot application."""


class CreateRobotApplicationVersionResponse(ApplicationVersionAnswer):
    """The version that was made."""


class CreateSimulationApplicationVersionRequest(CreateApplicationVersionRequest):
    """Asks for a version of a simulation application."""


class CreateSimulationApplicationVersionResponse(ApplicationVersionAnswer):
    """The version that was made."""

    simulationSoftwareSuite: SimulationSoftwareSuite | None = None
    renderingEngine: RenderingEngine | None = None


class UpdateRobotApplicationRequest(Spec):
    """Asks for the next version of a robot application to be made from something else."""

    application: Arn
    sources: tuple[SourceConfig, ...] | None = None
    robotSoftwareSuite: RobotSoftwareSuite
    currentRevisionId: RevisionId | None = None
    environment: Environment | None = None


class UpdateRobotApplicationResponse(ApplicationVersionAnswer):
    """The robot application that was changed."""


class UpdateSimulationApplicationRequest(UpdateRobotApplicationRequest):
    """Asks for the next version of a simulation application to be made from something else."""

    simulationSoftwareSuite: SimulationSoftwareSuite
    renderingEngine: RenderingEngine | None = None


class UpdateSimulationApplicationResponse(CreateSimulationApplicationVersionResponse):
    """The simulation application that was changed."""


class DeleteRobotApplicationRequest(DeleteApplicationRequest):
    """Asks for a robot application, or one of its versions, to be deleted."""


class DeleteRobotApplicationResponse(Spec):
    """Says nothing."""


class DeleteSimulationApplicationRequest(DeleteApplicationRequest):
    """Asks for a simulation application, or one of its versions, to be deleted."""


class DeleteSimulationApplicationResponse(Spec):
    """Says nothing."""
