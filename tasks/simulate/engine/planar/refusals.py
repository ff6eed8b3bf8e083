"""What the planar engine cannot represent: each culprit by name, with what was found and the remedy."""

from collections.abc import Iterator

import mujoco
import numpy as np

from tasks.simulate.application.part_names import actuator_label, geom_label, joint_label, word_of
from tasks.simulate.application.robot_mjcf import base_of
from tasks.simulate.refusal import RobotRefused

_ELSEWHERE = "or set engine: auto or mujoco"
_UPRIGHT = (mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER)
_ROUND = (mujoco.mjtGeom.mjGEOM_SPHERE, *_UPRIGHT)
# Half a degree: what rounded angles, and fromto, lean by. The outline then is off by a hundredth of the height.
_MOST_LEAN = 0.009
_INTEGRATORS = (mujoco.mjtIntegrator.mjINT_EULER, mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
_WITHOUT = (
    mujoco.mjtDisableBit.mjDSBL_CONSTRAINT,
    mujoco.mjtDisableBit.mjDSBL_CONTACT,
    mujoco.mjtDisableBit.mjDSBL_DAMPER,
    mujoco.mjtDisableBit.mjDSBL_ACTUATION,
)
# The others only watch: energy, comparison with inverse dynamics.
_WITH = (
    mujoco.mjtEnableBit.mjENBL_OVERRIDE,
    mujoco.mjtEnableBit.mjENBL_SLEEP,
    mujoco.mjtEnableBit.mjENBL_DIAGEXACT,
    mujoco.mjtEnableBit.mjENBL_IPC,
)
_TRANSMISSIONS = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT, mujoco.mjtTrn.mjTRN_SITE)
_DYNAMICS = (
    mujoco.mjtDyn.mjDYN_NONE,
    mujoco.mjtDyn.mjDYN_INTEGRATOR,
    mujoco.mjtDyn.mjDYN_FILTER,
    mujoco.mjtDyn.mjDYN_FILTEREXACT,
)
_GAINS = (mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtGain.mjGAIN_AFFINE)
_BIASES = (mujoco.mjtBias.mjBIAS_NONE, mujoco.mjtBias.mjBIAS_AFFINE)
_KNOWN = "spheres, and capsules and cylinders that stand upright"
_INSTEAD = "give it a cylinder as wide as it is, with pos and size"
_ELEMENTS = ("tendon", "eq", "flex", "plugin", "pair", "exclude", "mocap")


def refuse_what_is_not_planar(model: mujoco.MjModel) -> None:
    """Accepts a planar base that the engine can represent.

    Raises:
        RobotRefused: It cannot; names every culprit.
    """
    base = base_of(model)
    checks = (_base,) if base.free or base.articulated else (_options, _elements, _joints, _hull, _actuators)
    faults = [f"robot.xml: {fault}, {_ELSEWHERE}" for check in checks for fault in check(model)]
    if faults:
        raise RobotRefused("the planar engine refuses the robot:\n  " + "\n  ".join(faults))


def colliding_geoms(model: mujoco.MjModel) -> list[int]:
    """Returns the geoms that can touch an obstacle."""
    return [geom for geom in range(model.ngeom) if model.geom_contype[geom] or model.geom_conaffinity[geom]]


def _base(model: mujoco.MjModel) -> Iterator[str]:
    slides_and_hinge = set() if base_of(model).free else {0, 1, 2}
    for joint in range(model.njnt):
        if joint not in slides_and_hinge:
            kind = word_of(mujoco.mjtJoint(model.jnt_type[joint]), "mjJNT_")
            yield f"{joint_label(model, joint)}: {kind}: a planar base slides along x and y and turns: remove it"


def _options(model: mujoco.MjModel) -> Iterator[str]:
    option = model.opt
    if option.integrator not in _INTEGRATORS:
        found = word_of(mujoco.mjtIntegrator(option.integrator), "mjINT_")
        yield f"option integrator {found}: it steps Euler and implicitfast: set one of them"
    if option.cone == mujoco.mjtCone.mjCONE_ELLIPTIC and (model.geom_condim[colliding_geoms(model)] > 1).any():
        yield "option cone elliptic: its friction cones are pyramids: set pyramidal, or condim 1 on the hull"
    if np.any(option.gravity[:2]):
        yield f"option gravity {option.gravity.tolist()}: the floor is level: leave only its z"
    if option.density > 0 or option.viscosity > 0:
        yield f"option density {option.density:g}, viscosity {option.viscosity:g}: there is no air: set both to 0"
    if option.noslip_iterations > 0:
        yield f"option noslip_iterations {option.noslip_iterations}: its contacts are soft: set 0"
    if option.disableactuator:
        yield "option actuatorgroupdisable: all actuators act: delete those that shall not"
    yield from _flags(option)


