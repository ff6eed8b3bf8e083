"""Gazebo's worlds: SDF 1.4 to 1.11 as placed parts, without Gazebo.

Corresponds to the specification of SDFormat and to what libsdformat makes of it: includes and models within models,
frames with ``relative_to``, ``attached_to`` and ``placement_frame`` (SDF 1.7 and later; before, ``frame``), and
includes that override a name, a pose or ``static``.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple
from xml.parsers.expat import ExpatError

import numpy as np

from specs.data.world import MOST_WALK_PLACES, Color, RecordedWalk
from tasks.worlds.geometry import rounded
from tasks.worlds.importer.placed_parts import Found, Model, Placed, scene_of, unique
from tasks.worlds.importer.source_files import Element, SourceFiles, shown
from tasks.worlds.importer.source_scene import Scene
from tasks.worlds.importer.triangle_mesh import (
    SHAPES,
    MeshUnreadable,
    Pose,
    TriangleMesh,
    centered,
    extruded,
    hull,
    read_mesh_file,
)
from tasks.worlds.importer.upright_solids import TOLERANCE_M

_OLDEST, _NEWEST = (1, 4), (1, 11)
# Models that every installation of Gazebo has; worlds of RoboMaker's samples are often nothing but these two.
_GROUND_PLANE = "model://ground_plane"
_BUILT_IN = frozenset({"model://sun", _GROUND_PLANE})
_MOST_MODELS = 20_000
_DEEPEST = 30
_LARGEST = 1e9
_SIZES: Mapping[str, tuple[tuple[str, int], ...]] = {
    "box": (("size", 3),),
    "cylinder": (("radius", 1), ("length", 1)),
    "cone": (("radius", 1), ("length", 1)),
    "capsule": (("radius", 1), ("length", 1)),
    "sphere": (("radius", 1),),
    "ellipsoid": (("radii", 3),),
}
_DROPPED = {
    "population": "models that Gazebo would spread at random; name each of them",
    "road": "a road is paint on the floor",
    "plugin": "code of a simulator, which is not run here",
}
_TRUE, _FALSE = ("1", "true"), ("0", "false")
_COLORS: Mapping[str, Color] = {
    "Gazebo/Black": (0.1, 0.1, 0.1),
    "Gazebo/Blue": (0.1, 0.1, 0.8),
    "Gazebo/DarkGrey": (0.3, 0.3, 0.3),
    "Gazebo/Green": (0.1, 0.7, 0.1),
    "Gazebo/Grey": (0.5, 0.5, 0.5),
    "Gazebo/Orange": (1.0, 0.5, 0.1),
    "Gazebo/Red": (0.8, 0.1, 0.1),
    "Gazebo/White": (0.95, 0.95, 0.95),
    "Gazebo/Wood": (0.6, 0.45, 0.28),
    "Gazebo/Yellow": (0.9, 0.85, 0.1),
}


def read_sdf(
    path: Path,
    model_folders: Sequence[Path] = (),
    start: tuple[float, float] | None = None,
    tolerance_m: float = TOLERANCE_M,
) -> Scene:
    """Returns the scene of a Gazebo world.

    Args:
        path: The world, or a model.
        model_folders: Where ``model://`` and its like are looked for, before the folders beside the world.
        start: Where a robot starts: on the floor, where there are several.
        tolerance_m: How far surfaces may move.

    Raises:
        SourceError: It is none, with all that is wrong with it, or nothing in it could be found.
    """
    files = SourceFiles(path, model_folders)
    reader = _Reader(files)
    reader.read(path)
    return scene_of(reader.found, files, start, tolerance_m)


@dataclass
class _Frame:
    """Where something stands in a model or the world.

    Attributes:
        pose: As it is written.
        base: The name of what that is relative to; empty for the model or the world itself.
        inner: What is in it, where it is a model.
    """

    pose: Pose
    base: str
    inner: "_Scope | None" = None


@dataclass
class _Scope:
    """The names of a model or the world, and where they are in it."""

    where: str
    frames: dict[str, _Frame] = field(default_factory=dict)

    def pose(self, name: str, reader: "_Reader", chain: tuple[str, ...] = ()) -> Pose:
        """Returns the pose of a frame in the model, or of one of a model in it (``arm::hand``)."""
        if name in ("", "__model__", "world"):
            return np.eye(4)
        outer, _, inner = name.partition("::")
        frame = self.frames.get(outer)
        if frame is None:
            reader.files.fault(self.where, name, "the name of a frame, link, joint or model in the same model")
            return np.eye(4)
        if name in chain:
            reader.files.fault(self.where, " -> ".join((*chain, name)), "frames that are not relative to themselves")
            return np.eye(4)
        here = self.pose(frame.base, reader, (*chain, name)) @ frame.pose
        return here @ frame.inner.pose(inner, reader) if inner and frame.inner else here


class _Spot(NamedTuple):
    """Where a collision stands, and what it belongs to."""

    piece: str
    subject: str
    pose: Pose
    color: Color | None


@dataclass
class _Body:
    """A model as it is written, wherever it stands.

    Attributes:
        element: The model.
        kind: What it is a copy of.
        folder: Where its relative addresses begin.
        scope: The names in it.
        inner: The models in it: each with its name and whether its include says that it is static.
    """

    element: Element
    kind: str
    folder: Path
    scope: _Scope
    inner: "list[tuple[str, _Body, str]]" = field(default_factory=list)


class _Reader:
    def __init__(self, files: SourceFiles) -> None:
        self.files, self.found = files, Found()
        self._meshes: dict[tuple[Path, str, bool, bool], TriangleMesh | str] = {}
        self._scaled: dict[tuple[object, ...], TriangleMesh] = {}
        self._roots: dict[Path, Element] = {}
        self._bodies = 0
        self._emitted = 0
        self._moves: list[str] = []
        self._missing: dict[str, list[str]] = {}
        self._plugins: dict[str, int] = {}

    def read(self, path: Path) -> None:
        root = self._open(path)
        if root is None:
            raise self.files.refuse(path.name, self.found.findings[-1].why, "an XML file")
        world = root.first("world")
        holder = world or root
        if root.tag != "sdf" or (world is None and root.first("model") is None):
            raise self.files.refuse(
                path.name, f"<{root.tag}>", "a Gazebo world: <sdf version=...> with a <world> or <model>"
            )
        scope = _Scope(holder.where)
        placed: list[tuple[str, _Body, str]] = []
        for child in holder.children:
            self._top(child, path, scope, placed)
        for name, body, static in placed:
            self._model(name, body, scope.pose(name, self), static)
        self._lights(holder, np.eye(4))
        self._tell()

    def _open(self, path: Path) -> Element | None:
        """Returns the outermost element of a file; None, with a finding, where it is no XML."""
        if path not in self._roots:
            try:
                root = self.files.elements(path)
            except (OSError, ExpatError) as exc:
                self.found.note(self.files.name(path), "unresolved", f"cannot be read: {shown(str(exc))}")
                return None
            self._check_version(root)
            self._roots[path] = root
        return self._roots[path]

    def _check_version(self, root: Element) -> None:
        parts = root.get("version").split(".")
        version = tuple(int(part) for part in parts[:2]) if all(part.isdigit() for part in parts) else ()
        if root.tag == "sdf" and not (_OLDEST <= version <= _NEWEST):
            self.files.fault(root.where, f"version {root.get('version')!r}", "SDF 1.4 to 1.11")

    def _top(self, child: Element, path: Path, scope: _Scope, placed: list[tuple[str, _Body, str]]) -> None:
        """Takes one element of the world: a model to place, or something that is left out."""
        if child.tag in ("model", "include"):
            self._child(child, path.parent, scope, placed, (path.resolve(),))
        elif child.tag == "frame":
            self._frame(child, scope)
        elif child.tag == "plugin":
            self._plugin(child)
        elif child.tag == "actor":
            self._actor(child)
        elif child.tag in _DROPPED:
            self.found.note(f"{child.tag} {child.get('name')}".strip(), "dropped", _DROPPED[child.tag])

    def _plugin(self, element: Element) -> None:
        name = element.get("filename") or element.get("name")
        self._plugins[name] = self._plugins.get(name, 0) + 1

    def _actor(self, actor: Element) -> None:
        """Takes the trajectories of an actor, one after the other, as the walk of a person."""
        name = unique(actor.get("name") or "actor", {each.name for each in self.found.walks})
        script, at_s = actor.first("script"), dict[float, tuple[float, float]]()
        delay = script.first("delay_start") if script else None
        (wait_s,) = (self._numbers(delay, 1) if delay else None) or [0.0]
        for trajectory in script.all("trajectory") if script else ():
            since_s, own = max(at_s, default=max(wait_s, 0.0)), dict[float, tuple[float, float]]()
            for each in trajectory.all("waypoint"):
                time, pose = each.first("time"), each.first("pose")
                found = (self._numbers(time, 1), self._numbers(pose, 6)) if time and pose else (None, None)
                if found[0] and found[1] and found[0][0] >= 0.0:
                    own[rounded(since_s + found[0][0])] = (rounded(found[1][0]), rounded(found[1][1]))
            at_s |= dict(sorted(own.items())[:MOST_WALK_PLACES])
        if script is None or not at_s or len(at_s) > MOST_WALK_PLACES or script.said("auto_start") in _FALSE:
            why = f"has no trajectory of 1 to {MOST_WALK_PLACES:,} waypoints that it starts by itself"
            self.found.note(f"actor {name}", "dropped", why)
            return
        period_s = None if script.said("loop") in _FALSE else max(at_s)
        walk = RecordedWalk(name=name, times_s=tuple(at_s), points_m=tuple(at_s.values()), period_s=period_s or None)
        self.found.walks.append(walk)
        why = "becomes a walk: people of model recorded go straight from waypoint to waypoint, as upright cylinders"
        self.found.note(f"actor {name}", "approximated", why)

    # Models and includes, into the scope of what holds them.

    def _child(
        self, child: Element, folder: Path, scope: _Scope, into: list[tuple[str, _Body, str]], chain: tuple[Path, ...]
    ) -> None:
        """Reads a model or an include, and notes where it stands."""
        self._bodies += 1
        if self._bodies > _MOST_MODELS or len(chain) > _DEEPEST:
            allowed = f"at most {_MOST_MODELS:,} models, and {_DEEPEST} inside each other"
            raise self.files.refuse(child.where, f"one model more than {self._bodies - 1:,}", allowed)
        if child.tag == "model":
            body = self._body(child, folder, child.get("name"), chain)
            self._place(child.get("name"), body, child, child.get("placement_frame"), scope)
            into.append((self._last, body, ""))
            return
        found = self._included(child, folder, chain)
        if found is None:
            return
        body, own = found
        overrides = child if child.first("pose") else own
        placement = child.said("placement_frame") or own.get("placement_frame")
        self._place(child.said("name") or own.get("name"), body, overrides, placement, scope)
        into.append((self._last, body, child.said("static")))

    def _place(self, name: str, body: _Body, posed: Element, placement: str, scope: _Scope) -> None:
        """Puts a model into a scope; its placement frame stands where its pose says."""
        pose, base = self._pose(posed)
        if placement:
            pose = pose @ np.linalg.inv(body.scope.pose(placement, self))
        self._last = unique(name or "model", scope.frames)
        scope.frames[self._last] = _Frame(pose, base, body.scope)

    def _included(self, include: Element, folder: Path, chain: tuple[Path, ...]) -> tuple[_Body, Element] | None:
        address = include.said("uri")
        found = self.files.find(address, folder, include.where)
        path = self._sdf_in(found) if found is not None and found.is_dir() else found
        if path is None or not path.is_file():
            if address in _BUILT_IN:
                self._built_in(address, include)
                return None
            self._missing.setdefault(address, []).append(include.said("name") or include.where)
            return None
        if path.resolve() in chain:
            cycle = " -> ".join(self.files.name(each) for each in (*chain, path))
            self.files.fault(include.where, cycle, "models that do not include themselves")
            return None
        root = self._open(path)
        model = root.first("model") if root else None
        if root is None:
            return None
        if model is None:
            self._lights(root, self._pose(include)[0] if include.first("pose") else np.eye(4))
            if root.first("light") is None:
                self.found.note(address, "dropped", f"{self.files.name(path)} has no model")
            return None
        return self._body(model, path.parent, _kind(found or path, model), (*chain, path.resolve())), model

    def _built_in(self, address: str, include: Element) -> None:
        """Takes what Gazebo brings along: its sun shines from no place, and its plane has no end."""
        if address == _GROUND_PLANE:
            pose = self._pose(include)[0] if include.first("pose") else np.eye(4)
            self.found.planes_m.append(float(pose[2, 3]))

    def _sdf_in(self, folder: Path) -> Path | None:
        """Returns the newest SDF that a model's ``model.config`` names; ``model.sdf`` if it names none."""
        config, best = folder / "model.config", ((-1,), "model.sdf")
        if config.is_file() and self.files.find(config.name, folder, self.files.name(config)):
            root = self._open(config)
            for each in root.all("sdf") if root else ():
                version = tuple(int(part) for part in each.get("version").split(".") if part.isdigit())
                best = max(best, (version or (0,), each.text.strip())) if version <= _NEWEST else best
        return self.files.find(best[1], folder, self.files.name(config))

    def _body(self, element: Element, folder: Path, kind: str, chain: tuple[Path, ...]) -> _Body:
        """Returns a model with the names in it."""
        body = _Body(element, kind, folder, _Scope(f"{element.where}: model {element.get('name')}"))
        for child in element.children:
            if child.tag in ("model", "include"):
                self._child(child, folder, body.scope, body.inner, chain)
            elif child.tag == "frame":
                self._frame(child, body.scope)
            elif child.tag == "link":
                body.scope.frames[child.get("name")] = _Frame(*self._pose(child))
            elif child.tag == "joint":
                pose, base = self._pose(child)
                body.scope.frames.setdefault(child.get("name"), _Frame(pose, base or child.said("child")))
            elif child.tag == "plugin":
                self._plugin(child)
        if len(body.inner) == 1 and element.first("link") is None:
            body.kind = body.inner[0][1].kind  # a model that only names another one
        return body

    def _frame(self, element: Element, scope: _Scope) -> None:
        pose, base = self._pose(element)
        scope.frames[element.get("name")] = _Frame(pose, base or element.get("attached_to"))

    # Where things stand.

    def _pose(self, element: Element) -> tuple[Pose, str]:
        """Returns the pose that is written in an element, and what it is relative to."""
        pose = element.first("pose")
        if pose is None:
            return np.eye(4), ""
        base = pose.get("relative_to") or pose.get("frame")
        quaternion = pose.get("rotation_format") == "quat_xyzw"
        numbers = self._numbers(pose, 7 if quaternion else 6) if pose.text.strip() else None
        if numbers is None:
            return np.eye(4), base
        if quaternion:
            return _quaternion_pose(numbers), base
        turn = [math.radians(each) for each in numbers[3:]] if pose.get("degrees") in _TRUE else numbers[3:]
        return _euler_pose(numbers[:3], turn), base

    def _numbers(self, element: Element, count: int, *, positive: bool = False) -> list[float] | None:
        """Returns the numbers in an element; None, with a fault, where there are others."""
        try:
            found = [float(part) for part in element.text.split()]
        except ValueError:
            found = []
        fine = all(math.isfinite(each) and abs(each) <= _LARGEST and (each > 0 or not positive) for each in found)
        if len(found) != count or not fine:
            what = f"{count} number{'s' if count > 1 else ''}{' above 0' if positive else ''}"
            allowed = f"{what}, each at most {_LARGEST:,.0f}"
            self.files.fault(f"{element.where}: {element.tag}", element.text, allowed)
            return None
        return found

    # What is in the models.

    def _model(self, name: str, body: _Body, pose: Pose, static: str) -> None:
        """Takes all parts of a model of the world as one piece."""
        name = unique(name, {each.name for each in self.found.models})
        self.found.models.append(Model(name, body.kind or name, pose))
        if not self._parts(name, name, body, pose, static, static=False):
            self._moves.append(name)

    def _parts(self, piece: str, subject: str, body: _Body, pose: Pose, said: str, *, static: bool) -> bool:
        """Takes the parts of a model and of those in it; returns whether all stand still in the source, too."""
        self._emitted += 1
        if self._emitted > _MOST_MODELS:
            raise self.files.refuse(body.element.where, "another model", f"at most {_MOST_MODELS:,} models")
        static = static or (said or body.element.said("static")).lower() in _TRUE
        still = static or not any(True for _ in body.element.all("link"))
        for link in body.element.all("link"):
            self._link(piece, f"{subject}/{link.get('name')}", link, body, pose)
        for name, inner, inner_said in body.inner:
            here = pose @ body.scope.pose(name, self)
            still &= self._parts(piece, f"{subject}/{name}", inner, here, inner_said, static=static)
        return still

    def _link(self, piece: str, subject: str, link: Element, body: _Body, pose: Pose) -> None:
        here = pose @ body.scope.pose(link.get("name"), self)
        self._lights(link, here)
        collisions = list(link.all("collision"))
        visuals = list(link.all("visual"))
        if visuals and not collisions:
            self.found.note(subject, "dropped", "has no collision: it is seen, and nothing meets it")
        color = next((found for each in visuals if (found := self._color(each))), None)
        for each in collisions:
            own, base = self._pose(each)
            at = pose @ body.scope.pose(base, self) @ own if base else here @ own
            self._collision(_Spot(piece, f"{subject}/{each.get('name')}", at, color), each, body.folder)

    def _collision(self, spot: "_Spot", element: Element, folder: Path) -> None:
        geometry = element.first("geometry")
        shape = next(iter(geometry.children), None) if geometry else None
        if geometry is None or shape is None or shape.tag == "empty":
            return
        if element.said("surface/contact/collide_without_contact").lower() in _TRUE:
            self.found.note(spot.subject, "dropped", "collides without contact: nothing is stopped by it")
        elif shape.tag == "plane":
            self._plane(spot, shape)
        elif shape.tag == "heightmap":
            allowed = "no heightmap: a robot's floor is level here; use a mesh for walls, and leave terrain out"
            self.files.fault(f"{shape.where}: {spot.subject}", "heightmap", allowed)
        elif shape.tag == "mesh":
            mesh = self._mesh(spot.subject, shape, folder)
            if mesh is not None:
                self._place_part(spot, "a mesh", mesh)
        elif shape.tag == "polyline":
            self._polyline(spot, list(geometry.all("polyline")))
        elif shape.tag in _SIZES:
            self._simple(spot, shape)
        else:
            self.found.note(spot.subject, "dropped", f"{shown(shape.tag)}: a shape that Simyard does not know")

    def _place_part(
        self,
        spot: "_Spot",
        shape: str,
        mesh: TriangleMesh,
        upright: tuple[float, float] | None = None,
        ball_m: float | None = None,
    ) -> None:
        self.found.parts.append(Placed(spot.piece, spot.subject, shape, mesh, spot.pose, spot.color, upright, ball_m))

    def _plane(self, spot: "_Spot", shape: Element) -> None:
        normal = shape.first("normal")
        numbers = self._numbers(normal, 3) if normal else [0.0, 0.0, 1.0]
        if numbers is None:
            return
        up = spot.pose[:3, :3] @ np.array(numbers)
        if abs(up[2]) > 0.999 * float(np.linalg.norm(up)):
            self.found.planes_m.append(float(spot.pose[2, 3]))
        else:
            self.found.note(spot.subject, "dropped", "a plane without end that is not level")

    def _simple(self, spot: "_Spot", shape: Element) -> None:
        size: list[float] = []
        for name, count in _SIZES[shape.tag]:
            element = shape.first(name)
            numbers = self._numbers(element, count, positive=True) if element else None
            if element is None:
                self.files.fault(f"{shape.where}: {shape.tag}", f"no {name}", f"a {name}")
            if numbers is None:
                return
            size += numbers
        key = (shape.tag, *size)
        if key not in self._scaled:
            self._scaled[key] = SHAPES[shape.tag](size)
        upright = (size[0], size[1]) if shape.tag == "cylinder" else None
        ball_m = size[0] if shape.tag == "sphere" else None
        self._place_part(spot, f"a {shape.tag}", self._scaled[key], upright, ball_m)

    def _polyline(self, spot: "_Spot", shapes: Sequence[Element]) -> None:
        """Takes upright walls around points; a polyline in another one cuts a hole."""
        height = shapes[0].first("height")
        high = self._numbers(height, 1, positive=True) if height else [1.0]
        rings: list[list[tuple[float, float]]] = []
        for shape in shapes:
            points = [self._numbers(point, 2) for point in shape.all("point")]
            rings.append([(each[0], each[1]) for each in points if each])
            if len(points) < 3:
                self.files.fault(f"{shape.where}: polyline", f"{len(points)} points", "3 points or more")
        if high is None or any(len(ring) < 3 for ring in rings):
            return
        try:
            mesh = extruded(rings, 0.0, high[0])
        except MeshUnreadable as exc:
            self.found.note(spot.subject, "dropped", f"a polyline that {exc}")
        else:
            self._place_part(spot, "a polyline", mesh)

    def _mesh(self, subject: str, shape: Element, folder: Path) -> TriangleMesh | None:
        """Returns a mesh at its scale; None where it is not there, or no mesh."""
        address = shape.said("uri") or shape.said("filename")
        scale_element = shape.first("scale")
        scale = self._numbers(scale_element, 3) if scale_element else [1.0, 1.0, 1.0]
        if scale is None or 0.0 in scale:
            return None
        path = self.files.find(address, folder, shape.where)
        if path is None or not path.is_file():
            self._missing.setdefault(address, []).append(subject)
            return None
        middle = shape.said("submesh/center").lower() in _TRUE
        as_hull = shape.get("optimization") == "convex_hull"
        key = (path.resolve(), shape.said("submesh/name"), middle, as_hull)
        if key not in self._meshes:
            self._meshes[key] = self._loaded(path, *key[1:])
        mesh = self._meshes[key]
        if isinstance(mesh, str):
            self.found.note(subject, "unresolved", f"{self.files.name(path)} {mesh}")
            return None
        scaled = (*key, *scale)
        if scaled not in self._scaled:
            faces = mesh.faces[:, ::-1] if np.prod(scale) < 0 else mesh.faces
            self._scaled[scaled] = mesh._replace(points=mesh.points * np.array(scale), faces=faces)
        return self._scaled[scaled]

    def _loaded(self, path: Path, submesh: str, middle: bool, as_hull: bool) -> TriangleMesh | str:  # noqa: FBT001
        try:
            mesh = read_mesh_file(self.files, path, submesh)
        except MeshUnreadable as exc:
            return str(exc)
        mesh = centered(mesh) if middle else mesh
        return hull(mesh) if as_hull else mesh

    def _color(self, visual: Element) -> Color | None:
        material = visual.first("material")
        if material is None:
            return None
        for name in ("diffuse", "ambient"):
            element = material.first(name)
            numbers = element.text.split()[:3] if element else []
            if element and len(numbers) == 3 and self._numbers(Element(name, {}, element.where, " ".join(numbers)), 3):
                red, green, blue = (min(max(float(each), 0.0), 1.0) for each in numbers)
                return red, green, blue
        return _COLORS.get(material.said("script/name"))

    def _lights(self, holder: Element, at: Pose) -> None:
        """Takes the lights of an element that shine from a place; a sun shines from none."""
        for light in holder.all("light"):
            if light.get("type") != "directional":
                x, y, z = (at @ self._pose(light)[0])[:3, 3].tolist()
                self.found.lights.append((x, y, z))

    def _tell(self) -> None:
        """Notes what was found out about the world as a whole."""
        looked = ", ".join(str(folder) for folder in self.files.folders)
        for address, users in self._missing.items():
            used = f"{len(users)} times, by {users[0]} first" if len(users) > 1 else f"by {users[0]}"
            self.found.note(
                address or "an include without uri", "unresolved", f"used {used}; looked for it in {looked}"
            )
        if self._moves:
            names = ", ".join(self._moves)
            why = f"not static in the source: what would fall or be pushed there stands still here ({names})"
            self.found.note(f"{len(self._moves)} models", "approximated", why)
        for name, count in self._plugins.items():
            self.found.note(f"plugin {name}", "dropped", f"{_DROPPED['plugin']}; {count} times")


def _kind(found: Path, model: Element) -> str:
    return found.name if found.suffix == "" else model.get("name")


def _euler_pose(position: Sequence[float], turn: Sequence[float]) -> Pose:
    """Returns the pose of a position, and of turns about the fixed axes x, y and z, in this order."""
    (cr, cp, cy), (sr, sp, sy) = map(math.cos, turn), map(math.sin, turn)
    pose = np.eye(4)
    pose[:3, :3] = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    pose[:3, 3] = position
    return pose


def _quaternion_pose(numbers: Sequence[float]) -> Pose:
    """Returns the pose of a position and a quaternion (x, y, z, w)."""
    x, y, z, w = np.array(numbers[3:]) / max(float(np.linalg.norm(numbers[3:])), 1e-12)
    pose = np.eye(4)
    pose[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    pose[:3, 3] = numbers[:3]
    return pose
