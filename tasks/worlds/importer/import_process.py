"""The process that reads somebody's world: an entry of a document's section in, a world or its faults out.

Run as ``python -m tasks.worlds.importer.import_process``, shut in, with a ``WorldImport`` as its input, whose paths
hold in any folder; the last line that it prints is an ``ImportAnswer``. Whoever wrote the files may have meant harm.
"""

import hashlib
import resource
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from specs.base import Fault
from specs.data.world import MapAgreement, Start
from specs.errors import DocumentError
from specs.pipeline.world_sections import MeshUnit, WorldImport, source_kind
from tasks.storage.worlds import encode_world
from tasks.worlds.importer.assemble import ImportedAs, assemble_world
from tasks.worlds.importer.map_agreement import FloorMap, agreement
from tasks.worlds.importer.map_reader import MAP_WALL_M, read_floor, read_map
from tasks.worlds.importer.mjcf_reader import read_mjcf
from tasks.worlds.importer.placed_parts import Found, Model, Placed, scene_of, unique
from tasks.worlds.importer.route_reader import read_routes
from tasks.worlds.importer.sdf_reader import read_sdf
from tasks.worlds.importer.source_files import MAPS, SourceFiles
from tasks.worlds.importer.source_scene import ImportAnswer, Scene, SourceError
from tasks.worlds.importer.triangle_mesh import MESH_SUFFIXES, MeshUnreadable, joined, mesh_parts
from tasks.worlds.importer.upright_solids import TOLERANCE_M
from tasks.worlds.importer.walk_reader import WALK_FILES, read_walks

