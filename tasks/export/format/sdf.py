"""A world as SDF, in RoboMaker's workspace: a world of models, the furniture's shared between worlds.

SDF documents are as sdformat.org, specification 1.9, has them; coverings of floors and walls are Wavefront OBJ, which
both generations of Gazebo read.

    aws_robomaker_worldforge_worlds/worlds/<world>/<world>.world            what Gazebo is given
    aws_robomaker_worldforge_worlds/worlds/<world>/world_description.json   its doors, if it has any
    aws_robomaker_worldforge_worlds/models/<world>_building/...             walls, floors, windows
    aws_robomaker_worldforge_shared_models/models/<model>/...               furniture

Gazebo finds models by ``model://``; the packages' files (``ros_packages``) tell it where they are. Pieces of furniture
that are alike are one model, wherever they stand.
"""

import functools
import hashlib
import math
import re
from collections.abc import Iterable, Sequence
from typing import Literal, NamedTuple
from xml.etree import ElementTree as ET

from specs.base import canonical_json
from specs.data.world import Color, Door, Finish, Furniture, Solid, World
from specs.robomaker.world_jobs import world_description
from tasks.render.sheets import Covering, finish_key, sheets, window_parts
from tasks.render.textures import texture_of

MATERIALS_FILE = "finishes.mtl"


def obj(sheet: Covering) -> bytes:
    """Returns a sheet's corners and triangles."""
    lines = [f"mtllib {MATERIALS_FILE}", "o sheet", f"usemtl {finish_key(sheet.finish)}"]
    lines += [f"v {x_m:.6f} {y_m:.6f} {z_m:.6f}" for x_m, y_m, z_m in sheet.vertices_m.tolist()]
    lines += [f"vt {along:.6f} {up:.6f}" for along, up in sheet.coordinates.tolist()]
    for triangle in (sheet.triangles + 1).tolist():
        lines.append("f " + " ".join(f"{corner}/{corner}" for corner in triangle))
    return ("\n".join(lines) + "\n").encode()


def materials(finishes: Sequence[Finish]) -> dict[str, bytes]:
    """Returns the material library of some finishes, and the pictures that it names, beside it."""
    files: dict[str, bytes] = {}
    lines: list[str] = []
    for finish in finishes:
        key = finish_key(finish)
        lines += [f"newmtl {key}", "Ns 10", "Ks 0.05 0.05 0.05"]
        texture = texture_of(finish)
        if texture is None:
            channels = " ".join(f"{channel:.6f}" for channel in finish.color)
            lines += [f"Ka {channels}", f"Kd {channels}"]
        else:
            files[f"{key}.png"] = texture.png
            lines += ["Ka 1 1 1", "Kd 1 1 1", f"map_Kd {key}.png"]
    return {MATERIALS_FILE: ("\n".join(lines) + "\n").encode(), **files}


SDF_VERSION = "1.9"
Pose = tuple[float, float, float, float]
"""Position (m) and turn about z (rad)."""


def document() -> ET.Element:
    """Returns an empty SDF document."""
    return ET.Element("sdf", version=SDF_VERSION)


def encode_xml(root: ET.Element) -> bytes:
    """Returns a document as bytes, indented."""
    ET.indent(root)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode").encode() + b"\n"


def add_text(parent: ET.Element, tag: str, value: object) -> ET.Element:
    """Returns a new child with a text."""
    child = ET.SubElement(parent, tag)
    child.text = str(value)
    return child


def numbers_text(values: Iterable[float]) -> str:
    """Returns numbers as SDF has them, rounded to a micrometre and a microradian, without a negative zero."""
    return " ".join(
        f"{round(value, 6) + 0.0:g}" if abs(value) < 1e-4 else f"{round(value, 6):.10g}" for value in values
    )


def add_pose(parent: ET.Element, pose: Pose) -> None:
    """Adds a pose."""
    add_text(parent, "pose", _pose_text(pose))


def _pose_text(pose: Pose) -> str:
    return _upright(numbers_text(pose))


def _upright(pose: str) -> str:
    """Returns a pose of four numbers as one of six, which is turned about z alone."""
    place, _, yaw = pose.rpartition(" ")
    return f"{place} {numbers_text((0.0, 0.0))} {yaw}"


