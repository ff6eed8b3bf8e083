"""A world as MJCF: loads in MuJoCo as it is, with every solid a geom of the solid's name.

Collision is what the world says and nothing else: one ground plane and the solids. What shows floorings, wall coverings
and windows are sheets a millimetre in front of them (mjcf_finishes).
"""

import math

import mujoco

from specs.data.world import Rectangle, World, solids
from tasks.export.format.mjcf_finishes import add_floor, add_walls, add_windows
from tasks.export.format.mjcf_geoms import (
    CEILING_GROUP,
    FURNITURE_GROUP,
    WALL_GROUP,
    add_door,
    add_plane,
    add_solid_geom,
)

MJCF_FILE = "world.xml"
GROUND = "ground"
CEILING = "ceiling"
OVERVIEW_CAMERA = "overview"

_THRESHOLD_RGBA = (0.55, 0.53, 0.50, 1.0)
_CEILING_RGBA = (0.95, 0.95, 0.95, 1.0)
_CEILING_HALF_THICKNESS_M = 0.05
_GROUND_MARGIN_M = 0.5
_OVERVIEW_FOVY_DEG = 45.0
_LAMP_CUTOFF_DEG = 76.0


def world_spec(world: World, *, ceiling: bool = False) -> mujoco.MjSpec:
    """Returns the editable model of a world: static geoms in the world body, hinged doors, lights, an overview camera.

    Args:
        world: Any world.
        ceiling: Whether to close the rooms with a slab at the ceiling's height; off, one can look in.
    """
    spec = mujoco.MjSpec()
    spec.modelname = f"{world.generation}/{world.name}"
    spec.compiler.degree = False
    _look(spec, world)
    ground = add_plane(spec, own_name(world, GROUND), world.footprint, 0.0, margin_m=_GROUND_MARGIN_M)
    ground.rgba = list(_THRESHOLD_RGBA)
    for number, room in enumerate(world.rooms, start=1):
        add_floor(spec, room)
        add_walls(spec, world, room, number)
        add_windows(spec, world, room)
    for wall in world.walls:
        add_solid_geom(spec.worldbody, wall, WALL_GROUP)
    for door in world.doors:
        add_door(spec, door)
    for piece in world.furniture:
        for solid in piece.solids:
            add_solid_geom(spec.worldbody, solid, FURNITURE_GROUP)
    if ceiling:
        _ceiling(spec, world)
    _lights(spec, world)
    _overview(spec, world)
    return spec


def own_name(world: World, name: str) -> str:
    """Returns the name of a geom that is no solid of the world: MuJoCo has a name once, and a solid keeps its own."""
    taken = {solid.name for solid in solids(world)}
    while name in taken:
        name += "_"
    return name


def mjcf_files(world: World) -> dict[str, bytes]:
    """Returns the world as an MJCF document and the textures that it names, the same bytes for the same world."""
    spec = world_spec(world)
    spec.compile()
    textures: dict[str, bytes] = spec.assets
    return {MJCF_FILE: spec.to_xml().encode(), **textures}


def _look(spec: mujoco.MjSpec, world: World) -> None:
    area = world.footprint
    center_x_m, center_y_m = _center(area)
    spec.stat.center = [center_x_m, center_y_m, world.ceiling_height_m / 2]
    spec.stat.extent = math.hypot(area.x_max_m - area.x_min_m, area.y_max_m - area.y_min_m) / 2
    spec.visual.headlight.ambient = [0.42, 0.42, 0.42]
    spec.visual.headlight.diffuse = [0.25, 0.25, 0.25]
    spec.visual.headlight.specular = [0.0, 0.0, 0.0]
    spec.visual.quality.shadowsize = 2048
    # MuJoCo draws shadows in this share of a lamp's cone; where they end would be seen as a line.
    spec.visual.map.shadowscale = 1.0
    spec.visual.map.znear = 0.005
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.93, 0.95, 0.97],
        rgb2=[0.70, 0.76, 0.84],
        width=64,
        height=384,
    )


def _ceiling(spec: mujoco.MjSpec, world: World) -> None:
    area = world.footprint
    half_x_m, half_y_m = (area.x_max_m - area.x_min_m) / 2, (area.y_max_m - area.y_min_m) / 2
    spec.worldbody.add_geom(
        name=own_name(world, CEILING),
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=[*_center(area), world.ceiling_height_m + _CEILING_HALF_THICKNESS_M],
        size=[half_x_m, half_y_m, _CEILING_HALF_THICKNESS_M],
        rgba=list(_CEILING_RGBA),
        group=CEILING_GROUP,
    )


def _lights(spec: mujoco.MjSpec, world: World) -> None:
    share = 1.0 / max(1, len(world.lights))
    for number, light in enumerate(world.lights, start=1):
        lamp = spec.worldbody.add_light(name=f"light-{number}", pos=list(light.position_m), dir=[0.0, 0.0, -1.0])
        lamp.diffuse = [0.35 + 0.3 * share] * 3
        lamp.specular = [0.05] * 3
        lamp.cutoff = _LAMP_CUTOFF_DEG
        lamp.exponent = 1.0
        lamp.attenuation = [1.0, 0.0, 0.04]
        # Each shadow is one more rendering of the scene: one gives the picture depth, six would cost it its speed.
        lamp.castshadow = number == 1


def _overview(spec: mujoco.MjSpec, world: World) -> None:
    area = world.footprint
    half_fovy_rad = math.radians(_OVERVIEW_FOVY_DEG) / 2
    # 4:3 is the narrowest picture in use: fit the height, and the width at that aspect, of the tops of the walls.
    half_height_m = max(area.y_max_m - area.y_min_m, (area.x_max_m - area.x_min_m) * 3 / 4) / 2 + _GROUND_MARGIN_M
    height_m = world.ceiling_height_m + half_height_m / math.tan(half_fovy_rad)
    spec.worldbody.add_camera(name=OVERVIEW_CAMERA, pos=[*_center(area), height_m], fovy=_OVERVIEW_FOVY_DEG)


def _center(area: Rectangle) -> tuple[float, float]:
    return (area.x_min_m + area.x_max_m) / 2, (area.y_min_m + area.y_max_m) / 2
