"""The process that reads somebody's world: an entry of a document's section in, a world or its faults out.

Run as ``python -m tasks.worlds.importer.import_process``, shut in, with a ``WorldImport`` as its input, whose paths
hold in any folder; the last line that it prints is an ``ImportAnswer``. Whoever wrote the files may have meant harm.
"""

import hashlib
import resource
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from specs.base import Fault
from specs.data.world import MapAgreement, Start
from specs.errors import DocumentError
from specs.pipeline.world_sections import MeshUnit, WorldImport, source_kind
from tasks.storage.worlds import encode_world
from tasks.worlds.importer.assemble import ImportedAs, assemble_world
from tasks.worlds.importer.map_agreement import agreement, map_beside
from tasks.worlds.importer.map_reader import MAP_WALL_M, read_floor, read_map
from tasks.worlds.importer.mesh_reader import read_mesh
from tasks.worlds.importer.mjcf_reader import read_mjcf
from tasks.worlds.importer.sdf_reader import read_sdf
from tasks.worlds.importer.source_scene import ImportAnswer, Scene, SourceError

UNITS_M: Mapping[MeshUnit, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
MOST_BYTES = 4 << 30
"""Of memory, mapped or used; a large hospital takes one of them."""
MOST_CPU_S = 600
_MOST_MAPS = 8


def import_source(asked: WorldImport) -> ImportAnswer:
    """Returns the world of a source, or its faults."""
    path = Path(asked.source)
    try:
        scene, kind, agreements = _read_scene(asked, path), source_kind(path.name) or "sdf", list[MapAgreement]()
        if kind != "map":
            scene, agreements = _with_maps(scene, path)
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


def _with_maps(scene: Scene, path: Path) -> tuple[Scene, list[MapAgreement]]:
    """Returns a scene whose files name the maps beside its source, and how it agrees with each of these.

    A YAML file beside it that is no map is somebody's for something else.
    """
    files, found = dict(scene.files), list[MapAgreement]()
    solids = [solid for piece in scene.pieces for solid in piece.solids]
    for beside in sorted(each for each in path.parent.glob("*.yaml") if each.is_file())[:_MOST_MAPS]:
        try:
            known, (_, described) = map_beside(beside), read_floor(beside)
        except SourceError:
            continue
        for name in (beside.name, described.image):
            files[name] = hashlib.sha256((path.parent / name).read_bytes()).hexdigest()
        found.append(agreement(solids, known))
    return replace(scene, files=files), found


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
