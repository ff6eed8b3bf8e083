"""World templates, generation and export jobs, worlds: RoboMaker's requests and answers."""

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, JsonValue

from specs.base import Spec, canonical_json
from specs.data.world import World
from specs.field_types import (
    GENERIC_PATTERN,
    AllArns,
    Arn,
    Arns,
    ClientRequestToken,
    CreatedAt,
    FilteredPage,
    GenericString,
    IamRole,
    Integer,
    LastUpdatedAt,
    OutputLocation,
    Page,
    PaginationToken,
    S3Bucket,
    S3Key,
    TagMap,
    text,
)
from specs.robomaker.failure_codes import WorldExportJobErrorCode, WorldGenerationJobErrorCode
from specs.rules import JsonOf
from specs.template.body import TemplateBody

WorldGenerationJobStatus = Literal[
    "Pending", "Running", "Completed", "Failed", "PartialFailed", "Canceling", "Canceled"
]
WorldExportJobStatus = Literal["Pending", "Running", "Completed", "Failed", "Canceling", "Canceled"]


def _as_json_text(body: object) -> object:
    # RoboMaker's samples print the body as an object where the interface has text.
    return canonical_json(body).decode() if isinstance(body, dict) else body  # pyright: ignore[reportUnknownArgumentType]


TemplateName = Annotated[str, text(0, 255, GENERIC_PATTERN)]
Json = Annotated[str, text(1, 262_144, r"[\S\s]+")]
TemplateJson = Annotated[Json, BeforeValidator(_as_json_text), JsonOf(TemplateBody)]


class WorldCount(Spec):
    """How many worlds: floor plans, times interiors of each."""

    floorplanCount: Integer | None = Field(default=None, title="Floor plans")
    interiorCountPerFloorplan: Integer | None = Field(default=None, title="Interiors of each floor plan")


class TemplateLocation(Spec):
    """A template body in a bucket."""

    s3Bucket: S3Bucket
    s3Key: S3Key


class CreateWorldTemplateRequest(Spec):
    """Asks for a template to be kept."""

    clientRequestToken: ClientRequestToken | None = None
    name: TemplateName | None = None
    templateBody: TemplateJson | None = None
    templateLocation: TemplateLocation | None = None
    tags: TagMap | None = None


class CreateWorldTemplateResponse(Spec):
    """The template that was made."""

    arn: Arn | None = None
    clientRequestToken: ClientRequestToken | None = None
    createdAt: CreatedAt | None = None
    name: TemplateName | None = None
    tags: TagMap | None = None


class UpdateWorldTemplateRequest(Spec):
    """Asks for a template to have another name or body from now on."""

    template: Arn
    name: TemplateName | None = None
    templateBody: TemplateJson | None = None
    templateLocation: TemplateLocation | None = None


class UpdateWorldTemplateResponse(Spec):
    """The template that was changed."""

    arn: Arn | None = None
    name: TemplateName | None = None
    createdAt: CreatedAt | None = None
    lastUpdatedAt: LastUpdatedAt | None = None


class DeleteWorldTemplateRequest(Spec):
    """Asks for a template to be deleted."""

    template: Arn


class DeleteWorldTemplateResponse(Spec):
    """Says nothing."""


class GetWorldTemplateBodyRequest(Spec):
    """Asks for the body of a template, or for the one that a generation job used."""

    template: Arn | None = None
    generationJob: Arn | None = None


class GetWorldTemplateBodyResponse(Spec):
    """A template body as JSON text."""

    templateBody: Json | None = None


class CreateWorldGenerationJobRequest(Spec):
    """Asks for worlds from a template."""

    clientRequestToken: ClientRequestToken | None = None
    template: Arn
    worldCount: WorldCount
    tags: TagMap | None = None
    worldTags: TagMap | None = None


class CreateWorldGenerationJobResponse(Spec):
    """The generation job that was made."""

    arn: Arn | None = None
    status: WorldGenerationJobStatus | None = None
    createdAt: CreatedAt | None = None
    failureCode: WorldGenerationJobErrorCode | None = None
    clientRequestToken: ClientRequestToken | None = None
    template: Arn | None = None
    worldCount: WorldCount | None = None
    tags: TagMap | None = None
    worldTags: TagMap | None = None


class CreateWorldExportJobRequest(Spec):
    """Asks for worlds to be written to a bucket."""

    clientRequestToken: ClientRequestToken | None = None
    worlds: Arns
    outputLocation: OutputLocation
    iamRole: IamRole
    tags: TagMap | None = None


class CreateWorldExportJobResponse(Spec):
    """The export job that was made."""

    arn: Arn | None = None
    status: WorldExportJobStatus | None = None
    createdAt: CreatedAt | None = None
    failureCode: WorldExportJobErrorCode | None = None
    clientRequestToken: ClientRequestToken | None = None
    outputLocation: OutputLocation | None = None
    iamRole: IamRole | None = None
    tags: TagMap | None = None


class BatchDeleteWorldsRequest(Spec):
    """Asks for worlds to be deleted."""

    worlds: Arns


class BatchDeleteWorldsResponse(Spec):
    """Which worlds could not be deleted."""

    unprocessedWorlds: Arns | None = None


class CancelWorldGenerationJobRequest(Spec):
    """Asks that a generation job be stopped."""

    job: Arn


class CancelWorldGenerationJobResponse(Spec):
    """Says nothing."""


class CancelWorldExportJobRequest(Spec):
    """Asks that an export job be stopped."""

    job: Arn


class CancelWorldExportJobResponse(Spec):
    """Says nothing."""


class DescribeWorldRequest(Spec):
    """Asks about a world."""

    world: Arn


class DescribeWorldTemplateRequest(Spec):
    """Asks about a template."""

    template: Arn


class DescribeWorldGenerationJobRequest(Spec):
    """Asks about a generation job."""

    job: Arn


class DescribeWorldExportJobRequest(Spec):
    """Asks about an export job."""

    job: Arn


class ListWorldTemplatesRequest(Page):
    """Asks for the templates."""


class ListWorldsRequest(FilteredPage):
    """Asks for the worlds."""


class ListWorldGenerationJobsRequest(FilteredPage):
    """Asks for the generation jobs."""


class ListWorldExportJobsRequest(FilteredPage):
    """Asks for the export jobs."""


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
