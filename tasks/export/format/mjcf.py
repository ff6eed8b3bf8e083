"""A world as MJCF: loads in MuJoCo as it is, with every solid a geom of the solid's name.

Floors and walls have materials from finishes, sheets stand in front of the walls, and windows are seen only.

Collision is what the world says and nothing else: one ground plane and the solids. What shows floorings, wall coverings
and windows are sheets a millimetre in front of them: cameras see them and rays hit them, and they touch nothing. The
leaf of a hinged door can be pushed by a robot, and stands as the world says.
"""

import math
from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float, Int

from specs.data.world import Door, Finish, Rectangle, Room, Solid, World, solids
from tasks.render.sheets import (
    FLOOR_PREFIX,
    SKIN_LIFT_M,
    WALLS_PREFIX,
    Panel,
    finish_key,
    prism_mesh,
    triangles_of,
    wall_panels,
    window_parts,
)
from tasks.render.textures import texture_of

# Groups 0 to 2 are drawn by default: the walls and the ceiling can be switched off one by one.
GROUND_GROUP, WALL_GROUP, FURNITURE_GROUP, CEILING_GROUP = 0, 1, 2, 3
_GEOMS = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "prism": mujoco.mjtGeom.mjGEOM_MESH,
}
GRID_SPACING_M = 0.5  # MuJoCo lights corners and interpolates: no corner is further than this from the next


def add_solid_geom(
    spec: mujoco.MjSpec,
    solid: Solid,
    group: int,
    *,
    body: mujoco.MjsBody | None = None,
    origin_m: tuple[float, float] = (0.0, 0.0),
) -> mujoco.MjsGeom:
    """Returns a new geom of a solid's name, shape and colour in a body that stands, not turned, at ``origin_m``.

    Args:
        spec: The model.
        solid: The solid.
        group: MuJoCo's visual group.
        body: What the geom becomes part of; the world body if None.
        origin_m: Where the body stands.
    """
    x_m, y_m, z_m = solid.half_extents_m
    half_yaw_rad = solid.yaw_rad / 2
    geom = (body or spec.worldbody).add_geom(
        name=solid.name,
        type=_GEOMS[solid.shape],
        pos=[solid.center_m[0] - origin_m[0], solid.center_m[1] - origin_m[1], solid.center_m[2]],
        quat=[math.cos(half_yaw_rad), 0.0, 0.0, math.sin(half_yaw_rad)],
        rgba=[*solid.color, 1.0],
        group=group,
    )
    if solid.shape == "prism":
        geom.meshname = _prism(spec, solid)
    else:
        geom.size = [x_m, z_m, 0.0] if solid.shape == "cylinder" else [x_m, y_m, z_m]
    return geom


def _prism(spec: mujoco.MjSpec, solid: Solid) -> str:
    """Returns the name of a new mesh with a prism's corners, about its centre."""
    corners, faces = prism_mesh(solid)
    mesh = spec.add_mesh(name=solid.name, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX)
    mesh.uservert = corners.ravel()
    mesh.userface = np.array(triangles_of(faces)).ravel()
    return solid.name


def add_plane(spec: mujoco.MjSpec, name: str, area: Rectangle, z_m: float, *, margin_m: float = 0.0) -> mujoco.MjsGeom:
    """Returns a new level plane over an area, ``margin_m`` wider on every side.

    Args:
        spec: The model.
        name: Of the plane.
        area: What it lies under or over.
        z_m: Its height.
        margin_m: How much wider than the area it is on every side.
    """
    half_x_m = (area.x_max_m - area.x_min_m) / 2 + margin_m
    half_y_m = (area.y_max_m - area.y_min_m) / 2 + margin_m
    return spec.worldbody.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        pos=[(area.x_min_m + area.x_max_m) / 2, (area.y_min_m + area.y_max_m) / 2, z_m],
        size=[half_x_m, half_y_m, GRID_SPACING_M],
        group=GROUND_GROUP,
    )


HINGE_SUFFIX = "/hinge"
# A leaf of 0.85 x 2.08 x 0.04 m then weighs 21 kg, as hollow-core doors do (15 to 25 kg in makers' data sheets).
_DENSITY_KG_M3 = 300.0
# Enough that a leaf stays where it is left and stops soon after it was pushed; little against a robot's push: 2 N at
# the handle.
_FRICTION_NM, _DAMPING_NM_S = 1.5, 1.5


def add_door(spec: mujoco.MjSpec, door: Door) -> None:
    """Adds a door as a body with a hinge whose position is the opening in radians: 0 shut, a quarter turn open.

    The model's reference configuration (qpos0) is the door as it stands.
    """
    quarter_rad = math.remainder(door.open_yaw_rad - door.closed_yaw_rad, 2 * math.pi)
    body = spec.worldbody.add_body(name=door.name, pos=[*door.hinge_m, 0.0])
    body.add_joint(
        name=door.name + HINGE_SUFFIX,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=[0.0, 0.0, math.copysign(1.0, quarter_rad)],
        ref=abs(quarter_rad) * door.open_percent / 100.0,
        range=[0.0, abs(quarter_rad)],
        limited=mujoco.mjtLimited.mjLIMITED_TRUE,
        damping=_DAMPING_NM_S,
        frictionloss=_FRICTION_NM,
    )
    add_solid_geom(spec, door.leaf, FURNITURE_GROUP, body=body, origin_m=door.hinge_m).density = _DENSITY_KG_M3


