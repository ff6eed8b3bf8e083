"""COLLADA (1.4 and 1.5) as triangles: the scene's geometries where its nodes put them, in metres.

Corresponds to Gazebo's ``ColladaLoader``: the asset's unit is applied, its up axis only on request (gazebo-classic
issue 1305), and a submesh is called as the node that holds it. Curves, animations and textures are left.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from specs.data.world import Color
from tasks.worlds.importer.source_files import Element

Pose = Float[np.ndarray, "4 4"]
TURN_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Turns what has its y axis up."""
_MOST_INSTANCES = 10_000
_DEEPEST = 64
_SHADERS = ("phong", "lambert", "blinn", "constant")
_FILLED = ("triangles", "polylist", "polygons", "trifans", "tristrips")


class Part(NamedTuple):
    """The triangles of one geometry in a scene that have one material.

    Attributes:
        name: What holds it in the file: for a submesh.
        points: Corners (metres).
        faces: Triangles, as indices of corners.
        color: What the file says of its colour.
    """

    name: str
    points: Float[np.ndarray, "points 3"]
    faces: Int[np.ndarray, "faces 3"]
    color: Color | None = None


def read_collada(root: Element, *, upright: bool) -> list[Part]:
    """Returns the parts of a COLLADA document.

    Args:
        root: Its outermost element.
        upright: Whether parts are turned so that its up axis points up; Gazebo leaves them.

    Raises:
        ValueError: It is none, or does not hold what it refers to.
    """
    if root.tag != "COLLADA":
        raise ValueError(f"begins with {root.tag}, not with COLLADA")
    document = _Document(root)
    turn = TURN_UP if upright and root.said("asset/up_axis") == "Y_UP" else np.eye(3)
    return [part._replace(points=part.points @ turn.T) for part in document.parts()]


class _Document:
    def __init__(self, root: Element) -> None:
        self._root = root
        # Exporters give a scene and its node the same id.
        self._by_id = {(each.tag, each.get("id")): each for each in _all(root) if each.get("id")}
        unit = root.first("asset/unit")
        self._metres = _numbers(unit.get("meter"))[0] if unit and unit.get("meter") else 1.0
        self._instances = 0

    def parts(self) -> Iterator[Part]:
        scene = self._root.first("scene/instance_visual_scene")
        if scene is None:
            for geometry in self._geometries():
                yield from self._placed(geometry, np.eye(4), geometry.get("name"), {})
            return
        for node in self._of(scene, "url", "visual_scene").all("node"):
            yield from self._node(node, np.eye(4), 0)

    def _geometries(self) -> list[Element]:
        return [each for library in self._root.all("library_geometries") for each in library.all("geometry")]

    def _of(self, element: Element, name: str, *tags: str) -> Element:
        """Returns what an attribute refers to.

        Raises:
            ValueError: It is not there.
        """
        found = self._known(element, name, *tags)
        if found is None:
            raise ValueError(f"{element.tag} refers to {element.get(name)!r}, which is not there")
        return found

    def _known(self, element: Element, name: str, *tags: str) -> Element | None:
        key = element.get(name).removeprefix("#")
        return next((self._by_id[tag, key] for tag in tags if (tag, key) in self._by_id), None)

    def _node(self, node: Element, above: Pose, depth: int) -> Iterator[Part]:
        self._instances += 1
        if depth > _DEEPEST or self._instances > _MOST_INSTANCES:
            raise ValueError(f"more than {_MOST_INSTANCES:,} nodes, or {_DEEPEST} of them inside each other")
        here = above @ _placement(node)
        name = node.get("name") or node.get("id")
        for child in node.children:
            if child.tag == "node":
                yield from self._node(child, here, depth + 1)
            elif child.tag == "instance_node":
                yield from self._node(self._of(child, "url", "node"), here, depth + 1)
            elif child.tag == "instance_geometry":
                yield from self._placed(self._of(child, "url", "geometry"), here, name, self._colors(child))
            elif child.tag == "instance_controller":
                yield from self._skin(child, here, name)

    def _skin(self, child: Element, here: Pose, name: str) -> Iterator[Part]:
        skin = self._of(child, "url", "controller").first("skin")
        if skin is not None:
            bound = skin.said("bind_shape_matrix")
            shape = _numbers(bound).reshape(4, 4) if bound else np.eye(4)
            yield from self._placed(self._of(skin, "source", "geometry"), here @ shape, name, self._colors(child))

    def _colors(self, instance: Element) -> Mapping[str, Color]:
        """Returns the colours of an instance's materials, by the symbols that its triangles use."""
        bound = instance.first("bind_material/technique_common")
        found: dict[str, Color] = {}
        for material in bound.all("instance_material") if bound else ():
            color = self._color(self._known(material, "target", "material"))
            if color:
                found[material.get("symbol")] = color
        return found

    def _color(self, material: Element | None) -> Color | None:
        effect = material.first("instance_effect") if material else None
        known = self._known(effect, "url", "effect") if effect else None
        technique = known.first("profile_COMMON/technique") if known else None
        for shader in technique.all(*_SHADERS) if technique else ():
            said = shader.said("diffuse/color")
            if said:
                red, green, blue = np.clip(_numbers(said)[:3], 0.0, 1.0).tolist()
                return red, green, blue
        return None

    def _placed(self, geometry: Element, at: Pose, name: str, colors: Mapping[str, Color]) -> Iterator[Part]:
        mesh = geometry.first("mesh")
        for primitive in mesh.all(*_FILLED) if mesh else ():
            points = self._positions(primitive) @ at[:3, :3].T + at[:3, 3]
            faces = _triangles(primitive)
            if len(faces) and (faces.min() < 0 or faces.max() >= len(points)):
                raise ValueError(f"{primitive.where}: {primitive.tag} names corners that are not there")
            if np.linalg.det(at[:3, :3]) < 0:
                faces = faces[:, ::-1]
            yield Part(name, points * self._metres, faces, colors.get(primitive.get("material")))

    def _positions(self, primitive: Element) -> Float[np.ndarray, "points 3"]:
        for vertex in primitive.all("input"):
            if vertex.get("semantic") == "VERTEX":
                for position in self._of(vertex, "source", "vertices").all("input"):
                    if position.get("semantic") == "POSITION":
                        return self._source(self._of(position, "source", "source"))
        raise ValueError(f"{primitive.where}: {primitive.tag} has no positions")

    def _source(self, source: Element) -> Float[np.ndarray, "points 3"]:
        values = _numbers(source.said("float_array"))
        accessor = source.first("technique_common/accessor")
        stride = max(int(accessor.get("stride") or 3) if accessor else 3, 3)
        return values[: len(values) // stride * stride].reshape(-1, stride)[:, :3]


def _all(root: Element) -> Iterator[Element]:
    waiting = [root]
    while waiting:
        element = waiting.pop()
        yield element
        waiting += element.children


def _numbers(text: str) -> Float[np.ndarray, "numbers"]:
    return np.array(text.split(), dtype=np.float64)


def _placement(node: Element) -> Pose:
    """Returns where a node puts what is in it: its transformations in their order."""
    pose = np.eye(4)
    for child in node.all("matrix", "translate", "rotate", "scale"):
        values = _numbers(child.text)
        step = np.eye(4)
        if child.tag == "matrix":
            step = values.reshape(4, 4)
        elif child.tag == "translate":
            step[:3, 3] = values
        elif child.tag == "scale":
            step[:3, :3] = np.diag(values)
        else:
            step[:3, :3] = _turn(values[:3], float(np.radians(values[3])))
        pose = pose @ step
    return pose


def _turn(axis: Float[np.ndarray, "3"], angle_rad: float) -> Float[np.ndarray, "3 3"]:
    """Returns a turn about an axis (Rodrigues)."""
    x, y, z = axis / max(float(np.linalg.norm(axis)), 1e-12)
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle_rad) * across + (1.0 - np.cos(angle_rad)) * across @ across


