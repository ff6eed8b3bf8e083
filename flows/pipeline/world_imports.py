"""Worlds that are imported: read in the confinement of applications, kept in the store, and told of.

A world's key is made of its source's digest, its settings and the importer, so that the same source is the same world,
and to import it again does nothing. Importing has no job: as a bundle, a world is what its bytes are.
"""

import hashlib
import os
import tempfile
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from pathlib import Path

from pydantic import ValidationError

from specs.base import Fault
from specs.data.episode import ApplicationLaunch
from specs.data.world import ROBOT_RADIUS_M, ImportFinding, World, solids
from specs.errors import DocumentError, LaunchRefused, ObjectExists
from specs.pipeline.document import PipelineSpec
from specs.pipeline.world_sections import WorldImport
from tasks.applications.registry import unpack
from tasks.ros.launch.launch_plan import LaunchSource, run_launch_program
from tasks.simulate.sandbox.confinement import Place, confined_command
from tasks.simulate.sandbox.process_environment import process_environment
from tasks.storage.base.local_files import cache_folder
from tasks.storage.base.store import Store
from tasks.storage.worlds import decode_world, encode_world, write_world
from tasks.worlds.importer.source_files import MAPS, MODELS
from tasks.worlds.importer.source_scene import ImportAnswer

_MODULE = "tasks.worlds.importer.import_process"
_LIMIT_S = 900.0
# Nothing is simulated: what is wrong with a variable for that is not told here.
_NEEDED = ("PATH", "LD_LIBRARY_PATH", "VIRTUAL_ENV")
_SHOWN = 12
_LAUNCHED_KEPT = 64
_JUDGES = "simulationBatch.createSimulationJobRequests[*].simulationApplications[0]"


@dataclass(frozen=True)
class ImportedWorld:
    """An imported world.

    Attributes:
        name: What the document calls it.
        world: Its document.
    """

    name: str
    world: World

    @property
    def reference(self) -> str:
        """Where it is in the store: ``<generation>/<world>``."""
        return f"{self.world.generation}/{self.world.name}"

    @property
    def digest(self) -> str:
        """The SHA-256 of its document."""
        return hashlib.sha256(encode_world(self.world)).hexdigest()


def import_world(asked: WorldImport, base: Path, path: str = "") -> ImportedWorld:
    """Returns the world of a source, which a process of its own reads.

    Args:
        asked: The entry of the document's section.
        base: Folder that its paths start from.
        path: Where the entry is in the document; empty for none.

    Raises:
        DocumentError: It is no world that can be imported; carries all its faults.
    """
    dot = f"{path}." if path else ""
    if faults := [*_missing_files(asked, base, dot)]:
        raise DocumentError(faults)
    source = (base / asked.source).absolute()
    models = tuple((base / each).absolute() for each in asked.models or ())
    routes = tuple((base / each).absolute() for each in asked.routes or ())
    update = {"source": str(source), "models": tuple(map(str, models)), "routes": tuple(map(str, routes))}
    placed = asked.model_copy(update={name: value or None for name, value in update.items()})
    beside = [folder for each in (MODELS, MAPS) if (folder := source.parent.parent / each).is_dir()]
    answer = _read_apart(placed, f"{dot}source", [source.parent, *beside, *models, *(each.parent for each in routes)])
    if answer.faults:
        raise DocumentError([_in_source(fault, f"{dot}source", asked.source) for fault in answer.faults])
    return ImportedWorld(asked.name, decode_world(answer.world.encode()))


def check_world_files(spec: PipelineSpec, base: Path) -> None:
    """Refuses worlds to import whose files and folders are not there; none of them is read.

    Args:
        spec: The document.
        base: Folder that relative paths start from.

    Raises:
        DocumentError: With a fault for each.
    """
    entries = enumerate(spec.worlds or ())
    if faults := [fault for number, each in entries for fault in _missing_files(each, base, f"worlds[{number}].")]:
        raise DocumentError(faults)


