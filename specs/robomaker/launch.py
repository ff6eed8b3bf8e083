"""Applications as a simulation job uses them: what is launched, with which variables, tools and uploads."""

from typing import Annotated, Literal

from pydantic import Field, JsonValue

from specs.base import Spec
from specs.field_types import (
    GENERIC_PATTERN,
    Arn,
    Boolean,
    BoxedBoolean,
    Command,
    EnvironmentVariableMap,
    Integer,
    Name,
    NonEmptyString,
    Path,
    Version,
    text,
)

UploadBehavior = Literal["UPLOAD_ON_TERMINATE", "UPLOAD_ROLLING_AUTO_REMOVE"]
ExitBehavior = Literal["FAIL", "RESTART"]
UnrestrictedCommand = Annotated[str, text(1, 1024, GENERIC_PATTERN)]
Port = Annotated[Integer, Field(ge=1, le=65535)]
NonSystemPort = Annotated[Integer, Field(ge=1024, le=65535)]

DEPRECATED: dict[str, JsonValue] = {"deprecated": True}
"""Marks a field in the JSON schema; pydantic's own mark would warn whenever an old document is read."""


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
        command: What a container was started with. Kept; has no effect.
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