def _triangles(primitive: Element) -> Int[np.ndarray, "faces 3"]:
    """Returns the triangles of a primitive, as indices of its positions."""
    inputs = [(each.get("semantic"), int(each.get("offset") or 0)) for each in primitive.all("input")]
    stride = max(offset for _, offset in inputs) + 1
    offset = next(offset for semantic, offset in inputs if semantic == "VERTEX")
    runs = [np.array(each.text.split(), dtype=np.int64)[offset::stride] for each in primitive.all("p")]
    runs += [
        np.array(each.said("p").split(), dtype=np.int64)[offset::stride] for each in primitive.all("ph")
    ]  # a polygon with holes: its outer ring
    if primitive.tag == "triangles":
        return np.concatenate([run[: len(run) // 3 * 3] for run in runs] or [np.zeros(0, np.int64)]).reshape(-1, 3)
    if primitive.tag == "polylist":
        counts = np.array(primitive.said("vcount").split(), dtype=np.int64)
        ends = np.cumsum(counts)
        if not len(runs) or (len(ends) and (ends[-1] > len(runs[0]) or counts.min() < 0)):
            raise ValueError(f"{primitive.where}: polylist counts more corners than it names")
        runs = np.split(runs[0], ends)[:-1]
    strip = primitive.tag == "tristrips"
    return np.concatenate([*map(_strip if strip else _fan, runs), np.zeros((0, 3), np.int64)])


def _fan(run: Int[np.ndarray, "corners"]) -> Int[np.ndarray, "faces 3"]:
    return np.stack([np.full(max(len(run) - 2, 0), run[0] if len(run) else 0), run[1:-1], run[2:]], axis=1)


def _strip(run: Int[np.ndarray, "corners"]) -> Int[np.ndarray, "faces 3"]:
    faces = np.stack([run[:-2], run[1:-1], run[2:]], axis=1)
    faces[1::2] = faces[1::2, ::-1]
    return faces
