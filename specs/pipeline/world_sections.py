"""The sections of a pipeline that make worlds: import, generation and export."""

import json
from collections.abc import Iterator, Mapping
from pathlib import PurePosixPath
from typing import Annotated, Literal, get_args

from pydantic import AfterValidator, BeforeValidator, Field

from specs.base import Spec
from specs.data.world import ROBOT_RADIUS_M
from specs.field_types import (
    GENERIC_PATTERN,
    ClientRequestToken,
    IamRole,
    Integer,
    Number,
    OutputLocation,
    PlainName,
    TagMap,
    WorldReference,
    text,
)
from specs.field_types import Path as SourcePath
from specs.pipeline.generation_parts import MAX_WORLDS_OF_DOCUMENT
from specs.rules import Finding, Ruled, broken, by_shape, distinct, member, part
from specs.template.body import TemplateBody

MAX_SEED = 2**32 - 1
MAX_WORLDS_OF_EXPORT = 100
WorldFormat = Literal["world", "sdf", "mjcf", "map", "svg", "glb", "usd"]
FORMATS: tuple[WorldFormat, ...] = get_args(WorldFormat)
"""In the order in which they stand in a zip."""
Seed = Annotated[Integer, Field(ge=0, le=MAX_SEED)]


def _with_bucket(location: OutputLocation) -> OutputLocation:
    if location.s3Bucket is None:
        raise broken("a place with s3Bucket")
    return location


def _json_text_as_object(template: object) -> object:
    if not (isinstance(template, str) and template.lstrip().startswith("{")):
        return template
    try:
        return json.loads(template)
    except (json.JSONDecodeError, RecursionError) as exc:
        raise broken("a path, a URL, a name, an ARN, or a template body as an object or JSON text") from exc


Destination = Annotated[OutputLocation, AfterValidator(_with_bucket)]
Formats = Annotated[tuple[WorldFormat, ...], Field(min_length=1), AfterValidator(distinct)]
WorldChoice = Annotated[
    Annotated[Literal["all"], member("text")]
    | Annotated[
        tuple[WorldReference, ...],
        Field(min_length=1, max_length=MAX_WORLDS_OF_EXPORT),
        AfterValidator(distinct),
        member("list"),
    ],
    by_shape(
        'all, or a list of worlds such as ["wgj-0123456789abcdef/world-1-1"]: those that the document imports by their '
        "names, others as simyard list worlds shows them",
        text=frozenset({"all"}),
        list=(list, tuple),
    ),
]
Template = Annotated[
    Annotated[str, text(1, 1224, GENERIC_PATTERN), member("text")] | Annotated[TemplateBody, member("TemplateBody")],
    by_shape("a path, a URL, a name, an ARN, or a template body", text=str, TemplateBody=dict),
    BeforeValidator(_json_text_as_object),
]


SourceKind = Literal["map", "sdf", "mjcf", "mesh"]
SOURCE_ENDINGS: Mapping[SourceKind, tuple[str, ...]] = {
    "map": (".yaml", ".yml"),
    "sdf": (".world", ".sdf"),
    "mjcf": (".xml", ".mjcf"),
    "mesh": (".glb", ".stl", ".obj", ".dae", ".ply"),
}
"""What files end in that worlds are imported from: maps of ROS, Gazebo worlds, scenes of MuJoCo, meshes."""
_OF_KINDS: Mapping[str, tuple[SourceKind, ...]] = {"models": ("sdf",), "wallHeight": ("map",), "unit": ("mesh",)}
Place = Annotated[Number, Field(ge=-1e5, le=1e5)]
MeshUnit = Literal["m", "cm", "mm", "in", "ft"]


_NO_CUT = (
    "nothing: no cut is made of a mesh or a scan; leave it out, and a mesh with triangles is taken whole, "
    "or make a map of ROS (.yaml and .pgm) of the cut"
)
_OF_VARIANTS = ("seed", "move", "remove", "clutter", "robotRadius")


def variant_names(name: str, variants: object) -> tuple[str, ...]:
    """Returns the names of the worlds of an entry of raw data: its own, or one for each variant."""
    if type(variants) is not int or not 1 <= variants <= MAX_WORLDS_OF_DOCUMENT:
        return (name,)
    return tuple(f"{name}-{number}" for number in range(1, variants + 1))


def source_kind(source: str) -> SourceKind | None:
    """Returns what a file is that a world is imported from, as its name's ending tells; None for no such file."""
    ending = PurePosixPath(source).suffix.lower()
    return next((kind for kind, endings in SOURCE_ENDINGS.items() if ending in endings), None)


