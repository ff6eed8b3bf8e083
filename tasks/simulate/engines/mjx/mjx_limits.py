"""What MJX cannot represent, and where C MuJoCo is faster on a CPU, from a ``robot.xml`` alone; it imports no JAX.

A refusal names each culprit, with the remedy. A planar base's cylinders have stand-ins that MJX can collide, exact
where the base can bring them.
"""

from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np

from tasks.simulate.application.mjcf_check import RobotRefused
from tasks.simulate.application.robot_file import read_robot_mjcf
from tasks.simulate.application.robot_model import (
    base_of,
    compile_robot,
    geom_label,
    hull_of,
    joint_label,
    rest_position,
    word_of,
)

_ELSEWHERE = "or set engine: mujoco"
# Obstacles are boxes, and capsules in place of cylinders.
_AMONG_BOXES = (
    mujoco.mjtGeom.mjGEOM_PLANE,
    mujoco.mjtGeom.mjGEOM_SPHERE,
    mujoco.mjtGeom.mjGEOM_CAPSULE,
    mujoco.mjtGeom.mjGEOM_BOX,
    mujoco.mjtGeom.mjGEOM_MESH,
)
_INTEGRATORS = (
    mujoco.mjtIntegrator.mjINT_EULER,
    mujoco.mjtIntegrator.mjINT_RK4,
    mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
)

_CONTACT_CAPS = ("max_contact_points", "max_geom_pairs")


def refuse_what_mjx_lacks(model: mujoco.MjModel) -> None:
    """Accepts a robot that MJX can step, as far as can be said without asking MJX itself.

    Raises:
        RobotRefused: It cannot; names every culprit.
    """
    faults = [f"robot.xml: {fault}, {_ELSEWHERE}" for check in (_options, _geoms) for fault in check(model)]
    if faults:
        raise RobotRefused("the mjx engine refuses the robot:\n  " + "\n  ".join(faults))


def _options(model: mujoco.MjModel) -> Iterator[str]:
    if model.opt.integrator not in _INTEGRATORS:
        found = word_of(mujoco.mjtIntegrator(model.opt.integrator), "mjINT_")
        yield f"option integrator {found}: MJX steps Euler, RK4 and implicitfast: set one of them"
    for name in (model.numeric(number).name for number in range(model.nnumeric)):
        if name in _CONTACT_CAPS:
            yield f"custom numeric {name}: MJX would drop the contacts beyond it, with walls, too: remove it"
    frictionless = [geom for geom in _colliding(model) if model.geom_condim[geom] == 1]
    if model.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC and frictionless:
        name = geom_label(model, frictionless[0])
        yield f"option cone elliptic: MJX has no frictionless contacts then, as of {name}: set pyramidal"


def _geoms(model: mujoco.MjModel) -> Iterator[str]:
    for geom in _colliding(model):
        kind, name = mujoco.mjtGeom(model.geom_type[geom]), geom_label(model, geom)
        if kind not in _AMONG_BOXES:
            word = word_of(kind, "mjGEOM_")
            yield f"{name}: MJX cannot collide a {word} with boxes: use a sphere, a capsule, a box or a mesh"
        if model.geom_margin[geom] and kind == mujoco.mjtGeom.mjGEOM_MESH:
            yield f"{name}: margin {model.geom_margin[geom]:g}: MJX gives meshes none: set 0"


def _colliding(model: mujoco.MjModel) -> list[int]:
    return [geom for geom in range(model.ngeom) if model.geom_contype[geom] or model.geom_conaffinity[geom]]


# Half a degree from upright or from lying: what rounded angles lean by.
_LEAN = 0.009
_HIGHER_M = 1e-6
_COPIED = ("contype", "conaffinity", "condim", "friction", "solref", "solimp", "solmix", "margin", "gap", "priority")


# A planar base neither tips nor rises. So an upright cylinder that is as tall as the whole hull meets every obstacle
# with its side, as a capsule does; and a cylinder that lies, such as a wheel that does not turn, meets what is as
# tall as its axis with what it looks like from above, as a box does. An obstacle that ends below the axis meets the
# box earlier.
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


