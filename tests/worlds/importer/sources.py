"""Small sources, written by hand."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import trimesh

from specs.data.world import Solid
from tasks.worlds.importer.sdf_reader import read_sdf
from tasks.worlds.importer.source_scene import Scene

BOX = "<box><size>1 2 1</size></box>"


def collision(geometry: str, more: str = "") -> str:
    """Returns a link with one collision."""
    return f"<link name='link'><collision name='c'>{more}<geometry>{geometry}</geometry></collision></link>"


def model(name: str, inside: str = collision(BOX), attributes: str = "") -> str:
    """Returns a model that stands still."""
    return f"<model name='{name}' {attributes}><static>1</static>{inside}</model>"


def world(folder: Path, inside: str, version: str = "1.9", name: str = "w.world") -> Path:
    """Returns a world's file with some models in it."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"<?xml version='1.0'?><sdf version='{version}'><world name='w'>{inside}</world></sdf>")
    return path


def shared_model(folder: Path, name: str, inside: str, version: str = "1.6") -> Path:
    """Writes a model's folder, and returns it."""
    home = folder / name
    home.mkdir(parents=True, exist_ok=True)
    (home / "model.config").write_text(f"<model><sdf version='{version}'>model.sdf</sdf></model>")
    (home / "model.sdf").write_text(f"<sdf version='{version}'>{inside}</sdf>")
    return home


def scene(folder: Path, inside: str, version: str = "1.9", folders: Sequence[Path] = ()) -> Scene:
    """Returns the scene of a world with some models in it."""
    return read_sdf(world(folder, inside, version), folders)


def solids(found: Scene) -> list[Solid]:
    """Returns all solids of a scene."""
    return [solid for piece in found.pieces for solid in piece.solids]


def only(found: Scene) -> Solid:
    """Returns the one solid of a scene."""
    (solid,) = solids(found)
    return solid


def findings(found: Scene, became: str) -> list[str]:
    """Returns what is said of the parts that became something."""
    return [f"{each.subject}: {each.why}" for each in found.findings if each.became == became]


def write_mesh(path: Path, mesh: trimesh.Trimesh) -> Path:
    """Returns the file that a mesh was written to."""
    path.parent.mkdir(parents=True, exist_ok=True)
    mesh.export(path)
    return path


def dae(path: Path, unit_m: float = 1.0, up: str = "Z_UP", nodes: Sequence[tuple[str, str]] = (("table", ""),)) -> Path:
    """Writes a COLLADA file with a box of 1 x 2 x 3 units in each node, and returns it.

    Args:
        path: The file.
        unit_m: Metres of its unit.
        up: The axis that points up.
        nodes: Name and transformations of each node.
    """
    points = trimesh.creation.box((1, 2, 3))
    numbers = " ".join(f"{each:g}" for each in np.asarray(points.vertices).ravel())
    corners = " ".join(str(each) for each in np.asarray(points.faces).ravel())
    placed = "".join(
        f"<node id='{name}' name='{name}'>{steps}<instance_geometry url='#g'/></node>" for name, steps in nodes
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"""<?xml version="1.0" encoding="utf-8"?>
<COLLADA version="1.4.1"><asset><unit meter="{unit_m}"/><up_axis>{up}</up_axis></asset>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="24">{numbers}</float_array>
<technique_common><accessor source="#pa" count="8" stride="3"/></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="12"><input semantic="VERTEX" source="#v" offset="0"/><p>{corners}</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s">{placed}</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>""")
    return path
