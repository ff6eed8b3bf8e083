"""Shapes that MJX can collide in place of a planar base's cylinders, exact where the base can bring them.

A planar base neither tips nor rises. So an upright cylinder that is as tall as the whole hull meets every obstacle with
its side, as a capsule does; and a cylinder that lies, such as a wheel that does not turn, meets what is as tall as its
axis with what it looks like from above, as a box does. An obstacle that ends below the axis meets the box earlier.
"""

import mujoco
import numpy as np

from tasks.simulate.application.robot_mjcf import base_of, compile_robot, hull_of, rest_position

# Half a degree from upright or from lying: what rounded angles lean by.
_LEAN = 0.009
_HIGHER_M = 1e-6
_COPIED = ("contype", "conaffinity", "condim", "friction", "solref", "solimp", "solmix", "margin", "gap", "priority")


def with_stand_ins(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Returns a robot's model, in whose specification a planar base's cylinders have got shapes in their place.

    A cylinder keeps its mass, and touches nothing. Those of other bodies, and those that lean, stay as they are.
    """
    alone = compile_robot(spec)
    if base_of(alone).free:
        return alone
    data = mujoco.MjData(alone)
    data.qpos[:] = rest_position(alone)
    mujoco.mj_kinematics(alone, data)
    # What is added takes the numbers from all parts of the specification.
    body = next(each for each in spec.bodies if each.id == base_of(alone).body)
    for geom, number in [(each, each.id) for each in spec.geoms if _is_bases_cylinder(alone, each)]:
        _stand_in(body, geom, number, data)
    return compile_robot(spec)


def _is_bases_cylinder(alone: mujoco.MjModel, geom: mujoco.MjsGeom) -> bool:
    of_base = alone.body_weldid[alone.geom_bodyid[geom.id]] == base_of(alone).body
    return bool(of_base and geom.type == mujoco.mjtGeom.mjGEOM_CYLINDER and (geom.contype or geom.conaffinity))


def _stand_in(body: mujoco.MjsBody, geom: mujoco.MjsGeom, number: int, data: mujoco.MjData) -> None:
    alone, base = data.model, base_of(data.model).body
    center, axis = data.geom_xpos[number], data.geom_xmat[number].reshape(3, 3)[:, 2]
    radius, half = alone.geom_size[number][:2]
    hull, ahead = hull_of(alone), data.xmat[base].reshape(3, 3)
    whole = center[2] - half <= hull.low_m + _HIGHER_M and center[2] + half >= hull.high_m - _HIGHER_M
    if abs(axis[2]) < _LEAN:
        kind, size = mujoco.mjtGeom.mjGEOM_BOX, [half, radius, radius]
        turn_rad = float(np.arctan2(axis[1], axis[0]) - np.arctan2(ahead[1, 0], ahead[0, 0]))
    elif np.hypot(axis[0], axis[1]) < _LEAN and whole:
        kind, size, turn_rad = mujoco.mjtGeom.mjGEOM_CAPSULE, [radius, half, 0.0], 0.0
    else:
        return
    new = body.add_geom(type=kind, size=size, mass=0.0)
    new.pos = ahead.T @ (center - data.xpos[base])
    new.quat = [np.cos(turn_rad / 2.0), 0.0, 0.0, np.sin(turn_rad / 2.0)]
    for name in _COPIED:
        setattr(new, name, np.copy(getattr(geom, name)))
    geom.contype = geom.conaffinity = 0