def add_solid_to_link(link: ET.Element, solid: Solid, pose: Pose, *, touched: bool = True) -> None:
    """Adds a solid to a link, as it is seen and, unless it is only to be looked at, touched.

    Args:
        link: Where it goes.
        solid: Its name, shape and colour.
        pose: Where it is, in the link's frame.
        touched: Whether it collides.
    """
    placed = (*pose[:2], _height_m(solid, pose[2]), pose[3])
    for kind in ("collision", "visual") if touched else ("visual",):
        _add_shape(link, kind, solid.name, _pose_text(placed), solid)


def add_mesh(link: ET.Element, name: str, uri: str) -> None:
    """Adds a mesh that is seen and not touched; its file says what it looks like."""
    visual = ET.SubElement(link, "visual", name=name)
    add_text(visual, "cast_shadows", "false")
    add_text(ET.SubElement(ET.SubElement(visual, "geometry"), "mesh"), "uri", uri)


def add_color(visual: ET.Element, color: Color) -> None:
    """Adds a material of one colour."""
    material = ET.SubElement(visual, "material")
    for light in ("ambient", "diffuse"):
        add_text(material, light, numbers_text((*color, 1.0)))
    add_text(material, "specular", "0.05 0.05 0.05 1")


def turn(x_m: float, y_m: float, yaw_rad: float) -> tuple[float, float]:
    """Returns a vector turned counter-clockwise."""
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    return cos * x_m - sin * y_m, sin * x_m + cos * y_m


def _add_shape(link: ET.Element, kind: str, name: str, pose: str, shape: "Solid | _Part") -> None:
    element = ET.SubElement(link, kind, name=f"{name}_{kind}")  # names of siblings differ
    add_text(element, "pose", pose)
    x_m, y_m, z_m = shape.half_extents_m
    geometry = ET.SubElement(element, "geometry")
    if shape.shape == "cylinder":
        cylinder = ET.SubElement(geometry, "cylinder")
        add_text(cylinder, "radius", numbers_text((x_m,)))
        add_text(cylinder, "length", numbers_text((2 * z_m,)))
    elif shape.outline_m is not None:
        polyline = ET.SubElement(geometry, "polyline")
        for corner in shape.outline_m:
            add_text(polyline, "point", numbers_text(corner))
        add_text(polyline, "height", numbers_text((2 * z_m,)))
    else:
        add_text(ET.SubElement(geometry, "box"), "size", numbers_text((2 * x_m, 2 * y_m, 2 * z_m)))
    if kind == "visual":
        add_color(element, shape.color)


_DIGEST_CHARACTERS = 12
_MODELS_KEPT = 1024
_NOT_IN_A_NAME = re.compile(r"[^a-z0-9]+")


# Worlds share these models: pieces of one make are one model, wherever they stand.
def furniture_model(piece: Furniture) -> tuple[str, dict[str, bytes]]:
    """Returns the name of a piece's model, and the model's files.

    The name says what kind of piece it is and, by a digest, its shape and colours: equal pieces, equal models.
    """
    parts = tuple(_part(piece, solid) for solid in piece.solids)
    return _shared_model(piece.model_type, parts)


class _Part(NamedTuple):
    """All that a model says of a solid, the pose as text: parts that are equal are the same in a model."""

    name: str
    shape: Literal["box", "cylinder", "prism"]
    half_extents_m: tuple[float, float, float]
    color: Color
    pose: str
    outline_m: tuple[tuple[float, float], ...] | None


@functools.lru_cache(maxsize=_MODELS_KEPT)
def _shared_model(model_type: str, parts: tuple[_Part, ...]) -> tuple[str, dict[str, bytes]]:
    """Returns a model's name and files; kept, since most pieces of a world are of a make that another world has."""
    kind = _NOT_IN_A_NAME.sub("_", model_type.lower()).strip("_")
    told = [tuple(part) if part.outline_m else tuple(part)[:-1] for part in parts]
    shape = hashlib.sha256(repr(told).encode()).hexdigest()[:_DIGEST_CHARACTERS]
    model_name = f"aws_robomaker_{kind}_{shape}"
    root = document()
    model = ET.SubElement(root, "model", name=model_name)
    add_text(model, "static", "true")
    link = ET.SubElement(model, "link", name="link")
    for part in parts:
        for seen in ("collision", "visual"):
            _add_shape(link, seen, part.name, _upright(part.pose), part)
    return model_name, {"model.config": model_config(model_name, model_type), "model.sdf": encode_xml(root)}


