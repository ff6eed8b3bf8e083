"""Reads a robot from its MJCF: what every engine must know of it, and which robots none can drive.

Also what messages call a robot's parts, and its pose and velocity in the plane from its coordinates, and back.
"""

import contextlib
import logging
import warnings
from collections.abc import Generator, Sequence
from threading import Lock
from types import ModuleType
from typing import Any, NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float64

from tasks.simulate.application.mjcf_check import RobotRefused

_ENDINGS = {1: "st", 2: "nd", 3: "rd"}
_TEENS = (11, 12, 13)


def body_label(model: mujoco.MjModel, body: int) -> str:
    """Returns ``body 'base'``, or ``the 2nd body in body 'base'``."""
    if name := model.body(body).name:
        return f"body {name!r}"
    parent = int(model.body_parentid[body])
    siblings = [each for each in range(1, model.nbody) if model.body_parentid[each] == parent]
    return f"the {_place(siblings, body)} body in {body_label(model, parent) if parent else 'the world'}"


def geom_label(model: mujoco.MjModel, geom: int) -> str:
    """Returns ``geom 'hull'``, or ``the 2nd geom (box) of body 'base'``, as they follow each other in the file."""
    if name := model.geom(geom).name:
        return f"geom {name!r}"
    kind, body = word_of(mujoco.mjtGeom(model.geom_type[geom]), "mjGEOM_"), int(model.geom_bodyid[geom])
    siblings = np.flatnonzero(model.geom_bodyid == body).tolist()
    return f"the {_place(siblings, geom)} geom ({kind}) of {body_label(model, body)}"


def joint_label(model: mujoco.MjModel, joint: int) -> str:
    """Returns ``joint 'x'``, or ``the 2nd joint (slide) of body 'base'``."""
    if name := model.joint(joint).name:
        return f"joint {name!r}"
    kind, body = word_of(mujoco.mjtJoint(model.jnt_type[joint]), "mjJNT_"), int(model.jnt_bodyid[joint])
    siblings = np.flatnonzero(model.jnt_bodyid == body).tolist()
    return f"the {_place(siblings, joint)} joint ({kind}) of {body_label(model, body)}"


def actuator_label(model: mujoco.MjModel, number: int) -> str:
    """Returns ``actuator 'forward'``, or ``the 2nd actuator``."""
    if name := model.actuator(number).name:
        return f"actuator {name!r}"
    return f"the {_place(range(model.nactuator), number)} actuator"


def word_of(member: object, prefix: str) -> str:
    """Returns what MJCF calls a member of one of MuJoCo's enumerations, such as ``box`` for ``mjGEOM_BOX``."""
    return str(getattr(member, "name", member)).removeprefix(prefix).lower()


def _place(siblings: Sequence[int], one: int) -> str:
    number = list(siblings).index(one) + 1
    return f"{number}{'th' if number % 100 in _TEENS else _ENDINGS.get(number % 10, 'th')}"


PLANAR_JOINTS = (
    (mujoco.mjtJoint.mjJNT_SLIDE, (1.0, 0.0, 0.0)),
    (mujoco.mjtJoint.mjJNT_SLIDE, (0.0, 1.0, 0.0)),
    (mujoco.mjtJoint.mjJNT_HINGE, (0.0, 0.0, 1.0)),
)
FLOOR = "simyard/floor"
_LEVEL = 0.999
_RIM_POINTS = 64


class Hull(NamedTuple):
    """The robot's collision geometry at rest: its radius about the yaw axis, its heights above the floor, and its mass.

    Attributes:
        mass_kg: Of all that moves.
    """

    radius_m: float
    low_m: float
    high_m: float
    mass_kg: float


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
    return Base(body, free=False, articulated=model.njnt > len(PLANAR_JOINTS))