def _flags(option: mujoco.MjOption) -> Iterator[str]:
    for bit in _WITHOUT:
        if option.disableflags & bit:
            yield f"option flag {word_of(bit, 'mjDSBL_')} disable: it is always on: leave it enabled"
    for bit in _WITH:
        if option.enableflags & bit:
            yield f"option flag {word_of(bit, 'mjENBL_')} enable: it is unknown here: leave it disabled"


def _elements(model: mujoco.MjModel) -> Iterator[str]:
    for element in _ELEMENTS:
        count = getattr(model, f"n{element}")
        if count:
            yield f"{count} {element}: one rigid body is all it moves: remove them"


def _joints(model: mujoco.MjModel) -> Iterator[str]:
    for joint in range(model.njnt):
        name = joint_label(model, joint)
        dof = model.jnt_dofadr[joint]
        if model.jnt_limited[joint]:
            yield f"{name}: range {model.jnt_range[joint].tolist()}: only walls stop the robot: remove the range"
        if model.jnt_stiffness[joint] or model.jnt_stiffnesspoly[joint].any():
            yield f"{name}: stiffness {model.jnt_stiffness[joint]:g}: nothing pulls the robot back: set 0"
        if model.dof_dampingpoly[dof].any():
            yield f"{name}: damping is not linear: give one number"
        if model.qpos0[joint]:
            yield f"{name}: ref {model.qpos0[joint]:g}: the base hangs at 0: remove it"
    if np.any(model.jnt_pos[model.njnt - 1][:2]):
        name, place = joint_label(model, model.njnt - 1), model.jnt_pos[model.njnt - 1]
        yield f"{name}: pos {place.tolist()}: it turns about the base's origin: move geoms and sites instead"


def _hull(model: mujoco.MjModel) -> Iterator[str]:
    geoms = colliding_geoms(model)
    if not geoms:
        yield "no geom collides: give the hull a contype or a conaffinity"
    at_rest = mujoco.MjData(model)
    mujoco.mj_kinematics(model, at_rest)
    base = int(model.jnt_bodyid[0])
    for geom in geoms:
        name = geom_label(model, geom)
        kind = mujoco.mjtGeom(model.geom_type[geom])
        if model.body_weldid[model.geom_bodyid[geom]] != base:
            yield f"{name}: it is fixed to the world: worlds bring their own obstacles: remove it"
        if kind not in _ROUND:
            yield f"{name}: {_article(word_of(kind, 'mjGEOM_'))}: it knows {_KNOWN}: {_INSTEAD}"
        lean = float(np.hypot(*at_rest.geom_xmat[geom][[2, 5]]))
        if kind in _UPRIGHT and lean > _MOST_LEAN:
            found = f"a {word_of(kind, 'mjGEOM_')} that leans by {lean:.2g} from upright"
            yield f"{name}: {found}: it knows {_KNOWN}: {_INSTEAD}, or make it a wheel that does not collide"
        if model.geom_condim[geom] not in {1, 3}:
            yield f"{name}: condim {model.geom_condim[geom]}: it knows 1 and 3: set one of them"
        if model.geom_adhesion[geom] or np.any(model.geom_surfacevel[geom]):
            yield f"{name}: an adhesion or a surface velocity: remove it"


def _article(noun: str) -> str:
    return f"an {noun}" if noun[0] in "aeiou" else f"a {noun}"


def _actuators(model: mujoco.MjModel) -> Iterator[str]:
    for number in range(model.nactuator):
        name = actuator_label(model, number)
        kinds = (
            (mujoco.mjtTrn(model.actuator_trntype[number]), _TRANSMISSIONS, "mjTRN_", "joint and site transmissions"),
            (mujoco.mjtDyn(model.actuator_dyntype[number]), _DYNAMICS, "mjDYN_", "integrators and filters"),
            (mujoco.mjtGain(model.actuator_gaintype[number]), _GAINS, "mjGAIN_", "fixed and affine gains"),
            (mujoco.mjtBias(model.actuator_biastype[number]), _BIASES, "mjBIAS_", "affine biases"),
        )
        for found, known, prefix, what in kinds:
            if found not in known:
                yield f"{name}: {word_of(found, prefix)}: it knows {what}: use one of them"
        site = model.actuator_trntype[number] == mujoco.mjtTrn.mjTRN_SITE
        if site and model.actuator_trnid[number][1] >= 0:
            yield f"{name}: refsite: a site's force acts relative to the site itself: remove refsite"
        if model.actuator_delay[number] or model.actuator_history[number].any():
            yield f"{name}: a delay or a history: let the controller delay"
        if (
            model.actuator_damping[number]
            or model.actuator_armature[number]
            or model.actuator_dampingpoly[number].any()
        ):
            yield f"{name}: a damping or an armature of its own: give them to the joint"
