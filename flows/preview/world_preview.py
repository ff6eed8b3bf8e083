"""What `simyard world` shows: worlds of a template or a job, the furniture catalogue, and a first template."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import cast, get_args

import numpy as np
from pydantic import JsonValue

from flows.pipeline.world_imports import import_lines
from specs.arn import parse_reference, resource_kind
from specs.base import Fault, Spec
from specs.data.world import Rectangle, RoomType, World
from specs.errors import DocumentError
from specs.pipeline.world_sections import WorldImport
from specs.template.body import TemplateBody
from specs.template.interior import ModelType
from tasks.documents.parse import parse
from tasks.documents.shape_text import meant_text, same_word
from tasks.documents.template_source import find_template
from tasks.export.drawing.furniture_symbols import solid_view_svg
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import read
from tasks.storage.worlds import read_world
from tasks.worlds.floorplan.search import WorldRejected
from tasks.worlds.furnishing.assembly import assemble, draw_look
from tasks.worlds.furnishing.scene import Piece
from tasks.worlds.furniture.catalogue import CATALOGUE
from tasks.worlds.furniture.furniture_type import FurnitureType, Range, Tier
from tasks.worlds.generate import generate_world
from tasks.worlds.geometry import Box
from tasks.worlds.job.generation_job import KIND
from tasks.worlds.starter_template import Version, commented_yaml, starter_json, starter_template

_MOST_ROOMS = 6
_ROOM_TYPES: dict[str, RoomType] = {str(kind): kind for kind in get_args(RoomType)}
_VERSIONS: dict[str, Version] = {"1": "1", "2": "2"}
_SUFFIXES = (".yaml", ".yml", ".json")


def write_starter(output: Path, rooms: str, version: str) -> None:
    """Writes a template into a file that is not there yet.

    Args:
        output: The file; JSON if its name ends in .json, else YAML.
        rooms: Types of rooms with commas between them.
        version: Of the template, 1 or 2.

    Raises:
        DocumentError: For rooms or a version that there are not, and for a file that is there or cannot be written.
    """
    faults = [*_room_faults(_words(rooms)), *_version_faults(version), *_suffix_faults(output)]
    if faults:
        raise DocumentError(faults, "simyard world template")
    body = starter_template([_ROOM_TYPES[same_word(word, _ROOM_TYPES)] for word in _words(rooms)], _VERSIONS[version])
    text = starter_json(body) if output.suffix.lower() == ".json" else commented_yaml(body)
    if output.exists():
        raise _refused_template(f"{output} is there already", "another name; nothing was written")
    try:
        output.parent.mkdir(parents=True, exist_ok=True)
        # Created, never replaced, also when somebody else is quicker.
        with output.open("x", encoding="utf-8") as file:
            file.write(text)
    except OSError as exc:
        raise _refused_template(f"{output} cannot be written ({exc.strerror})", "a file that can be written") from exc


def template_hints(output: Path) -> Iterator[str]:
    """Yields what to do with a template that was written."""
    yield "Change what you like, then look at the worlds that it gives:"
    yield f"  simyard world preview {output} --output plan.svg"
    yield f"  simyard world sheet {output} --output sheet.svg"
    yield "A document makes worlds of it, with the path as seen from the document's folder:"
    yield "  worldGeneration:"
    yield f"    template: {output}"
    yield "    worldCount: {floorplanCount: 5, interiorCountPerFloorplan: 2}"


def _words(rooms: str) -> list[str]:
    return [word.strip() for word in rooms.split(",")]


def _room_faults(words: list[str]) -> Iterator[Fault]:
    for word in words:
        if not same_word(word, _ROOM_TYPES):
            known = [kind.lower() for kind in _ROOM_TYPES]
            yield Fault(path="--rooms", value=repr(word), allowed=f"{meant_text(word, known)}one of {', '.join(known)}")
    if len(words) > _MOST_ROOMS:
        yield Fault(path="--rooms", value=f"{len(words)} rooms", allowed=f"from 1 to {_MOST_ROOMS}")


def _version_faults(version: str) -> Iterator[Fault]:
    if version not in _VERSIONS:
        yield Fault(path="--version", value=repr(version), allowed="1 or 2")


def _suffix_faults(output: Path) -> Iterator[Fault]:
    if output.suffix.lower() not in _SUFFIXES:
        yield Fault(path="--output", value=str(output), allowed=f"a file that ends in {', '.join(_SUFFIXES)}")


def _refused_template(value: str, allowed: str) -> DocumentError:
    return DocumentError.of("--output", value, allowed, source="simyard world template")


FURNITURE_KINDS: tuple[str, ...] = get_args(ModelType)
_USUAL_ROOM_M2 = 20.0
_LOOK_SEED = 3
_TIERS: tuple[Tier, ...] = get_args(Tier)
_STANDS = {"wall": "at a wall", "corner": "in a corner", "center": "in the middle, at a wall in small rooms"}


class FurnitureKind(Spec):
    """One kind of furniture.

    Attributes:
        width_m: Least and greatest extent along its back.
        depth_m: Least and greatest extent from its back to its front.
        height_m: Least and greatest height.
        clear_m: Floor kept free before it.
        stands: Where it stands, alone or with what.
        essential: The rooms that it makes what they are.
        likely: Other rooms that mostly have it.
        occasional: Other rooms that sometimes have it.
    """

    kind: str
    width_m: Range
    depth_m: Range
    height_m: Range
    clear_m: float
    stands: str
    essential: tuple[RoomType, ...]
    likely: tuple[RoomType, ...]
    occasional: tuple[RoomType, ...]


def furniture_kinds() -> list[FurnitureKind]:
    """Returns every kind of furniture that a template may list, in the order of its schema."""
    return [_kind(CATALOGUE[name]) for name in FURNITURE_KINDS]


def furniture_rows() -> list[dict[str, JsonValue]]:
    """Returns every kind as a row of a table, sizes in metres."""
    return [
        {
            "kind": each.kind,
            "width": size_text(each.width_m),
            "depth": size_text(each.depth_m),
            "height": size_text(each.height_m),
            "free floor": f"{each.clear_m:g}",
            "rooms": ", ".join((*each.essential, *each.likely)) or "only with others of its group, or where listed",
        }
        for each in furniture_kinds()
    ]


def furniture_picture(kind: str) -> str:
    """Returns the picture of a kind of furniture in a usual size (SVG), with the floor that is kept free before it."""
    model = CATALOGUE[kind]
    widths, depths, heights = model.usual(_USUAL_ROOM_M2)[-1].sizes
    width, depth, height = (each[len(each) // 2] for each in (widths, depths, heights))
    size = (width, depth or width, height)
    half, front = max(size[0], model.use_width_m) / 2, size[1] / 2
    clear = Rectangle(x_min_m=-half, x_max_m=half, y_min_m=front, y_max_m=front + model.front_m)
    body = Box(-size[0] / 2, -size[1] / 2, size[0] / 2, size[1] / 2)
    look = draw_look(np.random.default_rng(_LOOK_SEED))
    piece = Piece(kind, size, (0.0, 0.0), 0, 0.0, body)
    return solid_view_svg(kind, assemble(piece, kind, "", look).solids, clear)


def write_furniture_pictures(folder: Path) -> list[Path]:
    """Writes a picture of each kind into a folder, and returns their files.

    Raises:
        DocumentError: The folder cannot be written.
    """
    files = [folder / f"{kind}.svg" for kind in FURNITURE_KINDS]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for file, kind in zip(files, FURNITURE_KINDS, strict=True):
            file.write_text(furniture_picture(kind), encoding="utf-8")
    except OSError as exc:
        raise DocumentError.of(
            "--pictures", f"{folder} ({exc.strerror})", "a folder that can be written", source="simyard world furniture"
        ) from exc
    return files


def size_text(span: Range) -> str:
    """Returns from where to where something reaches, as one figure where both are the same."""
    low, high = span
    return f"{low:g}" if low == high else f"{low:g}-{high:g}"


def _kind(model: FurnitureType) -> FurnitureKind:
    # A depth of 0 stands for as deep as wide.
    depths = [variant.depth_m if variant.depth_m[1] else variant.width_m for variant in model.variants]
    rooms: dict[Tier, list[RoomType]] = {tier: [use.room for use in model.rooms if use.tier == tier] for tier in _TIERS}
    likely: list[RoomType] = [room for room in rooms["likely"] if room not in rooms["essential"]]
    known = {*rooms["essential"], *likely}
    rarely: list[RoomType] = [room for room in rooms["occasional"] if room not in known]
    place = _STANDS[model.anchor] + (", flush beside others" if model.row else "")
    window = ", also below a window" if model.under_window else ""
    near = f", near {' or '.join(model.taste.near)}" if model.taste.near else ""
    return FurnitureKind(
        kind=model.name,
        width_m=_span([variant.width_m for variant in model.variants]),
        depth_m=_span(depths),
        height_m=_span([variant.height_m for variant in model.variants]),
        clear_m=model.front_m,
        stands=f"{place}{window}{near}",
        essential=tuple(rooms["essential"]),
        likely=tuple(likely),
        occasional=tuple(rarely),
    )


def _span(spans: Sequence[Range]) -> Range:
    return min(low for low, _ in spans), max(high for _, high in spans)


_GENERATION = "preview"
_JOB_ID = "wgj-"
_IMPORTS = ("import-", "variants-")


@dataclass(frozen=True)
class WorldRequest:
    """What decides worlds beside their template.

    Attributes:
        seed: At least 0.
        robot_radius_m: Of the robot that gets into every room.
    """

    seed: int
    robot_radius_m: float


@dataclass(frozen=True)
class WorldSelection:
    """Worlds for a sheet.

    Attributes:
        title: What they have in common.
        worlds: At least one.
        total: How many there are, of which these are the first.
        rejected: Why others could not be made, one sentence each.
    """

    title: str
    worlds: tuple[World, ...]
    total: int
    rejected: tuple[str, ...] = ()


def make_world(template: TemplateBody, asked: WorldRequest, floorplan: int, interior: int) -> World:
    """Returns the world of a template at two indices, from 1.

    Args:
        template: What worlds are made from.
        asked: What decides worlds beside their template.
        floorplan: Index of the floor plan, from 1.
        interior: Index of the interior of that floor plan, from 1.

    Raises:
        WorldRejected: It cannot be made.
    """
    return generate_world(
        template,
        seed=asked.seed,
        generation=_GENERATION,
        floorplan_index=floorplan,
        interior_index=interior,
        robot_radius_m=asked.robot_radius_m,
    )


def find_world(reference: str, store: Store) -> World | None:
    """Returns the world of the store that an ARN or ``<generation>/<world>`` means; None for what may be a template.

    Raises:
        ResourceNotFound: An ARN means a world that is not there.
    """
    path, named = parse_reference(reference).path, resource_kind(reference) == "world"
    if named or (path.count("/") == 1 and "." not in path and store.exists(f"worlds/{path}.json")):
        return read_world(store, path, "simyard world preview")
    return None


def world_lines(world: World) -> Iterator[str]:
    """Yields what a world is, for a person: its report if it was imported, else what it guarantees and lacks."""
    if world.source is not None:
        yield from import_lines(world)
        return
    certificate = world.certificate
    radius_m, clear = (
        certificate.reachable_robot_radius_m,
        f"{100 * certificate.free_floor_share:.0f} % of the floor free",
    )
    yield f"{world.name} by {world.generator}: {len(world.rooms)} rooms, {len(world.furniture)} pieces, {clear}"
    yield f"  a robot of up to {radius_m:g} m radius gets into every room"
    yield from (f"  unmet wish: {line}" for line in certificate.unmet)


_NOT_IN_A_NAME = re.compile("[^a-zA-Z0-9_-]+")


def read_import_options(options: Mapping[str, JsonValue]) -> WorldImport:
    """Returns what the options of a command ask to import.

    Args:
        options: By the names of a document, None for what is left out; ``start`` is a text.

    Raises:
        DocumentError: They are not what an import takes; with all faults, by the names of the options.
    """
    given = {name: value for name, value in options.items() if value is not None}
    start, file_name = str(given.pop("start", "")), _NOT_IN_A_NAME.sub("-", Path(str(given["source"])).stem)
    try:
        place: list[JsonValue] = [float(each) for each in start.split(",")] if start else []
    except ValueError as exc:
        allowed = "x,y or x,y,yaw, in metres and rad"
        raise DocumentError.of("--start", repr(start), allowed, source="simyard world import") from exc
    try:
        entry: dict[str, JsonValue] = {"name": file_name.strip("-_")[:64] or "world", **given}
        return parse(WorldImport, {**entry, "start": place} if place else entry, "simyard world import")
    except DocumentError as exc:
        raise DocumentError([_of_option(fault) for fault in exc.faults], exc.source) from exc


def _of_option(fault: Fault) -> Fault:
    """Returns a fault of a field as one of the option that it comes from."""
    field, _, _ = fault.path.partition("[")
    option = "FILE" if field == "source" else f"--{field.replace('wallHeight', 'wall-height')}"
    return fault.model_copy(update={"path": option})


def select_worlds(reference: str, store: Store, base: Path, count: int, asked: WorldRequest) -> WorldSelection:
    """Returns the first worlds of a generation job or of an import, or the first floor plans that a template gives.

    Args:
        reference: A job's ARN or id, the generation of an import, or a template as a document names one.
        store: Where jobs and templates are.
        base: Folder that a template's relative path starts from.
        count: How many worlds at most.
        asked: For a template.

    Raises:
        DocumentError: There is no such job or template, or the job has no worlds.
        WorldRejected: The template gives no world.
    """
    if resource_kind(reference) == KIND or reference.startswith(_JOB_ID):
        return _of_job(store, parse_reference(reference).path, count)
    if reference.startswith(_IMPORTS) and (places := _imported(store, reference)):
        return _first_of(store, reference, places, count)
    return worlds_of_template(
        find_template(reference, store, base), f"{Path(reference).name}, seed {asked.seed}", count, asked
    )


def worlds_of_template(template: TemplateBody, title: str, count: int, asked: WorldRequest) -> WorldSelection:
    """Returns the first floor plans that a template gives, each with its first interior.

    Args:
        template: What worlds are made from.
        title: What they have in common.
        count: How many floor plans are tried.
        asked: What decides worlds beside their template.

    Raises:
        WorldRejected: It gives no world.
    """
    worlds: list[World] = []
    rejected: list[WorldRejected] = []
    for floorplan in range(1, count + 1):
        try:
            worlds.append(make_world(template, asked, floorplan, 1))
        except WorldRejected as exc:
            rejected.append(exc)
    if not worlds:
        raise rejected[0]
    return WorldSelection(title=title, worlds=tuple(worlds), total=len(worlds), rejected=tuple(map(str, rejected)))


def write_drawing(output: Path, drawing: str) -> None:
    """Writes an SVG file.

    Raises:
        DocumentError: It cannot be written there.
    """
    if _beside(output) == output:
        raise _refused(output, "an SVG file; a picture in 3-D goes beside it as PNG")
    _write(output, drawing.encode())


def write_picture(output: Path, png: bytes) -> Path:
    """Returns the PNG file beside an SVG file, written.

    Raises:
        DocumentError: It cannot be written there.
    """
    _write(_beside(output), png)
    return _beside(output)


def _beside(output: Path) -> Path:
    return output.with_suffix(".png")


def _of_job(store: Store, job: str, count: int) -> WorldSelection:
    references = cast("list[str]", read(store, KIND, job).detail.get("worlds", []))
    if not references:
        raise DocumentError.of(KIND, repr(job), "a job that has made worlds")
    return _first_of(store, job, references, count)


def _imported(store: Store, generation: str) -> list[str]:
    """Returns the worlds that an import made, ``warehouse-2`` before ``warehouse-10``."""
    keys = (key for key in store.keys(f"worlds/{generation}/") if key.endswith(".json"))
    return sorted((key.removeprefix("worlds/").removesuffix(".json") for key in keys), key=lambda it: (len(it), it))


def _first_of(store: Store, title: str, references: Sequence[str], count: int) -> WorldSelection:
    worlds = tuple(read_world(store, reference, title) for reference in references[:count])
    return WorldSelection(title=title, worlds=worlds, total=len(references))


def _write(path: Path, body: bytes) -> None:
    try:
        path.write_bytes(body)
    except OSError as exc:
        raise _refused(path, f"a file that can be written ({exc.strerror})") from exc


def _refused(output: Path, allowed: str) -> DocumentError:
    return DocumentError.of("--output", repr(str(output)), allowed, source="simyard")
