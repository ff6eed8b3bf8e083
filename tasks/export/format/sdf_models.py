"""What SDF documents are made of: links, visuals, collisions, joints (sdformat.org, specification 1.9).

Furniture as SDF models that worlds share: pieces of one make are one model, wherever they stand.
"""

import functools
import hashlib
import math
import re
from collections.abc import Iterable
from typing import Literal, NamedTuple
from xml.etree import ElementTree as ET

from specs.data.world import Color, Furniture, Solid

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


def numbers(values: Iterable[float]) -> str:
    """Returns numbers as SDF has them, rounded to a micrometre and a microradian, without a negative zero."""
    return " ".join(
        f"{round(value, 6) + 0.0:g}" if abs(value) < 1e-4 else f"{round(value, 6):.10g}" for value in values
    )


def add_pose(parent: ET.Element, pose: Pose) -> None:
    """Adds a pose."""
    add_text(parent, "pose", _pose_text(pose))


def _pose_text(pose: Pose) -> str:
    return _upright(numbers(pose))


def _upright(pose: str) -> str:
    """Returns a pose of four numbers as one of six, which is turned about z alone."""
    place, _, yaw = pose.rpartition(" ")
    return f"{place} {numbers((0.0, 0.0))} {yaw}"


def add_solid_to_link(link: ET.Element, solid: Solid, pose: Pose, *, touched: bool = True) -> None:
    """Adds a solid to a link, as it is seen and, unless it is only to be looked at, touched.

    Args:
        link: Where it goes.
        solid: Its name, shape and colour.
        pose: Where it is, in the link's frame.
        touched: Whether it collides.
    """
    for kind in ("collision", "visual") if touched else ("visual",):
        _add_shape(link, kind, solid.name, _pose_text(pose), solid)


def add_mesh(link: ET.Element, name: str, uri: str) -> None:
    """Adds a mesh that is seen and not touched; its file says what it looks like."""
    visual = ET.SubElement(link, "visual", name=name)
    add_text(visual, "cast_shadows", "false")
    add_text(ET.SubElement(ET.SubElement(visual, "geometry"), "mesh"), "uri", uri)


def add_color(visual: ET.Element, color: Color) -> None:
    """Adds a material of one colour."""
    material = ET.SubElement(visual, "material")
    for light in ("ambient", "diffuse"):
        add_text(material, light, numbers((*color, 1.0)))
    add_text(material, "specular", "0.05 0.05 0.05 1")


def turn(x_m: float, y_m: float, yaw_rad: float) -> tuple[float, float]:
    """Returns a vector turned counter-clockwise."""
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    return cos * x_m - sin * y_m, sin * x_m + cos * y_m


def _add_shape(link: ET.Element, kind: str, name: str, pose: str, shape: "Solid | _Part") -> None:
    element = ET.SubElement(link, kind, name=f"{name}_{kind}")  # names of siblings differ
    add_text(element, "pose", pose)
    _geometry(element, shape)
    if kind == "visual":
        add_color(element, shape.color)


def _geometry(parent: ET.Element, solid: "Solid | _Part") -> None:
    x_m, y_m, z_m = solid.half_extents_m
    geometry = ET.SubElement(parent, "geometry")
    if solid.shape == "cylinder":
        cylinder = ET.SubElement(geometry, "cylinder")
        add_text(cylinder, "radius", numbers((x_m,)))
        add_text(cylinder, "length", numbers((2 * z_m,)))
    else:
        add_text(ET.SubElement(geometry, "box"), "size", numbers((2 * x_m, 2 * y_m, 2 * z_m)))


_DIGEST_CHARACTERS = 12
_MODELS_KEPT = 1024
_NOT_IN_A_NAME = re.compile(r"[^a-z0-9]+")


def furniture_model(piece: Furniture) -> tuple[str, dict[str, bytes]]:
    """Returns the name of a piece's model, and the model's files.

    The name says what kind of piece it is and, by a digest, its shape and colours: equal pieces, equal models.
    """
    parts = tuple(_part(piece, solid) for solid in piece.solids)
    return _shared_model(piece.model_type, parts)


class _Part(NamedTuple):
    """All that a model says of a solid, the pose as text: parts that are equal are the same in a model."""

    name: str
    shape: Literal["box", "cylinder"]
    half_extents_m: tuple[float, float, float]
    color: Color
    pose: str


@functools.lru_cache(maxsize=_MODELS_KEPT)
def _shared_model(model_type: str, parts: tuple[_Part, ...]) -> tuple[str, dict[str, bytes]]:
    """Returns a model's name and files; kept, since most pieces of a world are of a make that another world has."""
    kind = _NOT_IN_A_NAME.sub("_", model_type.lower()).strip("_")
    shape = hashlib.sha256(repr([tuple(part) for part in parts]).encode()).hexdigest()[:_DIGEST_CHARACTERS]
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
    pose = numbers(_pose_in(piece, solid))
    return _Part(_part_name(piece, solid), solid.shape, solid.half_extents_m, solid.color, pose)


def _part_name(piece: Furniture, solid: Solid) -> str:
    """Returns a part's name without the piece's: ``seat`` of ``Sofas_1_seat``."""
    return solid.name.removeprefix(piece.name).strip("_/")


def _pose_in(piece: Furniture, solid: Solid) -> Pose:
    """Returns where a solid is in the frame of its piece, whose origin is on the floor under its middle."""
    x_m, y_m = turn(solid.center_m[0] - piece.center_m[0], solid.center_m[1] - piece.center_m[1], -piece.yaw_rad)
    yaw_rad = 0.0 if solid.shape == "cylinder" else math.remainder(solid.yaw_rad - piece.yaw_rad, 2 * math.pi)
    # A box looks the same after half a turn; which half it is shall not depend on the last bit.
    yaw_rad = round(math.remainder(round(yaw_rad, 6), round(math.pi, 6)), 5)
    return round(x_m, 5), round(y_m, 5), solid.center_m[2], yaw_rad
