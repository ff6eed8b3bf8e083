"""Reads a robot from its MJCF: what every engine must know of it, and which robots none can drive."""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float64

from specs.data.episode import CONTROL_S
from tasks.simulate.application.mjcf_check import check_mjcf
from tasks.simulate.application.part_names import body_label
from tasks.simulate.refusal import RobotRefused

_JOINTS = (
    (mujoco.mjtJoint.mjJNT_SLIDE, (1.0, 0.0, 0.0)),
    (mujoco.mjtJoint.mjJNT_SLIDE, (0.0, 1.0, 0.0)),
    (mujoco.mjtJoint.mjJNT_HINGE, (0.0, 0.0, 1.0)),
)
_FLOOR = "simyard/floor"
_FLOOR_FIELDS = ("condim", "friction", "solref", "solimp", "solmix", "margin", "gap", "priority")
_LEVEL = 0.999
_RIM_POINTS = 64


class Hull(NamedTuple):
    """The robot's collision geometry at rest: its radius about the yaw axis and its heights above the floor."""

    radius_m: float
    low_m: float
    high_m: float


class Base(NamedTuple):
    """How a robot stands in the world.

    Attributes:
        body: The one body in the world that moves.
        free: Whether it has a free joint and stands on the floor; else it slides along x and y and turns about z.
        articulated: Whether the robot has more coordinates than the three of a planar base.
    """

    body: int
    free: bool
    articulated: bool


def read_robot_mjcf(path: Path) -> mujoco.MjSpec:
    """Returns a robot's specification without the scenery that its file may hold beside it.

    A time step that does not divide a control step is shortened until it does. A robot with a free joint gets a level
    floor at height 0: the one of its own file, if there is one, or one that is as rough as MuJoCo's default.

    Raises:
        RobotRefused: The file is missing, is not MJCF, holds what no robot needs, or its robot cannot be driven about.
    """
    check_mjcf(path)
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        floor = next((geom for geom in spec.worldbody.geoms if _is_floor(geom)), None)
        ground = {} if floor is None else {name: np.copy(getattr(floor, name)) for name in _FLOOR_FIELDS}
        _delete_scenery(spec)
        base = base_of(compile_robot(spec))
        if base.free:
            _add_floor(spec, ground)
        _shorten_steps(spec)
        compile_robot(spec)
    except (ValueError, OSError) as exc:
        raise RobotRefused(f"{path.name}: {' '.join(str(exc).split())}") from exc
    return spec


def compile_robot(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Returns a specification's model; advice to the author of a robot's file is no warning of ours."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return spec.compile()


def base_of(model: mujoco.MjModel) -> Base:
    """Returns how a robot stands in the world.

    Raises:
        RobotRefused: It stands otherwise, or nothing could drive it.
    """
    moving = [body for body in range(1, model.nbody) if model.body_parentid[body] == 0]
    if len(moving) != 1:
        names = ", ".join(body_label(model, body).removeprefix("body ") for body in moving) or "none"
        raise RobotRefused(
            f"robot.xml: bodies in the world: {names}: one must be the robot's base, and hold all the others"
        )
    if model.nu == 0:
        raise RobotRefused("robot.xml: no actuator: nothing could drive the robot")
    body, joints = moving[0], [joint for joint in range(model.njnt) if model.jnt_bodyid[joint] == moving[0]]
    if joints and model.jnt_type[joints[0]] == mujoco.mjtJoint.mjJNT_FREE:
        return Base(body, free=True, articulated=True)
    _require_planar(model, body, joints)
    return Base(body, free=False, articulated=model.njnt > len(_JOINTS))


def hull_of(model: mujoco.MjModel) -> Hull:
    """Returns the hull of a robot as it stands at the start.

    Raises:
        RobotRefused: Nothing of it collides.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = rest_position(model)
    mujoco.mj_forward(model, data)
    base = base_of(model)
    points = [_outline(model, data, geom) for geom in range(model.ngeom) if _collides(model, geom)]
    if not points:
        raise RobotRefused("robot.xml: no geom collides: give its hull a contype or a conaffinity")
    outline = np.concatenate(points)
    reach = np.hypot(*(outline[:, :2] - data.xpos[base.body][:2]).T) + outline[:, 3]
    low_m, high_m = (outline[:, 2] - outline[:, 3]).min(), (outline[:, 2] + outline[:, 3]).max()
    # What walks may put any part of it on the floor.
    return Hull(float(reach.max()), min(float(low_m), 0.0) if base.free else float(low_m), float(high_m))


def rest_position(model: mujoco.MjModel) -> Float64[np.ndarray, "coordinates"]:
    """Returns a robot's coordinates at the start: those of its first keyframe, if it has one."""
    return np.array(model.key_qpos[0] if model.nkey else model.qpos0)


def collision_bits(spec: mujoco.MjSpec) -> tuple[int, int]:
    """Returns the contype and conaffinity with which an obstacle meets every colliding geom of the robot."""
    contype = conaffinity = 0
    for geom in spec.geoms:
        if geom.name != _FLOOR:
            contype |= geom.conaffinity
            conaffinity |= geom.contype
    return contype, conaffinity


def add_obstacle(
    spec: mujoco.MjSpec, name: str, kind: mujoco.mjtGeom, bits: tuple[int, int], body: mujoco.MjsBody | None = None
) -> mujoco.MjsGeom:
    """Returns a new static geom that leaves friction and contact dimension to the robot's own geoms.

    Args:
        spec: To which it is added.
        name: Of the geom.
        kind: Its shape.
        bits: Its contype and conaffinity, from ``collision_bits``.
        body: Where it is added; the world, if left out.
    """
    geom = (body or spec.worldbody).add_geom(name=name, type=kind)
    geom.contype, geom.conaffinity = bits
    geom.condim = 1
    geom.friction = [0.0, 0.0, 0.0]
    return geom


def _is_floor(geom: mujoco.MjsGeom) -> bool:
    return geom.type == mujoco.mjtGeom.mjGEOM_PLANE and bool(geom.contype or geom.conaffinity)


def _delete_scenery(spec: mujoco.MjSpec) -> None:
    """Deletes what is fixed to the world, with everything in it: the worlds bring their own."""
    for geom in list(spec.worldbody.geoms):
        spec.delete(geom)
    for body in list(spec.worldbody.bodies):
        if not _moves(body):
            spec.delete(body)


def _moves(body: mujoco.MjsBody) -> bool:
    return bool(body.joints) or any(_moves(child) for child in body.bodies)


def _add_floor(spec: mujoco.MjSpec, ground: Mapping[str, object]) -> None:
    bits = collision_bits(spec)
    floor = spec.worldbody.add_geom(name=_FLOOR, type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 1.0])
    floor.contype, floor.conaffinity = bits
    for name, value in ground.items():
        setattr(floor, name, value)