UNITS_M: Mapping[MeshUnit, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
MOST_BYTES = 4 << 30
"""Of memory, mapped or used; a large hospital takes one of them."""
MOST_CPU_S = 600
_MOST_MAPS = 8
ZONES = "zones.yaml"
"""Beside a source, it says what parts of the floor are called."""


def import_source(asked: WorldImport) -> ImportAnswer:
    """Returns the world of a source, or its faults."""
    path = Path(asked.source)
    try:
        scene, kind, agreements = _read_scene(asked, path), source_kind(path.name) or "sdf", list[MapAgreement]()
        if kind != "map":
            scene, agreements = _with_maps(scene, path)
        if given := _named_beside(path, [Path(each) for each in asked.routes or ()]):
            named = read_routes([each for each in given if each.suffix.lower() not in WALK_FILES])
            scene = replace(scene, routes=named.routes, zones=named.zones, files={**scene.files, **named.files})
            walked = read_walks([each for each in given if each.suffix.lower() in WALK_FILES])
            scene = replace(scene, walks=(*scene.walks, *walked.walks), files={**scene.files, **walked.files})
        described = ImportedAs(
            name=asked.name,
            kind=kind,
            file=path.name,
            start=_start(asked),
            settings=_settings(asked),
            agreements=agreements,
        )
        return ImportAnswer(world=encode_world(assemble_world(scene, described)).decode())
    except DocumentError as exc:
        return ImportAnswer(faults=exc.faults)
    except MemoryError:
        value = f"more than {MOST_BYTES >> 30} GB of memory"
        return ImportAnswer(faults=(Fault(path="size", value=value, allowed="a smaller world"),))


def _read_scene(asked: WorldImport, path: Path) -> Scene:
    """Returns the scene of a source, by the reader of its kind."""
    models, start = [Path(each) for each in asked.models or ()], _start(asked)
    place = (start.x_m, start.y_m) if start else None
    match source_kind(path.name):
        case "map":
            return read_map(path, MAP_WALL_M if asked.wallHeight is None else asked.wallHeight)
        case "sdf":
            return read_sdf(path, models, place)
        case "mesh":
            return read_mesh(path, UNITS_M[asked.unit or "m"], place)
        case "mjcf":
            return read_mjcf(path, place)
        case None:
            raise SourceError([Fault(path="file", value=path.name, allowed="a file of a known kind")], str(path))


def read_mesh(
    path: Path, unit_m: float = 1.0, start: tuple[float, float] | None = None, tolerance_m: float = TOLERANCE_M
) -> Scene:
    """Returns the scene of a mesh: each named part of its file is one piece.

    Args:
        path: A GLB, STL, OBJ, COLLADA or PLY file.
        unit_m: How many metres one unit of the file has; a COLLADA file's own unit is applied before.
        start: Where a robot starts: on the floor, where there are several.
        tolerance_m: How far surfaces may move.

    Raises:
        SourceError: It is no mesh, or nothing in it is higher than the floor.
    """
    files, found = SourceFiles(path), Found()
    if not 0.0 < unit_m < 1e6:
        raise files.refuse("unit", f"{unit_m:g}", "metres of one unit of the file, above 0, such as 0.01")
    try:
        parts = mesh_parts(files, path, upright=True)
        for part in parts:
            mesh = joined([part._replace(points=part.points * unit_m)])
            name = unique(part.name.strip() or path.stem, {each.name for each in found.models})
            found.models.append(Model(name, part.name.strip() or path.stem, np.eye(4)))
            found.parts.append(Placed(name, name, "a mesh", mesh, np.eye(4)))
    except (MeshUnreadable, OSError) as exc:
        allowed = f"a mesh: {', '.join(MESH_SUFFIXES)}"
        if path.suffix.lower() == ".ply":
            allowed += "; of a scan, make a mesh of its points, or a map of ROS (.yaml and .pgm) of a cut"
        raise files.refuse(path.name, str(exc), allowed) from exc
    return scene_of(found, files, start, tolerance_m)


def _with_maps(scene: Scene, path: Path) -> tuple[Scene, list[MapAgreement]]:
    """Returns a scene whose files name the maps beside its source, and how it agrees with each of these.

    Packages of ROS have worlds in ``worlds/`` and maps in ``maps/``, each robot's in its own folder. A YAML file there
    that is no map is somebody's for something else.
    """
    files, found = dict(scene.files), list[MapAgreement]()
    solids = [solid for piece in scene.pieces for solid in piece.solids]
    beside, maps = path.parent.resolve(), path.parent.resolve().parent / MAPS
    # A source among the maps has its own folder in both.
    places = dict.fromkeys([(beside, "*.yaml"), (maps, "*.yaml"), (maps, "*/*.yaml")])
    listed = [(folder, each) for folder, pattern in places for each in sorted(folder.glob(pattern))]
    own = [(folder, each) for folder, each in listed if each.is_file() and each.resolve().is_relative_to(folder)]
    for folder, each in own[:_MOST_MAPS]:
        try:
            cells, described = read_floor(each)
        except SourceError:
            continue
        root = folder if folder == beside else folder.parent
        for file in (each, each.parent / described.image):
            files[file.relative_to(root).as_posix()] = hashlib.sha256(file.read_bytes()).hexdigest()
        name = each.relative_to(root).as_posix()
        known = FloorMap(name, cells.occupied, cells.free, described.resolution_m, described.origin)
        found.append(agreement(solids, known))
    return replace(scene, files=files), found


def _named_beside(path: Path, routes: Sequence[Path]) -> list[Path]:
    """Returns the files of routes that were asked for, and the zones beside a source if they are not among them."""
    beside, known = path.with_name(ZONES), {each.resolve() for each in (path, *routes)}
    own = beside.is_file() and beside.resolve().is_relative_to(path.parent.resolve()) and beside.resolve() not in known
    return [*routes, beside] if own else [*routes]


def _start(asked: WorldImport) -> Start | None:
    if asked.start is None:
        return None
    x_m, y_m, *turn = asked.start
    return Start(x_m=x_m, y_m=y_m, yaw_rad=turn[0] if turn else 0.0)


def _settings(asked: WorldImport) -> dict[str, str]:
    """Returns what was asked for beside the file, by the names of the document."""
    found: dict[str, str] = {}
    if start := _start(asked):
        found["start"] = f"[{start.x_m:g}, {start.y_m:g}, {start.yaw_rad:g}]"
    if asked.wallHeight is not None:
        found["wallHeight"] = f"{asked.wallHeight:g}"
    if asked.unit is not None:
        found["unit"] = asked.unit
    return found


def _limit(kind: int, most: int) -> None:
    """Lets this process take no more, nor more than it was allowed before."""
    before = resource.getrlimit(kind)[1]
    most = most if before == resource.RLIM_INFINITY else min(most, before)
    resource.setrlimit(kind, (most, most))


def main() -> None:
    """Answers the request that it reads."""
    _limit(resource.RLIMIT_AS, MOST_BYTES)
    _limit(resource.RLIMIT_CPU, MOST_CPU_S)
    asked = WorldImport.model_validate_json(sys.stdin.read())
    sys.stdout.write("\n" + import_source(asked).model_dump_json() + "\n")


if __name__ == "__main__":
    main()
