"""Furniture as SDF models that worlds share: pieces of one make are one model, wherever they stand."""

import hashlib
import math
import re
from xml.etree import ElementTree as ET

from specs.world import Furniture, Solid
from tasks.export.sdf_elements import SDF_VERSION, Pose, add_solid, document, encoded, numbers, text, turned

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
    text(model, "static", "true")
    link = ET.SubElement(model, "link", name="link")
    for name, solid, pose in parts:
        add_solid(link, solid.model_copy(update={"name": name}), pose)
    return model_name, {"model.config": model_config(model_name, piece.model_type), "model.sdf": encoded(root)}


def model_config(name: str, description: str) -> bytes:
    """Returns the file that tells Gazebo of a model."""
    root = ET.Element("model")
    text(root, "name", name)
    text(root, "version", "1.0")
    sdf = text(root, "sdf", "model.sdf")
    sdf.set("version", SDF_VERSION)
    text(ET.SubElement(root, "author"), "name", "Simyard")
    text(root, "description", description)
    return encoded(root)


def _part_name(piece: Furniture, solid: Solid) -> str:
    """Returns a part's name without the piece's: ``seat`` of ``Sofas_1_seat``."""
    return solid.name.removeprefix(piece.name).strip("_/")


def _pose_in(piece: Furniture, solid: Solid) -> Pose:
    """Returns where a solid is in the frame of its piece, whose origin is on the floor under its middle."""
    x_m, y_m = turned(solid.center_m[0] - piece.center_m[0], solid.center_m[1] - piece.center_m[1], -piece.yaw_rad)
    yaw_rad = 0.0 if solid.shape == "cylinder" else math.remainder(solid.yaw_rad - piece.yaw_rad, 2 * math.pi)
    # A box looks the same after half a turn; which half it is shall not depend on the last bit.
    yaw_rad = round(math.remainder(round(yaw_rad, 6), round(math.pi, 6)), 5)
    return round(x_m, 5), round(y_m, 5), solid.center_m[2], yaw_rad
