"""Meshes as worlds: a hall, a scan, a building's export, in metres or with a unit."""

from pathlib import Path

import numpy as np

from tasks.worlds.importer.placed_parts import Found, Model, Placed, scene_of, unique
from tasks.worlds.importer.source_files import SourceFiles
from tasks.worlds.importer.source_scene import Scene
from tasks.worlds.importer.triangle_mesh import MESH_SUFFIXES, MeshUnreadable, joined, mesh_parts
from tasks.worlds.importer.upright_solids import TOLERANCE_M


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
        raise files.refuse(path.name, str(exc), allowed) from exc
    return scene_of(found, files, start, tolerance_m)