TEXTURE_FOLDER = "textures"

FLOOR_LIFT_M = 0.001


# Everything here is seen by cameras and hit by rays, and touches nothing.
def add_floor(spec: mujoco.MjSpec, room: Room) -> None:
    """Adds the sheet that shows a room's flooring, a millimetre above the ground."""
    geom = add_plane(spec, FLOOR_PREFIX + room.name, room.floor, FLOOR_LIFT_M)
    geom.material = name = f"floor-{finish_key(room.flooring)}"
    _untouchable(geom)
    if spec.material(name) is not None:
        return
    material = _add_material(spec, name, room.flooring)
    texture = texture_of(room.flooring)
    if texture is not None:
        # Measured on MuJoCo 3.17: on a plane, "repetitions per unit" counts units of two metres.
        material.texuniform = True
        material.texrepeat = [2.0 / texture.extent_m[0], 2.0 / texture.extent_m[1]]


def add_walls(spec: mujoco.MjSpec, world: World, room: Room, number: int) -> None:
    """Adds one mesh with all that one sees of the walls in a room; seen from behind it is not there.

    Args:
        spec: The model.
        world: Whose walls.
        room: The room that they are seen from.
        number: The room's place among the world's, for the mesh's name.
    """
    panels = wall_panels(world, room)
    if not panels:
        return
    texture = texture_of(room.walls)
    grids = [_grid(panel, texture.extent_m if texture else (1.0, 1.0)) for panel in panels]
    offsets = np.cumsum([0, *(len(vertices) for vertices, _, _ in grids[:-1])])
    mesh = spec.add_mesh(name=f"walls-{number}", inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    mesh.uservert = np.concatenate([vertices for vertices, _, _ in grids]).ravel()
    mesh.usertexcoord = np.concatenate([coordinates for _, coordinates, _ in grids]).ravel()
    mesh.userface = np.concatenate(
        [faces + offset for (_, _, faces), offset in zip(grids, offsets, strict=True)]
    ).ravel()
    geom = spec.worldbody.add_geom(
        name=WALLS_PREFIX + room.name,
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=mesh.name,
        group=WALL_GROUP,
    )
    _untouchable(geom)
    geom.material = name = f"walls-{finish_key(room.walls)}"
    if spec.material(name) is None:
        _add_material(spec, name, room.walls)


def add_windows(spec: mujoco.MjSpec, world: World, room: Room) -> None:
    """Adds a room's windows."""
    for part in window_parts(world, room):
        _untouchable(add_solid_geom(spec, part, WALL_GROUP))


def _add_material(spec: mujoco.MjSpec, name: str, finish: Finish) -> mujoco.MjsMaterial:
    """Returns a new material; its texture's file is in ``spec.assets`` under the name that the model says."""
    material = spec.add_material(name=name, specular=0.1, shininess=0.1)
    texture = texture_of(finish)
    if texture is None:
        material.rgba = [*finish.color, 1.0]
        return material
    key = finish_key(finish)
    if spec.texture(key) is None:
        file = f"{TEXTURE_FOLDER}/{key}.png"
        spec.assets = {**spec.assets, file: texture.png}
        spec.add_texture(name=key, type=mujoco.mjtTexture.mjTEXTURE_2D, file=file)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = key
    return material


def _untouchable(geom: mujoco.MjsGeom) -> None:
    geom.contype = 0
    geom.conaffinity = 0


def _grid(
    panel: Panel, extent_m: tuple[float, float]
) -> tuple[Float[np.ndarray, "points 3"], Float[np.ndarray, "points 2"], Int[np.ndarray, "faces 3"]]:
    """Returns a panel as vertices, texture coordinates and triangles that face the room."""
    along_m, up_m = _steps(panel.start_m, panel.end_m), _steps(panel.bottom_m, panel.top_m)
    points = [(a_m, z_m) for z_m in up_m for a_m in along_m]
    vertices = np.array([(*panel.side.point_m(a_m, SKIN_LIFT_M), z_m) for a_m, z_m in points])
    coordinates = np.array(points) / np.array(extent_m)
    columns = len(along_m)
    first = np.array([row * columns + column for row in range(len(up_m) - 1) for column in range(columns - 1)])
    second, above = first + 1, first + columns
    lower, upper = np.stack([first, second, above], axis=1), np.stack([second, above + 1, above], axis=1)
    faces = np.concatenate([lower, upper])
    # Anticlockwise from within: x runs to the left of one who looks north to south, y to the right from east to west.
    turned = (panel.side.along == "x") == (panel.side.inwards == 1)
    return vertices, coordinates, faces[:, ::-1] if turned else faces


def _steps(start_m: float, end_m: float) -> Sequence[float]:
    count = max(1, math.ceil((end_m - start_m) / (2 * GRID_SPACING_M)))
    return [start_m + (end_m - start_m) * number / count for number in range(count + 1)]


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
        add_solid_geom(spec, wall, WALL_GROUP)
    for door in world.doors:
        add_door(spec, door)
    for piece in world.furniture:
        for solid in piece.solids:
            add_solid_geom(spec, solid, FURNITURE_GROUP)
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