def _missing_files(asked: WorldImport, base: Path, dot: str) -> Iterator[Fault]:
    """Yields a fault for each file and folder of an entry that is not there; ``dot`` begins their fields."""
    source = (base / asked.source).absolute()
    if not source.is_file():
        yield _missing(f"{dot}source", asked.source, f"a file; there is none at {source}")
    for number, named in enumerate(asked.models or ()):
        if not (folder := (base / named).absolute()).is_dir():
            yield _missing(f"{dot}models[{number}]", named, f"a folder; there is none at {folder}")
    for number, named in enumerate(asked.routes or ()):
        if not (file := (base / named).absolute()).is_file():
            yield _missing(f"{dot}routes[{number}]", named, f"a file; there is none at {file}")


@lru_cache(maxsize=_LAUNCHED_KEPT)
def _launched(name: str, source: LaunchSource, variables: tuple[tuple[str, str], ...]) -> ImportedWorld:
    from tasks.simulate.sandbox.launch_check import check_launch_file  # noqa: PLC0415 - few documents need it

    folder, path = source.bundle, f"{_JUDGES}.worldConfigs"
    report = check_launch_file(source, [dict(variables)], own=False)
    gazebo = report.gazebo
    if gazebo is None or gazebo.world is None:
        why = report.unread or "; ".join((*report.refusals, *(gazebo.findings if gazebo else ())))
        why = why or ("" if report.has_ros else report.ros) or "it starts no world of Gazebo's"
        allowed = (
            f"a world, in worldConfigs or in the document: {source.package} {source.launch_file} brings none: {why}"
        )
        raise DocumentError.of(path, "none", allowed)
    start = gazebo.spawn
    asked: dict[str, object] = {"name": name, "source": _inside(gazebo.world, folder)}
    if gazebo.model_folders:
        asked["models"] = [_inside(each, folder) for each in gazebo.model_folders]
    if start:
        asked["start"] = [start.x_m, start.y_m, start.yaw_rad]
    return import_world(WorldImport.model_validate(asked), folder, path)


def _inside(path: Path, folder: Path) -> str:
    """Returns a path as seen from a bundle, wherever that is unpacked."""
    return str(path.relative_to(folder) if path.is_relative_to(folder) else path)


def launched_world(store: Store, launch: ApplicationLaunch, variables: Mapping[str, str]) -> ImportedWorld:
    """Returns the world that a simulation application's launch file starts Gazebo with; the spawn is its start.

    Args:
        store: Where the bundle is.
        launch: The simulation application.
        variables: Environment variables of its job.

    Raises:
        DocumentError: The launch file cannot be read, starts no world, or its world cannot be imported.
    """
    folder = unpack(store, launch.digest, cache_folder() / "bundles")
    source = LaunchSource(folder, launch.package, launch.launch_file)
    return _launched(launch.name, source, tuple(sorted(variables.items())))


_made: ContextVar[dict[tuple[str, Path], list[ImportedWorld]] | None] = ContextVar("made", default=None)


@contextmanager
def sources_read_once() -> Generator[None]:
    """Lets each entry of a document be imported once within the block: a run does not read what a trial has read."""
    token = _made.set({})
    try:
        yield
    finally:
        _made.reset(token)


def import_worlds(asked: WorldImport, base: Path, path: str = "") -> list[ImportedWorld]:
    """Returns the worlds that an entry of a document makes: one, or the variants that it asks for.

    Raises:
        DocumentError: As ``import_world`` says; or a robot has no room in the world, or in one of its variants.
    """
    made, key = _made.get(), (asked.model_dump_json(), base)
    if made is None:
        return _new_worlds(asked, base, path)
    if key not in made:
        made[key] = _new_worlds(asked, base, path)
    return made[key]


