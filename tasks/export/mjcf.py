"""A world as MJCF: loads in MuJoCo as it is, with every solid a geom of the solid's name.

Collision is what the world says and nothing else: one ground plane and the solids. The floors of the rooms are sheets
one millimetre above it that are seen, by cameras and by rays, but touch nothing.
"""

import math

import mujoco

from specs.world import Rectangle, Solid, World, solids

GROUND = "ground"
FLOOR_PREFIX = "floor/"
CEILING = "ceiling"
OVERVIEW_CAMERA = "overview"

FLOOR_LIFT_M = 0.001
_THRESHOLD_RGBA = (0.55, 0.53, 0.50, 1.0)
_CEILING_RGBA = (0.95, 0.95, 0.95, 1.0)
_CEILING_HALF_THICKNESS_M = 0.05
_GROUND_MARGIN_M = 0.5
_GRID_SPACING_M = 0.05  # of a plane's drawing only
_OVERVIEW_FOVY_DEG = 45.0
# Groups 0 to 2 are drawn by default: the walls and the ceiling can be switched off one by one.
_GROUND_GROUP, _WALL_GROUP, _FURNITURE_GROUP, _CEILING_GROUP = 0, 1, 2, 3


def world_spec(world: World, *, ceiling: bool = False) -> mujoco.MjSpec:
    """Returns the editable model of a world: static geoms in the world body, lights and an overview camera.

    Args:
        world: Any world.
        ceiling: Whether to close the rooms with a slab at the ceiling's height; off, one can look in.
    """
    spec = mujoco.MjSpec()
    spec.modelname = f"{world.generation}/{world.name}"
    _look(spec, world)
    _floors(spec, world)
    walls = len(world.walls)
    for number, solid in enumerate(solids(world)):
        _solid(spec, solid, _WALL_GROUP if number < walls else _FURNITURE_GROUP)
    if ceiling:
        _ceiling(spec, world)
    _lights(spec, world)
    _overview(spec, world)
    return spec


def world_xml(world: World) -> str:
    """Returns the world as an MJCF document, the same text for the same world."""
    spec = world_spec(world)
    spec.compile()
    return spec.to_xml()


def _look(spec: mujoco.MjSpec, world: World) -> None:
    area = world.footprint
    center_x_m, center_y_m = _center(area)
    spec.stat.center = [center_x_m, center_y_m, world.ceiling_height_m / 2]
    spec.stat.extent = math.hypot(area.x_max_m - area.x_min_m, area.y_max_m - area.y_min_m) / 2
    spec.visual.headlight.ambient = [0.35, 0.35, 0.35]
    spec.visual.headlight.diffuse = [0.2, 0.2, 0.2]
    spec.visual.headlight.specular = [0.0, 0.0, 0.0]
    spec.visual.quality.shadowsize = 2048
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


def _floors(spec: mujoco.MjSpec, world: World) -> None:
    _plane(spec, GROUND, world.footprint, 0.0, _THRESHOLD_RGBA, margin_m=_GROUND_MARGIN_M)
    for room in world.rooms:
        floor = _plane(spec, FLOOR_PREFIX + room.name, room.floor, FLOOR_LIFT_M, (*room.flooring.color, 1.0))
        floor.contype = 0
        floor.conaffinity = 0


def _plane(
    spec: mujoco.MjSpec,
    name: str,
    area: Rectangle,
    z_m: float,
    rgba: tuple[float, float, float, float],
    *,
    margin_m: float = 0.0,
) -> mujoco.MjsGeom:
    half_x_m = (area.x_max_m - area.x_min_m) / 2 + margin_m
    half_y_m = (area.y_max_m - area.y_min_m) / 2 + margin_m
    return spec.worldbody.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        pos=[*_center(area), z_m],
        size=[half_x_m, half_y_m, _GRID_SPACING_M],
        rgba=list(rgba),
        group=_GROUND_GROUP,
    )


def _solid(spec: mujoco.MjSpec, solid: Solid, group: int) -> None:
    x_m, y_m, z_m = solid.half_extents_m
    cylinder = solid.shape == "cylinder"
    half_yaw_rad = solid.yaw_rad / 2
    spec.worldbody.add_geom(
        name=solid.name,
        type=mujoco.mjtGeom.mjGEOM_CYLINDER if cylinder else mujoco.mjtGeom.mjGEOM_BOX,
        pos=list(solid.center_m),
        size=[x_m, z_m, 0.0] if cylinder else [x_m, y_m, z_m],
        quat=[math.cos(half_yaw_rad), 0.0, 0.0, math.sin(half_yaw_rad)],
        rgba=[*solid.color, 1.0],
        group=group,
    )


def _ceiling(spec: mujoco.MjSpec, world: World) -> None:
    area = world.footprint
    half_x_m, half_y_m = (area.x_max_m - area.x_min_m) / 2, (area.y_max_m - area.y_min_m) / 2
    spec.worldbody.add_geom(
        name=CEILING,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=[*_center(area), world.ceiling_height_m + _CEILING_HALF_THICKNESS_M],
        size=[half_x_m, half_y_m, _CEILING_HALF_THICKNESS_M],
        rgba=list(_CEILING_RGBA),
        group=_CEILING_GROUP,
    )


def _lights(spec: mujoco.MjSpec, world: World) -> None:
    share = 1.0 / max(1, len(world.lights))
    for number, light in enumerate(world.lights, start=1):
        lamp = spec.worldbody.add_light(name=f"light-{number}", pos=list(light.position_m), dir=[0.0, 0.0, -1.0])
        lamp.diffuse = [0.3 + 0.3 * share] * 3
        lamp.specular = [0.05] * 3
        lamp.cutoff = 85.0
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
