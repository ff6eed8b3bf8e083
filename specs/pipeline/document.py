"""The whole document: from a world template to a tested fleet."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Literal, cast

from pydantic import Field

from specs.base import Spec, digest
from specs.field_types import Path as SourcePath
from specs.field_types import PlainName
from specs.launched_file import names_ros_launch
from specs.pipeline.gate_section import Gate, drawn_once, never_met, unaudited, unsearched
from specs.pipeline.generation_parts import MAX_WORLDS_OF_DOCUMENT
from specs.pipeline.search_section import Search, unsearchable
from specs.pipeline.simulation_section import Deployment, SimulationBatch, never_driven, unjudged
from specs.pipeline.world_sections import MAX_WORLDS_OF_EXPORT, WorldExport, WorldGeneration, WorldImport, variant_names
from specs.rules import Finding, Location, Ruled, items, part

SECTIONS = ("applications", "worlds", "worldGeneration", "worldExport", "simulationBatch", "deployment")
INERT_FIELDS = frozenset(
    {
        "iamRole",
        "vpcConfig",
        "compute",
        "tools",
        "useDefaultTools",
        "uploadConfigurations",
        "useDefaultUploadConfigurations",
        "useDefaultApplications",
        "portForwardingConfig",
        "streamUI",
        "command",
    }
)
"""Fields that only made sense on AWS: accepted, kept in the record, without effect."""


class ApplicationSource(Spec):
    """A bundle of one's own that the run publishes before it is used.

    Attributes:
        name: What the document calls the application.
        kind: What drives a robot, or a scenario.
        robot: Of a container image: the folder with ``robot.xml`` and ``ros.yaml``, if the image has none.
    """

    name: PlainName = Field(title="Name")
    kind: Literal["robot", "simulation"] = Field(default="robot", title="Kind")
    source: SourcePath = Field(
        title="Folder or image",
        description="Path of the bundle, or of a container image, from the document's folder; or docker://NAME@sha256:...",
    )
    robot: SourcePath | None = Field(default=None, title="Robot")


class PipelineSpec(Ruled):
    """A pipeline; any section may be left out.

    Attributes:
        applications: Bundles of one's own, published before anything else; those that come with Simyard need no entry.
        worlds: Buildings of one's own, imported before anything else runs.
        worldGeneration: Makes worlds from a template.
        worldExport: Writes worlds to files that other programs open.
        simulationBatch: Drives the robot through every world, with every seed.
        search: Finds rare failures of the batch's robot, and says how probable they are.
        gate: What must be shown before anything is deployed.
        deployment: Rolls the tested version out to a fleet.
    """

    name: PlainName = Field(title="Name", description="Letters, digits, underscores and hyphens, at most 64.")
    applications: Annotated[tuple[ApplicationSource, ...], Field(max_length=100)] = Field(
        default=(), title="Applications"
    )
    # None, not empty: documents without them keep the digest that they had before there was such a section.
    worlds: Annotated[tuple[WorldImport, ...], Field(max_length=100)] | None = Field(
        default=None, title="Imported worlds"
    )
    worldGeneration: WorldGeneration | None = Field(default=None, title="World generation")
    worldExport: WorldExport | None = Field(default=None, title="World export")
    simulationBatch: SimulationBatch | None = Field(default=None, title="Simulation batch")
    search: Search | None = Field(default=None, title="Search")
    gate: Gate | None = Field(default=None, title="Gate")
    deployment: Deployment | None = Field(default=None, title="Deployment")

    @classmethod
    def findings(cls, data: object) -> Iterator[Finding]:
        """Yields sections that lack what another one would give them."""
        if all(part(data, section) in (None, (), []) for section in SECTIONS):
            yield Finding((), data, f"at least one of {', '.join(SECTIONS)}")
        if part(data, "gate") is not None and part(data, "simulationBatch") is None:
            yield Finding(("gate",), part(data, "gate"), "simulationBatch beside it, whose results it judges")
        yield from unsearchable(part(data, "search"), part(data, "simulationBatch"))
        yield from unsearched(part(data, "gate"), part(data, "search"))
        yield from unaudited(part(data, "gate"), part(part(data, "simulationBatch"), "audit"))
        yield from never_met(part(data, "gate"), part(data, "simulationBatch"))
        imported = items(part(data, "worlds"))
        yield from drawn_once(
            part(data, "gate"),
            part(data, "simulationBatch"),
            part(data, "worldGeneration"),
            imported={str(part(each, "name")): _names(each) for each in imported},
        )
        yield from unjudged(part(data, "deployment"), part(data, "gate"))
        if part(data, "worldGeneration") is None and not imported:
            yield from _worlds_from_nowhere(data)
        yield from _too_many_to_export(data)
        yield from _published_twice(items(part(data, "applications")))
        yield from _imported_twice(imported)
        yield from _unknown_names(data, imported)


def canonical_digest(spec: PipelineSpec) -> str:
    """Returns the SHA-256 of a pipeline with its defaults spelled out: equal documents, equal digests."""
    return digest(spec)


def inert_fields(spec: PipelineSpec) -> list[str]:
    """Returns the fields that the document sets and that have no effect, such as ``worldExport.iamRole``.

    Lists are written ``[*]``, so that a field of a thousand requests is named once.
    """
    return list(dict.fromkeys([*_inert(spec, ""), *_never_driven(spec.simulationBatch)]))


def _never_driven(section: SimulationBatch | None) -> Iterator[str]:
    """Yields the variables that the matrix sets otherwise."""
    if section is None:
        return
    requests = [each.model_dump(mode="json") for each in section.createSimulationJobRequests]
    sweep = section.matrix.model_dump(mode="json").get("environmentVariables")
    yield from (f"simulationBatch.{field}" for field in never_driven(requests, sweep))


def _inert(value: object, path: str) -> Iterator[str]:
    if isinstance(value, tuple):
        for item in items(value):
            yield from _inert(item, f"{path}[*]")
    if not isinstance(value, Spec):
        return
    for name in type(value).model_fields:
        below = getattr(value, name)
        where = f"{path}.{name}".lstrip(".")
        if name == "command" and not getattr(value, "launchFile", ""):
            continue  # a container image is run by it
        if name in INERT_FIELDS and below is not None:
            yield where
        else:
            yield from _inert(below, where)


def _worlds_from_nowhere(data: object) -> Iterator[Finding]:
    allowed = "a list of worlds, or worldGeneration or worlds in the document"
    export, batch = part(data, "worldExport"), part(data, "simulationBatch")
    if export is not None and not _names_worlds(export):
        yield Finding(("worldExport", "worlds"), "all", allowed)
    requests = items(part(batch, "createSimulationJobRequests"))
    if batch is None or _names_worlds(part(batch, "matrix")) or (requests and all(map(_brings_world, requests))):
        return
    loc: Location = ("simulationBatch", "matrix", "worlds")
    yield Finding(loc, "all", allowed)


def _too_many_to_export(data: object) -> Iterator[Finding]:
    """Yields an export of more worlds than one job writes, and there is one export job."""
    export, section = part(data, "worldExport"), part(data, "worldGeneration")
    count, imported = part(section, "worldCount"), sum(len(_names(each)) for each in items(part(data, "worlds")))
    counts = [part(count, "floorplanCount"), part(count, "interiorCountPerFloorplan")]
    plans, interiors = (each if type(each) is int else 1 for each in counts)
    generated = plans * interiors if section is not None else 0
    if export is None or _names_worlds(export) or generated > MAX_WORLDS_OF_DOCUMENT:  # a fault of its own
        return
    if generated + imported > MAX_WORLDS_OF_EXPORT:
        made = f"{generated} are generated" + (f", and {imported} imported" if imported else "")
        allowed = f"at most {MAX_WORLDS_OF_EXPORT} worlds, by name; {made}"
        yield Finding(("worldExport", "worlds"), "all", allowed)


def _names_worlds(section: object) -> bool:
    return part(section, "worlds") not in (None, "all")


def _brings_world(request: object) -> bool:
    """Returns whether a request names its world, or launches a file of ROS that may: only its bundle tells."""
    applications = items(part(request, "simulationApplications"))
    if any(names_ros_launch(str(part(part(one, "launchConfig"), "launchFile"))) for one in applications):
        return True
    configs = [config for one in applications for config in items(part(one, "worldConfigs"))]
    return any(part(config, "world") is not None for config in configs)


def _names(entry: object) -> tuple[str, ...]:
    """Returns the names of the worlds that an entry of a raw section ``worlds`` makes."""
    return variant_names(str(part(entry, "name")), part(entry, "variants"))


def _imported_twice(worlds: Sequence[object]) -> Iterator[Finding]:
    seen: set[str] = set()
    for number, world in enumerate(worlds):
        name = str(part(world, "name"))
        names = {name, *_names(world)}
        if names & seen:
            yield Finding(("worlds", number, "name"), name, "a name of its own among the worlds and their variants")
        seen |= names


def _unknown_names(data: object, imported: Sequence[object]) -> Iterator[Finding]:
    """Yields names of worlds that the document does not import; ``<generation>/<world>`` and ARNs may be anywhere.

    One job is in one world: it names a variant, and not the building that the variants are made of.
    """
    varied = {str(part(each, "name")): _names(each) for each in imported}
    each_one = {name for names in varied.values() for name in names}
    shown = [f"{name} ({names[0]} to {names[-1]})" if names != (name,) else name for name, names in varied.items()]
    allowed = f'{", ".join(shown) or "no name, as the document has no section worlds"}; "<generation>/<world>", an ARN'
    allowed += "" if shown else "; simyard list worlds shows those that are in the store"
    for loc, name in _named_worlds(data):
        known = each_one if loc[-1] == "world" else each_one | varied.keys()
        if "/" not in name and not name.startswith("arn:") and name not in known:
            listed = name == "all" and loc[-1] != "world"
            yield Finding(loc, name, "all without a list around it: worlds: all" if listed else allowed)


def _named_worlds(data: object) -> Iterator[tuple[Location, str]]:
    """Yields each world that a raw document names, and where."""
    batch = part(data, "simulationBatch")
    lists: list[tuple[Location, object]] = [
        (("worldExport", "worlds"), part(part(data, "worldExport"), "worlds")),
        (("simulationBatch", "matrix", "worlds"), part(part(batch, "matrix"), "worlds")),
    ]
    for loc, worlds in lists:
        yield from (((*loc, number), each) for number, each in enumerate(items(worlds)) if isinstance(each, str))
    requests: Location = ("simulationBatch", "createSimulationJobRequests")
    for number, request in enumerate(items(part(batch, requests[1]))):
        for place, use in enumerate(items(part(request, "simulationApplications"))):
            for config, each in enumerate(items(part(use, "worldConfigs"))):
                loc = (*requests, number, "simulationApplications", place, "worldConfigs", config, "world")
                if isinstance(world := part(each, "world"), str):
                    yield loc, world


def place_worlds(spec: PipelineSpec, places: Mapping[str, Sequence[str]]) -> PipelineSpec:
    """Returns a document that names its imported worlds by where they are; a name without a place is left out.

    Args:
        spec: The document.
        places: The worlds that a name of the section ``worlds`` means, or one of a variant: ``<generation>/<world>``.
    """
    if spec.worlds is None:
        return spec
    own = {name for world in spec.worlds for name in (world.name, *world.names())}
    return cast("PipelineSpec", _placed(spec, {name: places.get(name, ()) for name in own}))


def _placed(value: object, places: Mapping[str, Sequence[str]]) -> object:
    """Returns a part of a document with the names of worlds as places."""
    if isinstance(value, tuple):
        return tuple(_placed(each, places) for each in items(value))
    if not isinstance(value, Spec):
        return value
    changed: dict[str, object] = {}
    for name in type(value).model_fields:
        below = getattr(value, name)
        if name == "worlds" and not isinstance(value, PipelineSpec):
            found = below if below == "all" else tuple(dict.fromkeys(_of_names(below, places)))
            changed[name] = found or "all"
        elif name == "world":
            changed[name] = next(iter(_of_names([below], places)), None) if below else below
        else:
            changed[name] = _placed(below, places)
    return value.model_copy(update=changed)


def _of_names(names: Sequence[str], places: Mapping[str, Sequence[str]]) -> Iterator[str]:
    for name in names:
        yield from places.get(name, [name])


def _published_twice(applications: object) -> Iterator[Finding]:
    seen: set[tuple[object, object]] = set()
    for number, application in enumerate(items(applications)):
        name = part(application, "name")
        key = (str(name), part(application, "kind") or "robot")
        if key in seen:
            yield Finding(("applications", number, "name"), name, "a name of its own among those of its kind")
        seen.add(key)