def _new_worlds(asked: WorldImport, base: Path, path: str) -> list[ImportedWorld]:
    whole = import_world(asked, base, path)
    if asked.variants is None:
        return [whole]
    # NumPy, which a gateway's answers do not need.
    from tasks.worlds.floorplan.search import WorldRejected  # noqa: PLC0415
    from tasks.worlds.importer.variants import VariantWishes, vary_worlds  # noqa: PLC0415

    wishes = VariantWishes(
        move_m=asked.move or 0.0,
        remove=asked.remove or 0.0,
        clutter=asked.clutter or 0,
        radius_m=ROBOT_RADIUS_M if asked.robotRadius is None else asked.robotRadius,
    )
    try:
        made = vary_worlds(whole.world, asked.seed or 0, range(1, asked.variants + 1), wishes)
        return [ImportedWorld(asked.name, world) for world in made]
    except WorldRejected as exc:
        raise DocumentError.of(f"{path}.variants" if path else "variants", str(asked.variants), exc.reason) from exc


def _missing(path: str, value: str, allowed: str) -> Fault:
    return Fault(path=path, value=repr(value), allowed=allowed)


def _in_source(fault: Fault, path: str, source: str) -> Fault:
    """Returns a fault of a source as one of the document that names it."""
    return Fault(path=path, value=f"{source}: {fault.path}: {fault.value}", allowed=fault.allowed)


def _read_apart(asked: WorldImport, path: str, folders: list[Path]) -> ImportAnswer:
    """Returns what a process of its own makes of a source.

    Raises:
        DocumentError: It came to no answer.
    """
    try:
        return ImportAnswer.model_validate_json(answer_apart(_MODULE, asked.model_dump_json(), folders))
    except (LaunchRefused, ValidationError) as exc:
        why = str(exc) if isinstance(exc, LaunchRefused) else "it says nothing that is an answer"
        allowed = f"a world that is read in {_LIMIT_S:g} s with 4 GB of memory; the process that reads it: {why}"
        raise DocumentError.of(path, repr(asked.source), allowed) from exc


def answer_apart(module: str, asked: str, folders: Sequence[Path]) -> str:
    """Returns the last line that a module prints, run in the confinement of applications.

    Args:
        module: Run with ``python -m``.
        asked: What it reads.
        folders: What it sees of this machine's own files.

    Raises:
        LaunchRefused: It came to no answer.
    """
    with tempfile.TemporaryDirectory(prefix="simyard-import-") as folder:
        place = Place(Path(folder), Path(folder))
        command = confined_command(module, [], place, folders)
        own = {name: os.environ[name] for name in _NEEDED if name in os.environ}
        environment = process_environment(own, place.programs) | place.variables()
        return run_launch_program(command, environment, place.folder, asked, _LIMIT_S)


def keep_world(store: Store, imported: ImportedWorld, path: str = "source") -> None:
    """Puts an imported world into the store; it may be there already.

    Raises:
        DocumentError: Another world is there, which somebody put there.
    """
    try:
        write_world(store, imported.reference, encode_world(imported.world))
    except ObjectExists as exc:
        allowed = f"nothing else at {store.url}/worlds/{imported.reference}.json; delete what is there"
        raise DocumentError.of(path, imported.reference, allowed) from exc


def imported_lines(imported: Mapping[str, Sequence[ImportedWorld]]) -> Iterator[str]:
    """Yields what became of the worlds that a document imports, by the names of entries, for a person."""
    for name, each in imported.items():
        yield imported_summary(name, [one.world for one in each])
        yield from islice(import_lines(each[0].world), 1, None)


def imported_summary(name: str, worlds: Sequence[World]) -> str:
    """Returns what an entry of a document made, in one line; its name, and the worlds."""
    first = worlds[0]
    if first.name == name or first.report is None or first.source is None:
        return import_summary(first)
    counts = [len(solids(world)) for world in worlds]
    radius_m = min(world.certificate.reachable_robot_radius_m for world in worlds)
    return (
        f"{name} from {first.source.file}: {len(worlds):,} variants, {min(counts):,} to {max(counts):,} solids, "
        f"{first.report.exact:,} of {first.report.parts:,} parts exact, made for a robot of "
        f"{first.certificate.guaranteed_robot_radius_m:g} m radius; one of up to {radius_m:g} m {_REACHES} in each"
    )