# A base's own three: an arm on it was eleven times slower (docs/reference/engines.md, "How fast"). More geoms that
# collide were not faster either, and programs take long to compile.
_MOST_SPEEDS, _MOST_GEOMS = 3, 4
_ELEMENTS = ("tendon", "eq", "flex", "plugin", "pair", "mocap", "sensor")
_FAST_INTEGRATORS = (mujoco.mjtIntegrator.mjINT_EULER, mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
_TRANSMISSIONS = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT, mujoco.mjtTrn.mjTRN_SITE)
_SHAPES = (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_BOX)


# On a CPU, MJX's smooth dynamics are faster than C's, all lanes at once, and its constraints are slower. So it wins
# where only obstacles can hold a robot, which most robots are away from in most control steps, and loses where the
# floor, joints' limits or the robot itself hold it in each of them
# (docs/decisions/0037-mjx-where-only-obstacles-hold.md).
def why_slower_on_a_cpu(path: Path) -> str:
    """Returns why C MuJoCo is faster with a ``robot.xml`` on a CPU; nothing where MJX is.

    Raises:
        RobotRefused: MJX cannot step it, or no engine can drive it.
    """
    spec = read_robot_mjcf(path)
    hull_of(compile_robot(spec))
    model = with_stand_ins(spec)
    refuse_what_mjx_lacks(model)
    return next(_reasons(model), "")


def _reasons(model: mujoco.MjModel) -> Iterator[str]:
    if base_of(model).free:
        yield "the floor holds it"
    held = np.flatnonzero(model.jnt_limited | (model.dof_frictionloss[model.jnt_dofadr] > 0))
    if len(held):
        yield f"{joint_label(model, int(held[0]))} has a limit or friction"
    if any(getattr(model, f"n{name}") for name in _ELEMENTS):
        yield "it has more than joints, geoms and actuators"
    colliding = [geom for geom in range(model.ngeom) if model.geom_contype[geom] or model.geom_conaffinity[geom]]
    odd = [geom for geom in colliding if mujoco.mjtGeom(model.geom_type[geom]) not in _SHAPES]
    if odd:
        yield f"{geom_label(model, odd[0])} is no sphere, capsule or box"
    if _touches_itself(model, colliding):
        yield "its parts can touch each other"
    if model.nv > _MOST_SPEEDS or len(colliding) > _MOST_GEOMS:
        yield f"it has more than {_MOST_SPEEDS} degrees of freedom, or {_MOST_GEOMS} geoms that collide"
    if model.opt.integrator not in _FAST_INTEGRATORS:
        yield "its integrator takes several steps in one"
    if any(mujoco.mjtTrn(kind) not in _TRANSMISSIONS for kind in model.actuator_trntype):
        yield "an actuator drives neither a joint nor a site"


def _touches_itself(model: mujoco.MjModel, colliding: list[int]) -> bool:
    """Returns whether two parts can touch, by bodies and bits (MuJoCo documentation, "Collision detection")."""
    excluded = set(model.exclude_signature.tolist())
    for place, one in enumerate(colliding):
        for other in colliding[place + 1 :]:
            first, second = sorted((int(model.geom_bodyid[one]), int(model.geom_bodyid[other])))
            meet = (model.geom_contype[one] & model.geom_conaffinity[other]) or (
                model.geom_contype[other] & model.geom_conaffinity[one]
            )
            related = _related(model, first, second)
            if meet and not related and (first << 16) + second not in excluded:
                return True
    return False


def _related(model: mujoco.MjModel, first: int, second: int) -> bool:
    """Returns whether two bodies are one, or one holds the other, so that MuJoCo lets them pass."""
    one, other = int(model.body_weldid[first]), int(model.body_weldid[second])
    above_one, above_other = (int(model.body_weldid[model.body_parentid[each]]) for each in (one, other))
    return other in {one, above_one} or above_other == one