def hull_of(model: mujoco.MjModel) -> Hull:
    """Returns the hull of a robot as it stands at the start.

    Raises:
        RobotRefused: Nothing of it collides.
    """
    data, base = resting(model), base_of(model)
    outline = outline_of(model, data, robot_geoms(model))
    reach = np.hypot(*(outline[:, :2] - data.xpos[base.body][:2]).T) + outline[:, 3]
    low_m, high_m = (outline[:, 2] - outline[:, 3]).min(), (outline[:, 2] + outline[:, 3]).max()
    # What walks may put any part of it on the floor.
    lowest_m = min(float(low_m), 0.0) if base.free else float(low_m)
    return Hull(float(reach.max()), lowest_m, float(high_m), float(model.body_subtreemass[base.body]))


def robot_geoms(model: mujoco.MjModel) -> list[int]:
    """Returns the geoms of a robot that collide.

    Raises:
        RobotRefused: None does.
    """
    moving = model.body_weldid[model.geom_bodyid] != 0
    found = np.flatnonzero(moving & ((model.geom_contype != 0) | (model.geom_conaffinity != 0))).tolist()
    if not found:
        raise RobotRefused("robot.xml: no geom collides: give its hull a contype or a conaffinity")
    return found


def resting(model: mujoco.MjModel) -> mujoco.MjData:
    """Returns where a robot's parts are at the start, in the base's own frame: unturned about z, at x = y = 0."""
    data, base, rest = mujoco.MjData(model), base_of(model), rest_position(model)
    turned_rad = pose_of(base, rest, np)[2] if base.free else 0.0
    data.qpos[:] = coordinates_at(base, rest, np.array([0.0, 0.0, -turned_rad]), np)
    mujoco.mj_kinematics(model, data)
    return data


def outline_of(model: mujoco.MjModel, data: mujoco.MjData, geoms: Sequence[int]) -> Float64[np.ndarray, "points 4"]:
    """Returns points (x, y, z, radius) whose balls enclose geoms."""
    return np.concatenate([_outline(model, data, geom) for geom in geoms])


def rest_position(model: mujoco.MjModel) -> Float64[np.ndarray, "coordinates"]:
    """Returns a robot's coordinates at the start: those of its first keyframe, if it has one."""
    return np.array(model.key_qpos[0] if model.nkey else model.qpos0)


def rest_control(model: mujoco.MjModel) -> Float64[np.ndarray, "actuators"]:
    """Returns what a robot's actuators get at the start, until something is commanded; likewise."""
    return np.array(model.key_ctrl[0] if model.nkey else np.zeros(model.nu))


def collision_bits(spec: mujoco.MjSpec) -> tuple[int, int]:
    """Returns the contype and conaffinity with which an obstacle meets every colliding geom of the robot."""
    contype = conaffinity = 0
    for geom in spec.geoms:
        if geom.name != FLOOR:
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
    geom = without_shape((body or spec.worldbody).add_geom(name=name, type=kind))
    geom.contype, geom.conaffinity = bits
    geom.condim = 1
    geom.friction = [0.0, 0.0, 0.0]
    return geom


def add_prism_mesh(
    spec: mujoco.MjSpec, name: str, corners_m: Float64[np.ndarray, "corners 2"], half_height_m: float
) -> None:
    """Adds an upright prism's mesh, as it is whatever defaults the robot's file has for meshes."""
    ends = [np.insert(corners_m, 2, height, axis=1) for height in (-half_height_m, half_height_m)]
    mesh = spec.add_mesh(name=name, uservert=np.concatenate(ends).ravel().tolist())
    mesh.scale, mesh.refpos, mesh.refquat = [1.0] * 3, [0.0] * 3, [1.0, 0.0, 0.0, 0.0]
    mesh.inertia, mesh.maxhullvert = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX, -1


def without_shape(geom: mujoco.MjsGeom) -> mujoco.MjsGeom:
    """Returns a new geom of ours without what a default of the robot's file makes of its shape and its orientation."""
    geom.fromto[0] = np.nan
    geom.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    geom.pos, geom.quat = [0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]
    geom.meshname = geom.hfieldname = ""
    return geom