class WorldImport(Ruled):
    """Makes a world of a building of one's own: a map of ROS, a Gazebo world, a scene of MuJoCo, or a mesh.

    Attributes:
        start: Where the robot starts (x, y in metres, yaw in rad), in the source's frame; left out, the origin or
            another place from which it reaches most of the floor.
        variants: How many worlds to make of it in place of itself, each with pieces moved, taken out and added.
        seed: Of the variants; the same seed makes the same ones.
    """

    name: PlainName = Field(title="Name", description="What the matrix and the export call the world.")
    source: SourcePath = Field(title="File", description="Path of the source, from the document's folder.")
    models: Annotated[tuple[SourcePath, ...], Field(max_length=100)] | None = Field(
        default=None, title="Model folders", description="Where model:// and package:// lead, in this order."
    )
    start: Annotated[tuple[Place, ...], Field(min_length=2, max_length=3)] | None = Field(default=None, title="Start")
    wallHeight: Annotated[Number, Field(gt=0.0, le=100.0)] | None = Field(
        default=None, title="Wall height (m)", description="How high stands what a map shows; 2 m if left out."
    )
    unit: MeshUnit | None = Field(default=None, title="Unit", description="Of a mesh; metres if left out.")
    routes: Annotated[tuple[SourcePath, ...], Field(max_length=100)] | None = Field(
        default=None, title="Routes", description="Files of routes, places, zones and walks, in the source's frame."
    )
    variants: Annotated[Integer, Field(ge=1, le=MAX_WORLDS_OF_DOCUMENT)] | None = Field(default=None, title="Variants")
    seed: Seed | None = Field(default=None, title="Seed")
    move: Annotated[Number, Field(ge=0.0, le=5.0)] | None = Field(
        default=None, title="Move (m)", description="How far pieces of a variant are moved at most; 0 if left out."
    )
    remove: Annotated[Number, Field(ge=0.0, le=1.0)] | None = Field(
        default=None, title="Remove", description="Share of the pieces that is taken out; 0 if left out."
    )
    clutter: Annotated[Integer, Field(ge=0, le=1000)] | None = Field(
        default=None, title="Clutter", description="How many boxes and pallets are added; 0 if left out."
    )
    robotRadius: Annotated[Number, Field(gt=0.0, le=1.0)] | None = Field(
        default=None, title="Robot radius (m)", description=f"Who gets about in each; {ROBOT_RADIUS_M} if left out."
    )

    def names(self) -> tuple[str, ...]:
        """Returns the names of the worlds that it makes."""
        return variant_names(self.name, self.variants)

    @classmethod
    def findings(cls, data: object) -> Iterator[Finding]:
        """Yields a file of no known kind, fields that its kind does not have, and those of variants without any."""
        for name in _OF_VARIANTS:
            if part(data, name) is not None and part(data, "variants") is None:
                yield Finding((name,), part(data, name), "variants beside it, of which it says what they are like")
        if part(data, "at") is not None:
            yield Finding(("at",), part(data, "at"), _NO_CUT)
        source = part(data, "source")
        if not isinstance(source, str):
            return
        kind = source_kind(source)
        if kind is None:
            endings = ", ".join(each for endings in SOURCE_ENDINGS.values() for each in endings)
            yield Finding(("source",), source, f"a file that ends in one of {endings}")
        for name, kinds in _OF_KINDS.items():
            if kind and part(data, name) is not None and kind not in kinds:
                endings = ", ".join(each for kind in kinds for each in SOURCE_ENDINGS[kind])
                yield Finding((name,), part(data, name), f"nothing for {source}: it is for {endings}")


class PipelineWorldCount(Ruled):
    """How many worlds: floor plans, times interiors of each.

    Attributes:
        floorplanCount: Different floor plans.
        interiorCountPerFloorplan: Differently furnished worlds of each.
    """

    floorplanCount: Annotated[Integer, Field(ge=1)] = Field(default=1, title="Floor plans")
    interiorCountPerFloorplan: Annotated[Integer, Field(ge=1)] = Field(default=1, title="Interiors of each floor plan")

    @classmethod
    def findings(cls, data: object) -> Iterator[Finding]:
        """Yields a number of worlds that no document has."""
        counts = [part(data, "floorplanCount"), part(data, "interiorCountPerFloorplan")]
        plans, interiors = (count if type(count) is int else 1 for count in counts)
        worlds = plans * interiors
        if plans > 0 and worlds > MAX_WORLDS_OF_DOCUMENT:
            found = f"{plans} floor plans x {interiors} interiors are {worlds}"
            yield Finding((), data, f"at most {MAX_WORLDS_OF_DOCUMENT} worlds; {found}")


class WorldGeneration(Spec):
    """Makes worlds from a template; takes a CreateWorldGenerationJob request as it stands.

    Attributes:
        tags: At most 50 keys and values.
        worldTags: At most 50 keys and values.
        clientRequestToken: Makes the request only once, however often it is sent; left out, the run has its own.
    """

    template: Template = Field(title="Template", description="Path, URL in a bucket, name, ARN, or the body itself.")
    worldCount: PipelineWorldCount = Field(
        title="How many worlds", description="Of more than 50, each 50 are a job of their own."
    )
    seed: Seed = Field(default=0, title="Seed", description="The same seed makes the same worlds.")
    robotRadius: Annotated[Number, Field(ge=0.05, le=0.6)] = Field(
        default=ROBOT_RADIUS_M,
        title="Robot radius (m)",
        description="Every room is reachable for a robot of this radius.",
    )
    tags: TagMap | None = Field(default=None, title="Tags of the job")
    worldTags: TagMap | None = Field(default=None, title="Tags of each world")
    clientRequestToken: ClientRequestToken | None = Field(default=None, title="Token")


class WorldExport(Spec):
    """Writes worlds to a bucket; takes a CreateWorldExportJob request as it stands.

    Attributes:
        outputLocation: Bucket and folder that the zip is written to.
        formats: In which formats, each once.
        tags: At most 50 keys and values.
        clientRequestToken: Makes the request only once, however often it is sent; left out, the run has its own.
    """

    worlds: WorldChoice = Field(default="all", title="Worlds", description="All worlds of this run, or named ones.")
    outputLocation: Destination = Field(title="Output location")
    formats: Formats = Field(default=("mjcf", "sdf", "map", "svg"), title="Formats")
    iamRole: IamRole | None = Field(default=None, title="IAM role", description="Kept; has no effect.")
    tags: TagMap | None = Field(default=None, title="Tags of the job")
    clientRequestToken: ClientRequestToken | None = Field(default=None, title="Token")