def import_summary(world: World) -> str:
    """Returns what an imported world is, in one line: its pieces, what is not as it was, and who gets about."""
    report, source = world.report, world.source
    if report is None or source is None:
        return ""
    became = {kind: sum(each.became == kind for each in report.findings) for kind in _BECAME}
    size = f"{len(solids(world)):,} solids, {report.exact:,} of {report.parts:,} parts exact"
    said = [f"{world.name} from {source.file}: {size}"]
    said += [f"{count} {kind}" for kind, count in became.items() if count]
    radius_m = world.certificate.reachable_robot_radius_m
    said.append(f"a robot of up to {radius_m:g} m radius {_REACHES}" if radius_m else f"no robot {_REACHES}")
    return ", ".join(said)


# As `tasks.worlds.importer.own_floor` counts it.
_REACHES = "reaches 95 % of the floor that it fits on"
_BECAME = ("approximated", "dropped", "unresolved")


def import_lines(world: World) -> Iterator[str]:
    """Yields the import report for a person."""
    report, start, certificate = world.report, world.start, world.certificate
    if report is None or start is None or world.source is None:
        return
    yield import_summary(world)
    outline = world.footprint
    size = f"{outline.x_max_m - outline.x_min_m:.1f} x {outline.y_max_m - outline.y_min_m:.1f} m"
    how = "as asked" if any(each.startswith("start=") for each in world.source.settings) else "found"
    free = f"{100 * certificate.free_floor_share:.0f} % of {size} free"
    yield f"  start [{start.x_m:g}, {start.y_m:g}, {start.yaw_rad:g}] ({how}), {free}"
    if world.routes:
        yield f"  routes {', '.join(f'{route.name} ({len(route.points_m)})' for route in world.routes)}"
    if world.zones:
        rooms = [f"{zone.name} ({zone.area_m2:.1f} m2)" for zone in world.zones]
        more = f" and {len(rooms) - _SHOWN} more" if len(rooms) > _SHOWN else ""
        yield f"  {'rooms found' if world.zones[0].found else 'zones'} {', '.join(rooms[:_SHOWN])}{more}"
    for agreement in report.agreements:
        within = f"{100 * agreement.within_5cm:.1f} % of its border within 5 cm"
        mean = f"{100 * agreement.mean_m:.1f} cm off in the mean"
        floor = f"{100 * agreement.free_iou:.1f} % of the free floor the same"
        by = agreement.moved
        moved = f", moved by {by.x_m:g}, {by.y_m:g} m and turned by {by.yaw_rad:g} rad" if by is not None else ""
        line = f"{agreement.map}{moved}, best at {agreement.height_m:g} m: {within}, {mean}, {floor}"
        agrees = agreement.same_place
        yield f"  agrees with {line}" if agrees else f"  does not agree with {line}; is it of this place?"
    for kind in _BECAME:
        found = [each for each in report.findings if each.became == kind]
        yield from (f"  {_finding_line(each)}" for each in found[:_SHOWN])
        if len(found) > _SHOWN:
            yield f"  ... and {len(found) - _SHOWN} more {kind}; the world's document has them in its report"


def _finding_line(finding: ImportFinding) -> str:
    off = f", off by at most {100 * finding.off_m:.1f} cm" if finding.off_m else ""
    return f"{finding.became} {finding.subject}: {finding.why}{off}"


def unresolved_lines(world: World) -> Iterator[str]:
    """Yields a sentence for each part of an imported world that was not found, so that the world lacks it."""
    for finding in world.report.findings if world.report else ():
        if finding.became == "unresolved":
            yield f"World {world.name} lacks {finding.subject}: {finding.why}"