def model_config(name: str, description: str) -> bytes:
    """Returns the file that tells Gazebo of a model."""
    root = ET.Element("model")
    add_text(root, "name", name)
    add_text(root, "version", "1.0")
    sdf = add_text(root, "sdf", "model.sdf")
    sdf.set("version", SDF_VERSION)
    add_text(ET.SubElement(root, "author"), "name", "Simyard")
    add_text(root, "description", description)
    return encode_xml(root)


def _part(piece: Furniture, solid: Solid) -> _Part:
    """Returns a solid in the frame of its piece, whose origin is on the floor under its middle."""
    x_m, y_m = turn(solid.center_m[0] - piece.center_m[0], solid.center_m[1] - piece.center_m[1], -piece.yaw_rad)
    yaw_rad = 0.0 if solid.shape == "cylinder" else math.remainder(solid.yaw_rad - piece.yaw_rad, 2 * math.pi)
    # A box looks the same after half a turn; which half it is shall not depend on the last bit.
    yaw_rad = round(yaw_rad if solid.outline_m else math.remainder(round(yaw_rad, 6), round(math.pi, 6)), 5)
    pose = numbers_text((round(x_m, 5), round(y_m, 5), _height_m(solid, solid.center_m[2]), yaw_rad))
    name = solid.name.removeprefix(piece.name).strip("_/")
    return _Part(name, solid.shape, solid.half_extents_m, solid.color, pose, solid.outline_m)


def _height_m(solid: Solid, center_m: float) -> float:
    """Returns at which height SDF has a solid that is centred at one: a polyline is drawn upwards from where it is."""
    return center_m - solid.half_extents_m[2] if solid.shape == "prism" else center_m


WORLDS_PACKAGE, MODELS_PACKAGE = "aws_robomaker_worldforge_worlds", "aws_robomaker_worldforge_shared_models"
GROUND = "ground"
_GROUND_M = 100.0
# As for MJCF (``tasks.export.format.mjcf``): a hollow-core leaf, and friction that keeps it where it is left.
_DENSITY_KG_M3 = 300.0
_FRICTION_NM, _DAMPING_NM_S = 1.5, 1.5


def sdf_name(world: World) -> str:
    """Returns a world's name in the workspace."""
    return workspace_name(world.generation, world.name)


def workspace_name(generation: str, world: str) -> str:
    """Returns what RoboMaker calls a world in the workspace: ``generation_<id>_<world>``."""
    return f"generation_{generation}_{world}"


def sdf_files(world: World) -> dict[str, bytes]:
    """Returns the files of a world, by their paths in the workspace's ``src``; models of equal pieces are equal."""
    name = sdf_name(world)
    folder = f"{WORLDS_PACKAGE}/worlds/{name}"
    files = {f"{WORLDS_PACKAGE}/models/{name}_building/{file}": body for file, body in _building(world, name).items()}
    models: dict[str, str] = {}
    for piece in world.furniture:
        models[piece.name], shared = furniture_model(piece)
        files |= {f"{MODELS_PACKAGE}/models/{models[piece.name]}/{file}": body for file, body in shared.items()}
    files[f"{folder}/{name}.world"] = _world(world, name, models)
    if world.doors:
        files[f"{folder}/world_description.json"] = canonical_json(world_description(world))
    return files


def _world(world: World, name: str, models: dict[str, str]) -> bytes:
    root = document()
    element = ET.SubElement(root, "world", name=name)
    _scene(element, world)
    _include(element, f"{name}_building", "building", (0.0, 0.0, 0.0))
    for piece in world.furniture:
        _include(element, models[piece.name], piece.name, (*piece.center_m, piece.yaw_rad))
    for door in world.doors:
        _door(element, door)
    return encode_xml(root)


def _scene(element: ET.Element, world: World) -> None:
    add_text(element, "gravity", "0 0 -9.81")
    scene = ET.SubElement(element, "scene")
    add_text(scene, "ambient", "0.5 0.5 0.5 1")
    add_text(scene, "background", "0.82 0.86 0.9 1")
    add_text(scene, "shadows", "true")
    for number, light in enumerate(world.lights, start=1):
        lamp = ET.SubElement(element, "light", name=f"light-{number}", type="point")
        add_pose(lamp, (*light.position_m, 0.0))
        add_text(lamp, "cast_shadows", "false")
        add_text(lamp, "diffuse", "0.5 0.5 0.48 1")
        add_text(lamp, "specular", "0.05 0.05 0.05 1")
        attenuation = ET.SubElement(lamp, "attenuation")
        for tag, value in (("range", "12"), ("constant", "0.6"), ("linear", "0.05"), ("quadratic", "0.02")):
            add_text(attenuation, tag, value)


