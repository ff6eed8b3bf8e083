"""Meshes as triangles in metres: from COLLADA, STL, OBJ, GLB and PLY, and of the simple shapes that may lie askew."""

import io
import math
import struct
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple
from xml.parsers.expat import ExpatError

import numpy as np
import shapely
import trimesh
from jaxtyping import Float
from scipy.spatial import ConvexHull
from trimesh.visual import ColorVisuals

from specs.data.world import Color
from tasks.worlds.importer.collada import TURN_UP, Part, read_collada
from tasks.worlds.importer.mesh_sections import Faces, Points
from tasks.worlds.importer.source_files import SourceFiles, shown

Pose = Float[np.ndarray, "4 4"]
MESH_SUFFIXES = (".dae", ".glb", ".obj", ".ply", ".stl")
_MOST_TRIANGLES = 2_000_000
_LARGEST_M = 1e5
_SIDES = 32
_UNREADABLE = (ValueError, KeyError, IndexError, TypeError, AttributeError, NotImplementedError, OSError, EOFError,
    struct.error, ExpatError, ArithmeticError, AssertionError, MemoryError, RecursionError)  # fmt: skip
"""What readers of meshes raise of bytes that are none."""


class MeshUnreadable(Exception):  # noqa: N818 - a state
    """A file holds no mesh that can be used; says why. It is told as a finding, and leaves this package never."""


class TriangleMesh(NamedTuple):
    """Triangles.

    Attributes:
        points: Corners (metres).
        faces: Indices of corners, counter-clockwise as seen from outside.
        color: What the file says of its colour.
    """

    points: Points
    faces: Faces
    color: Color | None = None


def mesh_parts(files: SourceFiles, path: Path, *, upright: bool) -> list[Part]:
    """Returns the parts of a mesh's file, at least one.

    Args:
        files: The files of the source.
        path: Which of them.
        upright: Whether a COLLADA file whose y axis points up is turned. Gazebo does not; GLB always points so.

    Raises:
        MeshUnreadable: It is no mesh, or has no triangles.
        SourceError: It is too large, or its XML declares what it must not.
    """
    suffix = path.suffix.lower()
    if suffix not in MESH_SUFFIXES:
        raise MeshUnreadable(f"is no {', '.join(each[1:] for each in MESH_SUFFIXES)}")
    try:
        if suffix == ".dae":
            parts = read_collada(files.elements(path), upright=upright)
        else:
            parts = _parts(files.read(path), suffix[1:])
    except _UNREADABLE as exc:
        raise MeshUnreadable(f"cannot be read: {shown(f'{type(exc).__name__}: {exc}')}") from exc
    parts = [_turned(part) if suffix == ".glb" else part for part in parts if len(part.faces)]
    if not parts:
        raise MeshUnreadable("has no triangles")
    return parts


def read_mesh_file(files: SourceFiles, path: Path, submesh: str = "") -> TriangleMesh:
    """Returns the triangles of a mesh's file, or of one of its submeshes, as Gazebo places them.

    Raises:
        MeshUnreadable: It is no mesh, or has no triangles.
        SourceError: It is too large, or its XML declares what it must not.
    """
    parts = mesh_parts(files, path, upright=False)
    chosen = [part for part in parts if part.name == submesh] if submesh else parts
    if not chosen:
        names = ", ".join(sorted({part.name for part in parts})[:8])
        raise MeshUnreadable(f"has no submesh {shown(submesh)!r}; it has {shown(names)}")
    return joined(chosen)


def _turned(part: Part) -> Part:
    """Returns a part whose y axis points up with its z axis up."""
    return part._replace(points=part.points @ TURN_UP.T)


def joined(parts: Sequence[Part]) -> TriangleMesh:
    """Returns parts as one mesh.

    Raises:
        MeshUnreadable: It has too many triangles, or corners that are no places.
    """
    starts = np.cumsum([0, *[len(part.points) for part in parts]])
    points = np.concatenate([part.points for part in parts])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, starts[:-1], strict=True)])
    if len(faces) > _MOST_TRIANGLES:
        raise MeshUnreadable(f"has {len(faces):,} triangles; {_MOST_TRIANGLES:,} may be: simplify it")
    used = points[np.unique(faces)]
    if not np.isfinite(used).all() or np.abs(used).max() > _LARGEST_M:
        raise MeshUnreadable(f"has corners that are no numbers, or further away than {_LARGEST_M:,.0f} m")
    largest = max(parts, key=lambda part: len(part.faces))
    return TriangleMesh(points, faces, largest.color)


# Readers take what a header says for true: a file with fewer bytes than that is refused before.
def _parts(data: bytes, kind: str) -> list[Part]:
    """Returns the parts of a file's bytes; without a resolver trimesh reads no other file."""
    scene = trimesh.load_scene(io.BytesIO(data), file_type=kind, process=False, maintain_order=True)
    parts: list[Part] = []
    for node in scene.graph.nodes_geometry:
        pose, name = scene.graph[node]
        mesh = scene.geometry[name]
        if isinstance(mesh, trimesh.Trimesh):
            points = np.asarray(mesh.vertices) @ pose[:3, :3].T + pose[:3, 3]
            faces = np.asarray(mesh.faces, dtype=np.int64)
            faces = faces[:, ::-1] if np.linalg.det(pose[:3, :3]) < 0 else faces
            parts.append(Part(str(name), points, faces, _color(mesh)))
    return parts


def _color(mesh: trimesh.Trimesh) -> Color | None:
    material = getattr(mesh.visual, "material", None)
    color = getattr(material, "baseColorFactor", None)
    if color is None and isinstance(mesh.visual, ColorVisuals) and mesh.visual.defined:
        color = mesh.visual.main_color
    if color is None:
        return None
    red, green, blue = (round(int(each) / 255, 6) for each in np.asarray(color)[:3])
    return red, green, blue