def _require_planar(model: mujoco.MjModel, body: int, joints: list[int]) -> None:
    found = [(int(model.jnt_type[joint]), tuple(np.round(model.jnt_axis[joint], 6))) for joint in joints]
    if found != [(int(kind), axis) for kind, axis in PLANAR_JOINTS]:
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


# Arrays of either library.
Arrays = Any
_PLACE = 3  # x, y and height come first in a free joint's coordinates, then its quaternion
_POSE = 7


# The functions take NumPy or ``jax.numpy``, as the arrays are; coordinates are in the last axis.
def coordinates_at(base: Base, rest: Arrays, start: Arrays, numbers: ModuleType) -> Arrays:
    """Returns the coordinates of a robot at a start (x m, y m, yaw rad), as tall as it rests, turned about z.

    Args:
        base: How the robot stands in the world.
        rest: Its coordinates at rest.
        start: Where it shall stand.
        numbers: NumPy or ``jax.numpy``.
    """
    others = numbers.broadcast_to(rest, (*start.shape[:-1], rest.shape[-1]))
    if not base.free:
        return numbers.concatenate([start, others[..., 3:]], axis=-1)
    turned = _turned_about_z(start[..., 2], others[..., _PLACE:_POSE], numbers)
    return numbers.concatenate([start[..., :2], others[..., 2:3], turned, others[..., _POSE:]], axis=-1)


def pose_of(base: Base, qpos: Arrays, numbers: ModuleType) -> Arrays:
    """Returns (x m, y m, yaw rad); yaw from -pi to pi for a robot with a free joint, else counted on."""
    if not base.free:
        return qpos[..., :3]
    w, x, y, z = (qpos[..., _PLACE + k] for k in range(4))
    yaw = numbers.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return numbers.concatenate([qpos[..., :2], yaw[..., None]], axis=-1)


def velocity_of(base: Base, qpos: Arrays, qvel: Arrays, numbers: ModuleType) -> Arrays:
    """Returns (m/s, m/s, rad/s) along the world's axes.

    A free joint's turn rates are along the body's own axes (MuJoCo documentation, "Floating objects").

    Args:
        base: How the robot stands in the world.
        qpos: Its coordinates.
        qvel: Its speeds.
        numbers: NumPy or ``jax.numpy``.
    """
    if not base.free:
        return qvel[..., :3]
    w, x, y, z = (qpos[..., _PLACE + k] for k in range(4))
    upward = (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y))
    about_x, about_y, about_z = (share * qvel[..., _PLACE + k] for k, share in enumerate(upward))
    turn = about_x + about_y + about_z
    return numbers.concatenate([qvel[..., :2], turn[..., None]], axis=-1)


def _turned_about_z(yaw_rad: Arrays, quaternion: Arrays, numbers: ModuleType) -> Arrays:
    cos, sin = numbers.cos(yaw_rad / 2.0), numbers.sin(yaw_rad / 2.0)
    w, x, y, z = (quaternion[..., k] for k in range(4))
    return numbers.stack([cos * w - sin * z, cos * x - sin * y, cos * y + sin * x, cos * z + sin * w], axis=-1)


logger = logging.getLogger(__name__)


class _QuietSteps:
    """How many threads step now, while MuJoCo's warnings go to this module's log."""

    turn = Lock()
    threads = 0


@contextlib.contextmanager
def no_log() -> Generator[None]:
    """Keeps MuJoCo from writing MUJOCO_LOG.TXT into the working directory: a state that blows up is a row."""
    with _QuietSteps.turn:
        _QuietSteps.threads += 1
        mujoco.set_mju_user_warning(logger.debug)
    try:
        yield
    finally:
        with _QuietSteps.turn:
            _QuietSteps.threads -= 1
            if not _QuietSteps.threads:
                mujoco.set_mju_user_warning(None)
