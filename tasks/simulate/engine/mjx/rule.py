"""The rule by which MJX is faster than C MuJoCo on a CPU, from a ``robot.xml`` alone; it imports no JAX.

On a CPU, MJX's smooth dynamics are faster than C's, all lanes at once, and its constraints are slower. So it wins where
only obstacles can hold a robot, which most robots are away from in most control steps, and loses where the floor,
joints' limits or the robot itself hold it in each of them (docs/decisions/0037-mjx-where-only-obstacles-hold.md).
"""

from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np

from tasks.simulate.application.part_names import geom_label, joint_label
from tasks.simulate.application.robot_mjcf import base_of, compile_robot, hull_of, read_robot_mjcf
from tasks.simulate.engine.mjx.refusals import refuse_what_mjx_lacks
from tasks.simulate.engine.mjx.stand_ins import with_stand_ins

# A base's own three: an arm on it was eleven times slower (docs/reference/engines.md, "How fast"). More geoms that
# collide were not faster either, and programs take long to compile.
_MOST_SPEEDS, _MOST_GEOMS = 3, 4
_ELEMENTS = ("tendon", "eq", "flex", "plugin", "pair", "mocap", "sensor")
_INTEGRATORS = (mujoco.mjtIntegrator.mjINT_EULER, mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
_TRANSMISSIONS = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT, mujoco.mjtTrn.mjTRN_SITE)
_SHAPES = (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_BOX)


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
    if model.opt.integrator not in _INTEGRATORS:
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
