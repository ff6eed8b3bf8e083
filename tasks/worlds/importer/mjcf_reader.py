"""Scenes of MuJoCo as placed parts: MuJoCo compiles them, and what stands there at the start is what a robot meets."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple
from xml.parsers.expat import ExpatError

import mujoco
import numpy as np

from specs.data.world import Color
from tasks.worlds.importer.placed_parts import Found, Model, Placed, scene_of, unique
from tasks.worlds.importer.source_files import Element, SourceFiles, shown
from tasks.worlds.importer.source_scene import Scene
from tasks.worlds.importer.triangle_mesh import SHAPES, Pose, TriangleMesh
from tasks.worlds.importer.upright_solids import TOLERANCE_M

_MOST_FILES = 200
_FILES = ("file", "fileback", "filedown", "filefront", "fileleft", "fileright", "fileup")
_MAKERS = ("replicate", "composite", "flexcomp", "attach", "extension", "plugin", "skin", "flex", "deformable")
_FOLDERS = ("meshdir", "assetdir", "texturedir")
_SHAPES: Mapping[int, tuple[str, tuple[int, ...]]] = {
    int(mujoco.mjtGeom.mjGEOM_BOX): ("box", (0, 1, 2)),
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): ("cylinder", (0, 1)),
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): ("capsule", (0, 1)),
    int(mujoco.mjtGeom.mjGEOM_SPHERE): ("sphere", (0,)),
    int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): ("ellipsoid", (0, 1, 2)),
}
_GIVEN_HALF = {"box": (2.0, 2.0, 2.0), "cylinder": (1.0, 2.0), "capsule": (1.0, 2.0)}
"""MuJoCo has half extents where SDF has whole ones."""


def read_mjcf(path: Path, start: tuple[float, float] | None = None, tolerance_m: float = TOLERANCE_M) -> Scene:
    """Returns the scene of a MuJoCo model: each body below the world is one piece, and so is what lies in the world.

    Args:
        path: The MJCF; what it names lies in its folder.
        start: Where a robot starts: on the floor, where there are several.
        tolerance_m: How far surfaces may move.

    Raises:
        SourceError: It is none, holds what no static world has, or MuJoCo refuses it.
    """
    files = SourceFiles(path)
    _check(files, path, [])
    files.check()
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, OSError) as exc:
        raise files.refuse(path.name, str(exc), "a model that MuJoCo compiles") from exc
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return scene_of(_found(model, data), files, start, tolerance_m)


def _check(files: SourceFiles, path: Path, read: list[Path]) -> None:
    """Notes the faults of a file and of those that it includes, before MuJoCo reads any of them."""
    read.append(path.resolve())
    if len(read) > _MOST_FILES:
        raise files.refuse(files.name(path), f"{len(read)} files", f"at most {_MOST_FILES}")
    try:
        root = files.elements(path)
    except (OSError, ExpatError) as exc:
        raise files.refuse(files.name(path), str(exc), "an XML file of MuJoCo") from exc
    if root.tag not in ("mujoco", "mujocoinclude"):
        raise files.refuse(files.name(path), f"<{root.tag}>", "a MuJoCo model: <mujoco>")
    folders = [path.parent]
    waiting = [root]
    elements: list[Element] = []
    while waiting:
        elements.append(waiting.pop())
        waiting += reversed(elements[-1].children)
    for element in elements:
        given = [element.get(name) for name in _FOLDERS if element.tag == "compiler" and element.get(name)]
        folders += [found for each in given if (found := files.find(each, path.parent, element.where))]
    for element in elements:
        _check_element(files, element, folders, read)


def _check_element(files: SourceFiles, element: Element, folders: list[Path], read: list[Path]) -> None:
    for name, text in element.attributes.items():
        if any(word.lower().lstrip("+-").startswith(("nan", "inf")) for word in text.split()) and name != "name":
            files.fault(f"{element.where}: {element.tag} {name}", text, "finite numbers")
    if element.tag in _MAKERS:
        files.fault(element.where, element.tag, "bodies and geoms that are written out, and no code")
    if element.tag == "hfield":
        files.fault(element.where, f"hfield {element.get('name')}", "no height field: a robot's floor is level here")
    for name in _FILES:
        given = element.get(name)
        found = [path for each in folders if given and (path := files.find(given, each, element.where))]
        if not given:
            continue
        if not found:
            files.fault(f"{element.where}: {element.tag} {name}", given, "a file in the folder of the model")
        elif element.tag == "include" and found[0].resolve() not in read:
            _check(files, found[0], read)
        elif element.tag != "include":
            files.read(found[0])


class _Compiled(NamedTuple):
    """A model in its initial pose, and the meshes of it that were looked at."""

    model: mujoco.MjModel
    data: mujoco.MjData
    meshes: dict[tuple[object, ...], TriangleMesh]


def _found(model: mujoco.MjModel, data: mujoco.MjData) -> Found:
    """Returns the parts of a compiled model in its initial pose."""
    found = Found()
    names: dict[int, str] = {}
    compiled = _Compiled(model, data, {})
    moving: list[str] = []
    for geom in range(model.ngeom):
        root = int(model.body_rootid[model.geom_bodyid[geom]])
        own = model.geom(geom).name or f"geom_{geom}"
        key = root or -geom - 1  # what lies in the world itself: each geom is a piece
        if key not in names:
            name = model.body(root).name or f"body_{root}" if root else own
            names[key] = unique(name, set(names.values()))
            found.models.append(
                Model(names[key], name, _pose(data.xpos[root], data.xmat[root]) if root else _at(data, geom))
            )
            if root and _moves(model, root):
                moving.append(names[key])
        _take(found, compiled, geom, Model(names[key], own, _at(data, geom)))
    for light in range(model.nlight):
        if int(model.light_type[light]) != int(mujoco.mjtLightType.mjLIGHT_DIRECTIONAL):
            x, y, z = data.light_xpos[light].tolist()
            found.lights.append((x, y, z))
    if moving:
        why = f"have joints in the source; what would move there stands still here ({', '.join(moving)})"
        found.note(f"{len(moving)} bodies", "approximated", why)
    return found


def _take(found: Found, compiled: _Compiled, geom: int, part: Model) -> None:
    """Takes one geom of a piece."""
    model, data, meshes = compiled
    subject = part.name if part.kind == part.name else f"{part.name}/{part.kind}"
    kind = int(model.geom_type[geom])
    if kind == int(mujoco.mjtGeom.mjGEOM_PLANE):
        level = abs(float(data.geom_xmat[geom][8])) > 0.999
        if level:
            found.planes_m.append(float(data.geom_xpos[geom][2]))
        else:
            found.note(subject, "dropped", "a plane without end that is not level")
        return
    if not (model.geom_contype[geom] or model.geom_conaffinity[geom]):
        found.note(subject, "dropped", "contype and conaffinity are 0: it is seen, and nothing meets it")
        return
    color = _color(model, geom)
    if kind == int(mujoco.mjtGeom.mjGEOM_MESH):
        number = int(model.geom_dataid[geom])
        if (number,) not in meshes:
            meshes[number,] = _mesh(model, number)
        found.parts.append(Placed(part.name, subject, "a mesh", meshes[number,], part.pose, color))
        return
    name, numbers = _SHAPES.get(kind, ("", ()))
    if not name:
        found.note(subject, "dropped", f"{shown(mujoco.mjtGeom(kind).name)}: a shape that Simyard does not know")
        return
    times = _GIVEN_HALF.get(name, (1.0, 1.0, 1.0))
    size = tuple(float(model.geom_size[geom][k]) * times[k] for k in numbers)
    if (name, *size) not in meshes:
        meshes[name, *size] = SHAPES[name](size)
    upright = (size[0], size[1]) if name == "cylinder" else None
    ball_m = size[0] if name == "sphere" else None
    found.parts.append(Placed(part.name, subject, f"a {name}", meshes[name, *size], part.pose, color, upright, ball_m))


def _moves(model: mujoco.MjModel, root: int) -> bool:
    bodies = np.flatnonzero(model.body_rootid == root)
    return bool(model.body_jntnum[bodies].any())


def _mesh(model: mujoco.MjModel, number: int) -> TriangleMesh:
    first, count = int(model.mesh_vertadr[number]), int(model.mesh_vertnum[number])
    face, faces = int(model.mesh_faceadr[number]), int(model.mesh_facenum[number])
    points = np.array(model.mesh_vert[first : first + count], dtype=np.float64)
    return TriangleMesh(points, np.array(model.mesh_face[face : face + faces], dtype=np.int64))


def _color(model: mujoco.MjModel, geom: int) -> Color:
    material = int(model.geom_matid[geom])
    rgba = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
    red, green, blue = (round(min(max(float(each), 0.0), 1.0), 6) for each in rgba[:3])
    return red, green, blue


def _at(data: mujoco.MjData, geom: int) -> Pose:
    return _pose(data.geom_xpos[geom], data.geom_xmat[geom])


def _pose(position: np.ndarray, turn: np.ndarray) -> Pose:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.array(turn).reshape(3, 3), position
    return pose
