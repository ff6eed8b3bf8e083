"""Solids and planes as geoms of an MJCF.

Hinged doors of an MJCF: a leaf that a robot can push, standing as the world says.
"""

import math

import mujoco

from specs.data.world import Door, Rectangle, Solid

# Groups 0 to 2 are drawn by default: the walls and the ceiling can be switched off one by one.
GROUND_GROUP, WALL_GROUP, FURNITURE_GROUP, CEILING_GROUP = 0, 1, 2, 3
GRID_SPACING_M = 0.5  # MuJoCo lights corners and interpolates: no corner is further than this from the next


def add_solid_geom(
    body: mujoco.MjsBody, solid: Solid, group: int, *, origin_m: tuple[float, float] = (0.0, 0.0)
) -> mujoco.MjsGeom:
    """Returns a new geom of a solid's name, shape and colour in a body that stands, not turned, at ``origin_m``.

    Args:
        body: What the geom becomes part of.
        solid: The solid.
        group: MuJoCo's visual group.
        origin_m: Where the body stands.
    """
    x_m, y_m, z_m = solid.half_extents_m
    cylinder = solid.shape == "cylinder"
    half_yaw_rad = solid.yaw_rad / 2
    return body.add_geom(
        name=solid.name,
        type=mujoco.mjtGeom.mjGEOM_CYLINDER if cylinder else mujoco.mjtGeom.mjGEOM_BOX,
        pos=[solid.center_m[0] - origin_m[0], solid.center_m[1] - origin_m[1], solid.center_m[2]],
        size=[x_m, z_m, 0.0] if cylinder else [x_m, y_m, z_m],
        quat=[math.cos(half_yaw_rad), 0.0, 0.0, math.sin(half_yaw_rad)],
        rgba=[*solid.color, 1.0],
        group=group,
    )


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
    add_solid_geom(body, door.leaf, FURNITURE_GROUP, origin_m=door.hinge_m).density = _DENSITY_KG_M3
