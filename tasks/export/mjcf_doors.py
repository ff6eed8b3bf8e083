"""Hinged doors of an MJCF: a leaf that a robot can push, standing as the world says."""

import math

import mujoco

from specs.world import Door
from tasks.export.mjcf_solids import FURNITURE_GROUP, add_solid

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
    add_solid(body, door.leaf, FURNITURE_GROUP, origin_m=door.hinge_m).density = _DENSITY_KG_M3
