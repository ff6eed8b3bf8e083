"""A robot read from its MJCF: what the engine must know of it, and what it refuses."""

from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float64

from specs.errors import SimyardError

CONTROL_S = 0.05
_JOINTS = (
    (mujoco.mjtJoint.mjJNT_SLIDE, (1.0, 0.0, 0.0)),
    (mujoco.mjtJoint.mjJNT_SLIDE, (0.0, 1.0, 0.0)),
    (mujoco.mjtJoint.mjJNT_HINGE, (0.0, 0.0, 1.0)),
)
_MJX_HULLS = (
    mujoco.mjtGeom.mjGEOM_SPHERE,
    mujoco.mjtGeom.mjGEOM_CAPSULE,
    mujoco.mjtGeom.mjGEOM_BOX,
    mujoco.mjtGeom.mjGEOM_MESH,
)
_ROUND_HULLS = (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_CAPSULE)


class RobotRefused(SimyardError):  # noqa: N818 - a state
    """A robot.xml that does not load, or that the engine cannot represent; says which element, and the remedy."""


class Hull(NamedTuple):
    """The robot's collision geometry at rest: its radius about the yaw axis and its heights above the floor."""

    radius_m: float
    low_m: float
    high_m: float


def read_robot(path: Path) -> mujoco.MjSpec:
    """Returns a robot's specification without the scenery that its file may hold beside it.

    Raises:
        RobotRefused: The file is missing, is not MJCF, or holds a robot that is no planar base.
    """
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        for geom in list(spec.worldbody.geoms):
            spec.delete(geom)
        model = spec.compile()
    except (ValueError, OSError) as exc:
        raise RobotRefused(f"{path.name}: {exc}") from exc
    _require_planar_base(model)
    _require_even_steps(model)
    return spec


def hull_of(model: mujoco.MjModel) -> Hull:
    """Returns the hull of a robot.

    Raises:
        RobotRefused: Nothing of it collides, or a geom has a shape that MJX cannot collide with boxes.
    """
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    points = [_outline(model, data, geom) for geom in range(model.ngeom) if _collides(model, geom)]
    if not points:
        raise RobotRefused("robot.xml: no geom collides: give its hull a contype or a conaffinity")
    outline = np.concatenate(points)
    axis = data.xpos[model.jnt_bodyid[0]][:2]
    reach = np.hypot(*(outline[:, :2] - axis).T) + outline[:, 3]
    return Hull(
        float(reach.max()), float((outline[:, 2] - outline[:, 3]).min()), float((outline[:, 2] + outline[:, 3]).max())
    )


def _require_planar_base(model: mujoco.MjModel) -> None:
    found = [(model.jnt_type[joint], tuple(np.round(model.jnt_axis[joint], 6))) for joint in range(model.njnt)]
    wanted = [(int(kind), axis) for kind, axis in _JOINTS]
    if [(int(kind), axis) for kind, axis in found] != wanted or len(set(model.jnt_bodyid.tolist())) != 1:
        names = ", ".join(model.joint(joint).name or f"#{joint}" for joint in range(model.njnt)) or "none"
        raise RobotRefused(
            f"robot.xml: joints {names}: the mjx engine drives planar bases: one body with the joints "
            "slide along x, slide along y, hinge about z, in that order and no others"
        )
    body = int(model.jnt_bodyid[0])
    upright = np.allclose(model.body_quat[body], (1, 0, 0, 0)) and np.allclose(model.body_pos[body][:2], 0)
    if model.body_parentid[body] != 0 or not upright:
        raise RobotRefused(
            f"robot.xml: body {model.body(body).name!r}: a planar base hangs in the world at x = y = 0, unturned"
        )
    if model.nu == 0:
        raise RobotRefused("robot.xml: no actuator: nothing could drive the robot")


def _require_even_steps(model: mujoco.MjModel) -> None:
    steps = CONTROL_S / model.opt.timestep
    if steps < 0.999 or abs(steps - round(steps)) > 1e-6:
        raise RobotRefused(
            f"robot.xml: option timestep {model.opt.timestep:g} s: {CONTROL_S} s must be a whole number of steps"
        )


def _collides(model: mujoco.MjModel, geom: int) -> bool:
    return bool(model.geom_contype[geom] or model.geom_conaffinity[geom])


def _outline(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> Float64[np.ndarray, "points 4"]:
    """Returns points (x, y, z, radius) whose balls enclose a geom: its own axis if round, else its box's corners."""
    kind = mujoco.mjtGeom(model.geom_type[geom])
    if kind not in _MJX_HULLS:
        name = model.geom(geom).name or f"#{geom}"
        raise RobotRefused(
            f"robot.xml: geom {name!r}: MJX cannot collide a {kind.name.removeprefix('mjGEOM_').lower()} with boxes: "
            "use a sphere, a capsule, a box or a mesh"
        )
    center, turn = data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3)
    if kind in _ROUND_HULLS:
        half = model.geom_size[geom][1] if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else 0.0
        ends = np.stack([center + half * turn[:, 2], center - half * turn[:, 2]])
        return np.hstack([ends, np.full((2, 1), model.geom_size[geom][0])])
    middle, half_extents = model.geom_aabb[geom][:3], model.geom_aabb[geom][3:]
    signs = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T
    corners = center + (middle + signs * half_extents) @ turn.T
    return np.hstack([corners, np.zeros((8, 1))])