def _include(element: ET.Element, model: str, name: str, place: tuple[float, float, float]) -> None:
    include = ET.SubElement(element, "include")
    add_text(include, "uri", f"model://{model}")
    add_text(include, "name", name)
    add_pose(include, (place[0], place[1], 0.0, place[2]))


def _building(world: World, name: str) -> dict[str, bytes]:
    """Returns the model of all that stands still and is no furniture."""
    root = document()
    model = ET.SubElement(root, "model", name=f"{name}_building")
    add_text(model, "static", "true")
    link = ET.SubElement(model, "link", name="building")
    plane = ET.SubElement(ET.SubElement(ET.SubElement(link, "collision", name=GROUND), "geometry"), "plane")
    add_text(plane, "normal", "0 0 1")
    add_text(plane, "size", f"{_GROUND_M:g} {_GROUND_M:g}")
    for wall in world.walls:
        add_solid_to_link(link, wall, (*wall.center_m, wall.yaw_rad))
    for part in (part for room in world.rooms for part in window_parts(world, room)):
        add_solid_to_link(link, part, (*part.center_m, 0.0), touched=False)
    files = {"model.config": model_config(f"{name}_building", "Walls, floors and windows")}
    coverings = sheets(world)
    for number, sheet in enumerate(coverings, start=1):
        file = f"meshes/sheet-{number}.obj"
        files[file] = obj(sheet)
        add_mesh(link, sheet.name, f"model://{name}_building/{file}")
    finishes = {sheet.finish: None for sheet in coverings}
    files |= {f"meshes/{file}": body for file, body in materials(list(finishes)).items()}
    files["model.sdf"] = encode_xml(root)
    return files


def _door(element: ET.Element, door: Door) -> None:
    """Adds a door as a model of its own: a leaf on a hinge, whose position 0 is the door as it stands."""
    leaf, (x_m, y_m) = door.leaf, door.hinge_m
    model = ET.SubElement(element, "model", name=door.name)
    add_pose(model, (x_m, y_m, 0.0, leaf.yaw_rad))
    link = ET.SubElement(model, "link", name="leaf")
    ahead_m, aside_m = turn(leaf.center_m[0] - x_m, leaf.center_m[1] - y_m, -leaf.yaw_rad)
    pose = (ahead_m, aside_m, leaf.center_m[2], 0.0)
    _inertial(link, leaf.half_extents_m, pose)
    add_solid_to_link(link, leaf, pose)
    hinge = ET.SubElement(model, "joint", name="hinge", type="revolute")
    add_text(hinge, "parent", "world")
    add_text(hinge, "child", "leaf")
    axis = ET.SubElement(hinge, "axis")
    quarter_rad = math.remainder(door.open_yaw_rad - door.closed_yaw_rad, 2 * math.pi)
    add_text(axis, "xyz", f"0 0 {math.copysign(1, quarter_rad):g}")
    opened_rad = abs(quarter_rad) * door.open_percent / 100.0
    limit = ET.SubElement(axis, "limit")
    add_text(limit, "lower", numbers_text((-opened_rad,)))
    add_text(limit, "upper", numbers_text((abs(quarter_rad) - opened_rad,)))
    dynamics = ET.SubElement(axis, "dynamics")
    add_text(dynamics, "damping", _DAMPING_NM_S)
    add_text(dynamics, "friction", _FRICTION_NM)


def _inertial(link: ET.Element, half_m: tuple[float, float, float], pose: tuple[float, float, float, float]) -> None:
    """Adds the mass of a box of even density."""
    mass_kg = 8 * half_m[0] * half_m[1] * half_m[2] * _DENSITY_KG_M3
    squares_m2 = [side**2 for side in half_m]
    inertial = ET.SubElement(link, "inertial")
    add_pose(inertial, pose)
    add_text(inertial, "mass", numbers_text((mass_kg,)))
    inertia = ET.SubElement(inertial, "inertia")
    for axis, tag in enumerate(("ixx", "iyy", "izz")):
        add_text(inertia, tag, numbers_text((mass_kg / 3 * (sum(squares_m2) - squares_m2[axis]),)))
    for tag in ("ixy", "ixz", "iyz"):
        add_text(inertia, tag, "0")
