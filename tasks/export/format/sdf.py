"""A world as SDF, in RoboMaker's workspace: a world of models, the furniture's shared between worlds.

    aws_robomaker_worldforge_worlds/worlds/<world>/<world>.world            what Gazebo is given
    aws_robomaker_worldforge_worlds/worlds/<world>/world_description.json   its doors, if it has any
    aws_robomaker_worldforge_worlds/models/<world>_building/...             walls, floors, windows
    aws_robomaker_worldforge_shared_models/models/<model>/...               furniture

Gazebo finds models by ``model://``; the packages' files (ros_packages) tell it where they are.
"""

import math
from xml.etree import ElementTree as ET

from specs.data.world import Door, World
from specs.digest import canonical_json
from specs.robomaker.world_descriptions import world_description
from tasks.export.format.obj import materials, obj
from tasks.export.format.sdf_models import (
    add_mesh,
    add_pose,
    add_solid_to_link,
    add_text,
    document,
    encode_xml,
    furniture_model,
    model_config,
    numbers,
    turn,
)
from tasks.export.surface.sheets import sheets
from tasks.export.surface.window_boxes import window_parts

WORLDS_PACKAGE, MODELS_PACKAGE = "aws_robomaker_worldforge_worlds", "aws_robomaker_worldforge_shared_models"
GROUND = "ground"
_GROUND_M = 100.0
# As decided for MJCF (mjcf_doors): a hollow-core leaf, and friction that keeps it where it is left.
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
    add_text(limit, "lower", numbers((-opened_rad,)))
    add_text(limit, "upper", numbers((abs(quarter_rad) - opened_rad,)))
    dynamics = ET.SubElement(axis, "dynamics")
    add_text(dynamics, "damping", _DAMPING_NM_S)
    add_text(dynamics, "friction", _FRICTION_NM)


def _inertial(link: ET.Element, half_m: tuple[float, float, float], pose: tuple[float, float, float, float]) -> None:
    """Adds the mass of a box of even density."""
    mass_kg = 8 * half_m[0] * half_m[1] * half_m[2] * _DENSITY_KG_M3
    squares_m2 = [side**2 for side in half_m]
    inertial = ET.SubElement(link, "inertial")
    add_pose(inertial, pose)
    add_text(inertial, "mass", numbers((mass_kg,)))
    inertia = ET.SubElement(inertial, "inertia")
    for axis, tag in enumerate(("ixx", "iyy", "izz")):
        add_text(inertia, tag, numbers((mass_kg / 3 * (sum(squares_m2) - squares_m2[axis]),)))
    for tag in ("ixy", "ixz", "iyz"):
        add_text(inertia, tag, "0")
