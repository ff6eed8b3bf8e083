"""RoboMaker's answers about templates, worlds, generation jobs and export jobs, with ``world_description.json``."""

from typing import Annotated

from pydantic import Field, JsonValue

from specs.base import Spec
from specs.data.world import World
from specs.field_types import (
    AllArns,
    Arn,
    Arns,
    ClientRequestToken,
    CreatedAt,
    GenericString,
    IamRole,
    Integer,
    LastUpdatedAt,
    OutputLocation,
    PaginationToken,
    TagMap,
)
from specs.robomaker.failure_codes import WorldExportJobErrorCode, WorldGenerationJobErrorCode
from specs.robomaker.world_jobs import Json, TemplateName, WorldCount, WorldExportJobStatus, WorldGenerationJobStatus


class WorldFailure(Spec):
    """How many worlds failed for one reason, and that reason once."""

    failureCode: WorldGenerationJobErrorCode | None = None
    sampleFailureReason: GenericString | None = None
    failureCount: Integer | None = None


class FailureSummary(Spec):
    """The worlds that failed."""

    totalFailureCount: Integer | None = None
    failures: Annotated[tuple[WorldFailure, ...], Field(max_length=100)] | None = None


class FinishedWorldsSummary(Spec):
    """The worlds that are done, either way; an empty list of worlds is left out.

    See docs/reference/robomaker.md, section 1.
    """

    finishedCount: Integer | None = None
    succeededWorlds: AllArns | None = None
    failureSummary: FailureSummary | None = None


class DescribeWorldGenerationJobResponse(Spec):
    """A generation job."""

    arn: Arn | None = None
    status: WorldGenerationJobStatus | None = None
    createdAt: CreatedAt | None = None
    failureCode: WorldGenerationJobErrorCode | None = None
    failureReason: GenericString | None = None
    clientRequestToken: ClientRequestToken | None = None
    template: Arn | None = None
    worldCount: WorldCount | None = None
    finishedWorldsSummary: FinishedWorldsSummary | None = None
    tags: TagMap | None = None
    worldTags: TagMap | None = None


class DescribeWorldExportJobResponse(Spec):
    """An export job."""

    arn: Arn | None = None
    status: WorldExportJobStatus | None = None
    createdAt: CreatedAt | None = None
    failureCode: WorldExportJobErrorCode | None = None
    failureReason: GenericString | None = None
    clientRequestToken: ClientRequestToken | None = None
    worlds: Arns | None = None
    outputLocation: OutputLocation | None = None
    iamRole: IamRole | None = None
    tags: TagMap | None = None


class DescribeWorldResponse(Spec):
    """A world; the description body is empty for templates of version 1."""

    arn: Arn | None = None
    generationJob: Arn | None = None
    template: Arn | None = None
    createdAt: CreatedAt | None = None
    tags: TagMap | None = None
    worldDescriptionBody: Json | None = None


class DescribeWorldTemplateResponse(Spec):
    """A template, without its body."""

    arn: Arn | None = None
    clientRequestToken: ClientRequestToken | None = None
    name: TemplateName | None = None
    createdAt: CreatedAt | None = None
    lastUpdatedAt: LastUpdatedAt | None = None
    tags: TagMap | None = None
    version: GenericString | None = None


class TemplateSummary(Spec):
    """A template in a list."""

    arn: Arn | None = None
    createdAt: CreatedAt | None = None
    lastUpdatedAt: LastUpdatedAt | None = None
    name: TemplateName | None = None
    version: GenericString | None = None


class ListWorldTemplatesResponse(Spec):
    """A page of templates."""

    templateSummaries: tuple[TemplateSummary, ...] | None = None
    nextToken: PaginationToken | None = None


class WorldSummary(Spec):
    """A world in a list."""

    arn: Arn | None = None
    createdAt: CreatedAt | None = None
    generationJob: Arn | None = None
    template: Arn | None = None


class ListWorldsResponse(Spec):
    """A page of worlds."""

    worldSummaries: tuple[WorldSummary, ...] | None = None
    nextToken: PaginationToken | None = None


class WorldGenerationJobSummary(Spec):
    """A generation job in a list."""

    arn: Arn | None = None
    template: Arn | None = None
    createdAt: CreatedAt | None = None
    status: WorldGenerationJobStatus | None = None
    worldCount: WorldCount | None = None
    succeededWorldCount: Integer | None = None
    failedWorldCount: Integer | None = None


class ListWorldGenerationJobsResponse(Spec):
    """A page of generation jobs."""

    worldGenerationJobSummaries: Annotated[tuple[WorldGenerationJobSummary, ...], Field(max_length=100)]
    nextToken: PaginationToken | None = None


class WorldExportJobSummary(Spec):
    """An export job in a list."""

    arn: Arn | None = None
    status: WorldExportJobStatus | None = None
    createdAt: CreatedAt | None = None
    worlds: Arns | None = None
    outputLocation: OutputLocation | None = None


class ListWorldExportJobsResponse(Spec):
    """A page of export jobs."""

    worldExportJobSummaries: Annotated[tuple[WorldExportJobSummary, ...], Field(max_length=100)]
    nextToken: PaginationToken | None = None


def world_description(world: World) -> dict[str, JsonValue]:
    """Returns what RoboMaker's ``world_description.json`` is for: the doors, by the names that exports use.

    The guide says that doors are listed and prints no example, so the keys are Simyard's own.
    """
    doors: list[JsonValue] = []
    for door in world.doors:
        passage = world.passages[door.passage]
        doors.append(
            {
                "name": door.name,
                "rooms": list(passage.rooms),
                "opensInto": door.opens_into,
                "hinge": {"x": door.hinge_m[0], "y": door.hinge_m[1]},
                "width": passage.width_m,
                "closedYaw": door.closed_yaw_rad,
                "openYaw": door.open_yaw_rad,
                "openPercent": door.open_percent,
            }
        )
    return {"world": world.name, "doors": doors}