def centered(mesh: TriangleMesh) -> TriangleMesh:
    """Returns a mesh with the middle of its box at the origin, as a submesh with ``center`` has it."""
    used = mesh.points[np.unique(mesh.faces)]
    return mesh._replace(points=mesh.points - (used.min(axis=0) + used.max(axis=0)) / 2)


def hull(mesh: TriangleMesh) -> TriangleMesh:
    """Returns the convex hull of a mesh; itself, if it is flat."""
    used = mesh.points[np.unique(mesh.faces)]
    if np.linalg.matrix_rank(used - used[0], tol=1e-6) < 3:
        return mesh
    found = ConvexHull(used)
    corners = used[found.simplices]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inwards = (normal * found.equations[:, :3]).sum(axis=1) < 0
    faces = np.where(inwards[:, None], found.simplices[:, ::-1], found.simplices).astype(np.int64)
    return TriangleMesh(used, faces, mesh.color)


def box(size: Sequence[float]) -> TriangleMesh:
    """Returns a box about the origin.

    Args:
        size: Extents along x, y and z.
    """
    half_x, half_y, half_z = (each / 2 for each in size)
    return extruded([[(-half_x, -half_y), (half_x, -half_y), (half_x, half_y), (-half_x, half_y)]], -half_z, half_z)


def extruded(rings: Sequence[Sequence[tuple[float, float]]], low: float, high: float) -> TriangleMesh:
    """Returns the upright solid that rings enclose by the even-odd rule, between two heights."""
    area = shapely.Polygon()
    for ring in rings:
        area = area.symmetric_difference(shapely.Polygon(ring).buffer(0.0))
    flat = [
        shapely.get_coordinates(each)[:3] for each in shapely.get_parts(shapely.constrained_delaunay_triangles(area))
    ]
    if not flat:
        raise MeshUnreadable("encloses nothing")
    caps = np.array([ring if _area(ring) > 0 else ring[::-1] for ring in flat])
    level = np.zeros((len(caps), 3, 1))
    corners = [np.concatenate([caps, level + high], axis=2), np.concatenate([caps, level + low], axis=2)[:, ::-1]]
    for ring in (
        each for part in shapely.get_parts(shapely.normalize(area)) for each in (part.exterior, *part.interiors)
    ):
        xy = shapely.get_coordinates(ring)[::-1]  # as polygons are normal: now the inside is to the left
        a, b = xy[:-1], xy[1:]
        bottom, top = np.full((len(a), 1), low), np.full((len(a), 1), high)
        a0, b0, b1, a1 = (np.concatenate(each, axis=1) for each in ((a, bottom), (b, bottom), (b, top), (a, top)))
        corners += [np.stack([a0, b0, b1], axis=1), np.stack([a0, b1, a1], axis=1)]
    points = np.concatenate(corners).reshape(-1, 3)
    return TriangleMesh(points, np.arange(len(points)).reshape(-1, 3))


def _area(ring: Float[np.ndarray, "3 2"]) -> float:
    (ax, ay), (bx, by), (cx, cy) = ring.tolist()
    return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)


def revolved(profile: Sequence[tuple[float, float]]) -> TriangleMesh:
    """Returns the solid that a profile makes when it turns about z.

    Args:
        profile: Radius and height of each point, from the lowest; the ends are closed.
    """
    angles = np.linspace(0.0, math.tau, _SIDES, endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    rings = [np.concatenate([circle * radius, np.full((_SIDES, 1), z)], axis=1) for radius, z in profile]
    ends = np.array([[0.0, 0.0, profile[0][1]], [0.0, 0.0, profile[-1][1]]])
    points = np.concatenate([*rings, ends])
    here = np.arange(_SIDES)
    after = (here + 1) % _SIDES
    last = (len(profile) - 1) * _SIDES
    faces = [np.stack([np.full(_SIDES, len(points) - 2), after, here], axis=1)]
    for start in range(0, last, _SIDES):
        a, b, c, d = start + here, start + after, start + _SIDES + after, start + _SIDES + here
        faces += [np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]
    faces.append(np.stack([np.full(_SIDES, len(points) - 1), last + here, last + after], axis=1))
    return TriangleMesh(points, np.concatenate(faces).astype(np.int64))


def _arc(radius: float, middle: float, first: float, last: float) -> list[tuple[float, float]]:
    steps = np.linspace(first, last, _SIDES // 4 + 1)
    return [(radius * float(np.cos(each)), middle + radius * float(np.sin(each))) for each in steps]


def _round(size: Sequence[float]) -> TriangleMesh:
    radius, length = size
    low = _arc(radius, -length / 2, -math.pi / 2, 0.0)
    return revolved([*low, *_arc(radius, length / 2, 0.0, math.pi / 2)])


def _ellipsoid(size: Sequence[float]) -> TriangleMesh:
    ball = revolved(_arc(1.0, 0.0, -math.pi / 2, math.pi / 2))
    return ball._replace(points=ball.points * np.asarray(size))


SHAPES: Mapping[str, Callable[[Sequence[float]], TriangleMesh]] = {
    "box": box,
    "cylinder": lambda size: revolved([(size[0], -size[1] / 2), (size[0], size[1] / 2)]),
    "cone": lambda size: revolved([(size[0], -size[1] / 2), (0.0, size[1] / 2)]),
    "sphere": lambda size: _ellipsoid((size[0],) * 3),
    "capsule": _round,
    "ellipsoid": _ellipsoid,
}
"""Shapes by SDF's names; their sizes are extents, or a radius and a length, or radii."""