def _shorten_steps(spec: mujoco.MjSpec) -> None:
    if not spec.option.timestep > 0.0:
        raise RobotRefused(f"robot.xml: option timestep {spec.option.timestep:g} s: must be above 0")
    steps = int(np.ceil(CONTROL_S / spec.option.timestep - 1e-6))
    spec.option.timestep = CONTROL_S / max(steps, 1)


def _require_planar(model: mujoco.MjModel, body: int, joints: list[int]) -> None:
    found = [(int(model.jnt_type[joint]), tuple(np.round(model.jnt_axis[joint], 6))) for joint in joints]
    if found != [(int(kind), axis) for kind, axis in _JOINTS]:
        names = ", ".join(_described(model, joint) for joint in joints) or "none"
        raise RobotRefused(
            f"robot.xml: joints of {body_label(model, body)}: {names}: it could not be driven about a floor: a "
            "base has either a free joint, or slide along x, slide along y, hinge about z, in that order and no "
            "others: put <freejoint/> in their place if it walks or rolls by itself, else those three"
        )
    upright = np.allclose(model.body_quat[body], (1, 0, 0, 0)) and np.allclose(model.body_pos[body][:2], 0)
    if not upright:
        raise RobotRefused(
            f"robot.xml: {body_label(model, body)}: a planar base hangs in the world at x = y = 0, unturned"
        )


def _described(model: mujoco.MjModel, joint: int) -> str:
    """Returns a joint's name, and how it moves where an axis along x, y or z says it."""
    kind = mujoco.mjtJoint(model.jnt_type[joint]).name.removeprefix("mjJNT_").lower()
    along = [letter for letter, part in zip("xyz", model.jnt_axis[joint], strict=True) if abs(part) > _LEVEL]
    way = {"slide": "slide along", "hinge": "hinge about"}.get(kind)
    moves = f"{way} {along[0]}" if way and along else kind
    return f"{model.joint(joint).name or 'one without a name'} ({moves})"


def _collides(model: mujoco.MjModel, geom: int) -> bool:
    robots = model.body_weldid[model.geom_bodyid[geom]] != 0
    return bool(robots and (model.geom_contype[geom] or model.geom_conaffinity[geom]))


def _outline(model: mujoco.MjModel, data: mujoco.MjData, geom: int) -> Float64[np.ndarray, "points 4"]:
    """Returns points (x, y, z, radius) whose balls enclose a geom: its own axis, its rims, or its box's corners."""
    kind, size = mujoco.mjtGeom(model.geom_type[geom]), model.geom_size[geom]
    center, turn = data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3)
    if kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_CAPSULE):
        half = size[1] if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else 0.0
        ends = np.stack([center + half * turn[:, 2], center - half * turn[:, 2]])
        return np.hstack([ends, np.full((2, 1), size[0])])
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        angle = 2 * np.pi * np.arange(_RIM_POINTS) / _RIM_POINTS
        rim = size[0] * np.stack([np.cos(angle), np.sin(angle), np.zeros(_RIM_POINTS)], axis=1)
        up = np.array([0.0, 0.0, size[1]])
        own = np.concatenate([rim + up, rim - up])
    else:
        middle, half_extents = model.geom_aabb[geom][:3], model.geom_aabb[geom][3:]
        own = middle + np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T * half_extents
    return np.hstack([center + own @ turn.T, np.zeros((len(own), 1))])
