"""What SDF documents are made of: links, visuals, collisions, joints (sdformat.org, specification 1.9).

Furniture as SDF models that worlds share: pieces of one make are one model, wherever they stand.
"""

import hashlib
import math
import re
from collections.abc import Iterable
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
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="utf-8") + b"\n"


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
    x_m, y_m, z_m, yaw_rad = pose
    add_text(parent, "pose", numbers((x_m, y_m, z_m, 0.0, 0.0, yaw_rad)))


def add_solid_to_link(link: ET.Element, solid: Solid, pose: Pose, *, touched: bool = True) -> None:
    """Adds a solid to a link, as it is seen and, unless it is only to be looked at, touched.

    Args:
        link: Where it goes.
        solid: Its name, shape and colour.
        pose: Where it is, in the link's frame.
        touched: Whether it collides.
    """
    for kind in ("collision", "visual") if touched else ("visual",):
        element = ET.SubElement(link, kind, name=f"{solid.name}_{kind}")  # names of siblings differ
        add_pose(element, pose)
        _geometry(element, solid)
        if kind == "visual":
            add_color(element, solid.color)


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


def _geometry(parent: ET.Element, solid: Solid) -> None:
    x_m, y_m, z_m = solid.half_extents_m
    geometry = ET.SubElement(parent, "geometry")
    if solid.shape == "cylinder":
        cylinder = ET.SubElement(geometry, "cylinder")
        add_text(cylinder, "radius", numbers((x_m,)))
        add_text(cylinder, "length", numbers((2 * z_m,)))
    else:
        add_text(ET.SubElement(geometry, "box"), "size", numbers((2 * x_m, 2 * y_m, 2 * z_m)))


_DIGEST_CHARACTERS = 12
_NOT_IN_A_NAME = re.compile(r"[^a-z0-9]+")


def furniture_model(piece: Furniture) -> tuple[str, dict[str, bytes]]:
    """Returns the name of a piece's model, and the model's files.

    The name says what kind of piece it is and, by a digest, its shape and colours: equal pieces, equal models.
    """
    kind = _NOT_IN_A_NAME.sub("_", piece.model_type.lower()).strip("_")
    parts = [(_part_name(piece, solid), solid, _pose_in(piece, solid)) for solid in piece.solids]
    described = [(name, solid.shape, solid.half_extents_m, solid.color, numbers(pose)) for name, solid, pose in parts]
    shape = hashlib.sha256(repr(described).encode()).hexdigest()[:_DIGEST_CHARACTERS]
    model_name = f"aws_robomaker_{kind}_{shape}"
    root = document()
    model = ET.SubElement(root, "model", name=model_name)
    add_text(model, "static", "true")
    link = ET.SubElement(model, "link", name="link")
    for name, solid, pose in parts:
        add_solid_to_link(link, solid.model_copy(update={"name": name}), pose)
    return model_name, {"model.config": model_config(model_name, piece.model_type), "model.sdf": encode_xml(root)}


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
