"""What SDF documents are made of: links, visuals, collisions, joints (sdformat.org, specification 1.9)."""

import math
from collections.abc import Iterable
from xml.etree import ElementTree as ET

from specs.world import Color, Solid

SDF_VERSION = "1.9"
Pose = tuple[float, float, float, float]
"""Position (m) and turn about z (rad)."""


def document() -> ET.Element:
    """Returns an empty SDF document."""
    return ET.Element("sdf", version=SDF_VERSION)


def encoded(root: ET.Element) -> bytes:
    """Returns a document as bytes, indented."""
    ET.indent(root)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="utf-8") + b"\n"


def text(parent: ET.Element, tag: str, value: object) -> ET.Element:
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
    text(parent, "pose", numbers((x_m, y_m, z_m, 0.0, 0.0, yaw_rad)))


def add_solid(link: ET.Element, solid: Solid, pose: Pose, *, touched: bool = True) -> None:
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
    text(visual, "cast_shadows", "false")
    text(ET.SubElement(ET.SubElement(visual, "geometry"), "mesh"), "uri", uri)


def add_color(visual: ET.Element, color: Color) -> None:
    """Adds a material of one colour."""
    material = ET.SubElement(visual, "material")
    for light in ("ambient", "diffuse"):
        text(material, light, numbers((*color, 1.0)))
    text(material, "specular", "0.05 0.05 0.05 1")


def turned(x_m: float, y_m: float, yaw_rad: float) -> tuple[float, float]:
    """Returns a vector turned counter-clockwise."""
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    return cos * x_m - sin * y_m, sin * x_m + cos * y_m


def _geometry(parent: ET.Element, solid: Solid) -> None:
    x_m, y_m, z_m = solid.half_extents_m
    geometry = ET.SubElement(parent, "geometry")
    if solid.shape == "cylinder":
        cylinder = ET.SubElement(geometry, "cylinder")
        text(cylinder, "radius", numbers((x_m,)))
        text(cylinder, "length", numbers((2 * z_m,)))
    else:
        text(ET.SubElement(geometry, "box"), "size", numbers((2 * x_m, 2 * y_m, 2 * z_m)))
