"""Reads a planar base from the model that MuJoCo compiled, as numbers: discs, motors, dry friction, and masses.

What the planar engine cannot represent is refused: each culprit by name, with what was found and the remedy.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float64

from specs.data.episode import CONTROL_S
from tasks.simulate.application.mjcf_check import RobotRefused
from tasks.simulate.application.robot_file import read_robot_mjcf
from tasks.simulate.application.robot_model import (
    Hull,
    actuator_label,
    add_obstacle,
    base_of,
    collision_bits,
    compile_robot,
    geom_label,
    hull_of,
    joint_label,
    rest_control,
    word_of,
)


@dataclass(frozen=True)
class Softness:
    """How a constraint row gives way (MuJoCo documentation, "Solver parameters").

    Attributes:
        stiffness: MuJoCo's k (1/s2).
        damping: MuJoCo's b (1/s).
        inverse_mass: What (1 - d) / d is multiplied with to give the regularizer R, d being the impedance.
        impedance: (d at the margin, d at full width, width in metres, midpoint, power).
    """

    stiffness: float
    damping: float
    inverse_mass: float
    impedance: tuple[float, float, float, float, float]


@dataclass(frozen=True)
class Disc:
    """A sphere, or an upright capsule or cylinder of the hull: a disc, seen from above.

    Attributes:
        forward_m, left_m: Its axis in the base's frame.
        height_m: Of its middle above the floor.
        half_length_m: Of a capsule's or cylinder's straight part; 0 for a sphere.
        capsule: Whether boxes touch it as MuJoCo's capsules.
        flat: Whether its ends are level, as a cylinder's.
        upturned: Whether a capsule's own axis points down.
        friction: Sliding friction coefficient, or None where contacts are frictionless (condim 1).
        margin_m: Distance below which a contact pushes.
    """

    forward_m: float
    left_m: float
    height_m: float
    radius_m: float
    half_length_m: float
    capsule: bool
    flat: bool
    upturned: bool
    friction: float | None
    margin_m: float
    softness: Softness


@dataclass(frozen=True)
class Motor:
    """An actuator: what its control becomes, and where its force acts.

    Attributes:
        moment: Forces along x and y and torque about the yaw axis for a force of 1, the base unturned.
        turns: Whether the force turns with the base (a site's) or stays with the world's axes (a joint's).
        length: The actuator's length for coordinates of 1.
        control_range, force_range: Limits, or None.
        gain, bias: (constant, per length, per velocity).
        activation: Its place among the activations, or None for an actuator without dynamics.
        time_constant_s: Of a filter; None for an integrator.
        exact_filter: Whether the filter is integrated exactly.
        activation_range: Limits of the activation, or None.
        early: Whether the force already feels the next activation.
    """

    moment: tuple[float, float, float]
    turns: bool
    length: tuple[float, float, float]
    control_range: tuple[float, float] | None
    force_range: tuple[float, float] | None
    gain: tuple[float, float, float]
    bias: tuple[float, float, float]
    activation: int | None
    time_constant_s: float | None
    exact_filter: bool
    activation_range: tuple[float, float] | None
    early: bool


@dataclass(frozen=True)
class DryFriction:
    """The friction loss of a joint: at most ``limit`` (N or N m), linear in the slip near rest."""

    axis: int
    limit: float
    damping: float
    weight: float


@dataclass(frozen=True, eq=False)
class PlanarRobot:
    """A robot as the planar engine steps it.

    Attributes:
        masses: What an acceleration along x, along y and about the yaw axis has to move (kg, kg, kg m2), armature
            included.
        lever: Mass times the place of its centre in the base's frame (kg m).
        damping: Of the joints (N s/m, N s/m, N m s).
        rest_activations: Of the actuators, at the start.
        rest_control: What they get until something is commanded.
        implicit_damping: Whether the integrator treats the joints' damping implicitly.
        implicit_motors: Whether it treats the actuators' damping so too (implicitfast).
        uncoupled: Whether MuJoCo stores the mass matrix as a diagonal, the centre of mass being on the yaw axis; it
            then leaves out what couples the axes of the actuators' damping.
        joint_force_ranges: Limits on what the actuators of a joint do together, or None.
        physics_steps: In one control step.
    """

    hull: Hull
    discs: tuple[Disc, ...]
    motors: tuple[Motor, ...]
    dry_frictions: tuple[DryFriction, ...]
    masses: tuple[float, float, float]
    lever: tuple[float, float]
    damping: tuple[float, float, float]
    rest_activations: tuple[float, ...]
    rest_control: tuple[float, ...]
    implicit_damping: bool
    implicit_motors: bool
    uncoupled: bool
    joint_force_ranges: tuple[tuple[float, float] | None, ...]
    step_s: float
    physics_steps: int

    @property
    def actuators(self) -> int:
        """Returns how many numbers a control has."""
        return len(self.motors)


def varied_robot(robot: PlanarRobot, factors: Any) -> PlanarRobot:  # noqa: ANN401 - an array, which may be traced
    """Returns a robot whose mass, friction and motor strength are so many times as large; numbers may be traced.

    Whatever MuJoCo derives from a mass goes with it or with its inverse: armature counts as mass. The regularizer of a
    pyramid's edges follows from the friction mu as 2 mu^2 (1 + mu^2) (MuJoCo's source of constraints, where it makes
    impedances). Where all factors are 1, all numbers stay the same bits.

    Args:
        robot: As its ``robot.xml`` says it.
        factors: Of mass, friction and motor strength.
    """
    mass, friction, strength = factors[0], factors[1], factors[2]

    def times(factor: Any, values: Any) -> Any:  # noqa: ANN401 - tuples of numbers of which some are traced then
        return None if values is None else tuple(value and factor * value for value in values)

    def disc(one: Disc) -> Disc:
        softness = replace(one.softness, inverse_mass=one.softness.inverse_mass / mass)
        if not one.friction:
            return replace(one, softness=softness)
        square = one.friction**2
        share = friction**2 * ((1.0 + friction**2 * square) / (1.0 + square))
        return replace(
            one,
            friction=friction * one.friction,
            softness=replace(softness, inverse_mass=share * softness.inverse_mass),
        )

    return replace(
        robot,
        discs=tuple(map(disc, robot.discs)),
        motors=tuple(
            replace(
                each,
                gain=times(strength, each.gain),
                bias=times(strength, each.bias),
                force_range=times(strength, each.force_range),
            )
            for each in robot.motors
        ),
        dry_frictions=tuple(replace(each, weight=mass * each.weight) for each in robot.dry_frictions),
        masses=times(mass, robot.masses),
        lever=times(mass, robot.lever),
        joint_force_ranges=tuple(times(strength, each) for each in robot.joint_force_ranges),
    )


_ELSEWHERE = "or set engine: auto or mujoco"
_UPRIGHT = (mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER)
_ROUND = (mujoco.mjtGeom.mjGEOM_SPHERE, *_UPRIGHT)
# Half a degree: what rounded angles, and fromto, lean by. The outline then is off by a hundredth of the height.
_MOST_LEAN = 0.009
_INTEGRATORS = (mujoco.mjtIntegrator.mjINT_EULER, mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
# The others of these only watch, or are refused for all engines: energy, comparison with inverse dynamics.
_WITH = (mujoco.mjtEnableBit.mjENBL_SLEEP, mujoco.mjtEnableBit.mjENBL_DIAGEXACT)
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
    if option.density > 0 or option.viscosity > 0:
        yield f"option density {option.density:g}, viscosity {option.viscosity:g}: there is no air: set both to 0"
    if option.noslip_iterations > 0:
        yield f"option noslip_iterations {option.noslip_iterations}: its contacts are soft: set 0"
    if option.disableactuator:
        yield "option actuatorgroupdisable: all actuators act: delete those that shall not"
    yield from _flags(option)


def _flags(option: mujoco.MjOption) -> Iterator[str]:
    if option.disableflags & mujoco.mjtDisableBit.mjDSBL_DAMPER:
        yield "option flag damper disable: it is always on: leave it enabled"
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
        if model.dof_dampingpoly[dof].any():
            yield f"{name}: damping is not linear: give one number"


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


_PROBE_HALF_M = 1.0
# How deep a probing obstacle sits in the hull: a share of the hull's radius.
_PROBE_DEPTH = 0.01
# MuJoCo keeps impedances, and the midpoint between them, within these (mjMINIMP, mjMAXIMP).
_LEAST_IMPEDANCE, _MOST_IMPEDANCE = 1e-4, 0.9999


# Numbers that MuJoCo derives (mass matrix, mixed contact parameters, stiffness, regularizers, transmissions) are not
# derived again: the robot is compiled with an obstacle pressed into each of its hull's geoms, and MuJoCo's own
# constraint rows are read (MuJoCo documentation, chapter Computation, "Constraint model").
def planar_robot(path: Path) -> PlanarRobot:
    """Returns the robot of a ``robot.xml`` as the planar engine steps it.

    Raises:
        RobotRefused: The engine cannot represent it; names every culprit, and the remedy.
    """
    spec = read_robot_mjcf(path)
    host = compile_robot(spec)
    refuse_what_is_not_planar(host)
    geoms = colliding_geoms(host)
    data = _pressed(spec, host, geoms)
    discs = tuple(_disc(data, probe, geom + len(geoms)) for probe, geom in enumerate(geoms))
    inertia = np.zeros((3, 3))
    mujoco.mj_fullM(data.model, data, inertia)
    return PlanarRobot(
        hull=hull_of(host),
        discs=discs,
        motors=tuple(_motor(data, number) for number in range(host.nu)),
        dry_frictions=_dry_frictions(data),
        masses=_three(np.diag(inertia)),
        lever=(float(inertia[1, 2]), -float(inertia[0, 2])),
        damping=_three(host.dof_damping),
        rest_activations=tuple(float(each) for each in (host.key_act[0] if host.nkey else np.zeros(host.na))),
        rest_control=tuple(rest_control(host).tolist()),
        implicit_damping=_damps_implicitly(host),
        implicit_motors=host.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
        uncoupled=host.nC == host.nv,
        joint_force_ranges=tuple(_range(host.jnt_actfrclimited[j], host.jnt_actfrcrange[j]) for j in range(3)),
        step_s=float(host.opt.timestep),
        physics_steps=round(CONTROL_S / host.opt.timestep),
    )


def _pressed(spec: mujoco.MjSpec, host: mujoco.MjModel, geoms: list[int]) -> mujoco.MjData:
    """Returns the robot at rest with an obstacle pressed into each geom of its hull; obstacles are the first geoms."""
    at_rest = mujoco.MjData(host)
    mujoco.mj_forward(host, at_rest)
    pressed = spec.copy()
    bits = collision_bits(spec)
    for probe, geom in enumerate(geoms):
        added = add_obstacle(pressed, f"planar-probe-{probe}", mujoco.mjtGeom.mjGEOM_BOX, bits)
        reach_m = host.geom_size[geom][0] * (1 - _PROBE_DEPTH) + _PROBE_HALF_M
        added.pos = at_rest.geom_xpos[geom] + [reach_m, 0.0, 0.0]
        added.size = [_PROBE_HALF_M] * 3
    data = mujoco.MjData(compile_robot(pressed))
    mujoco.mj_forward(data.model, data)
    return data


def _disc(data: mujoco.MjData, probe: int, geom: int) -> Disc:
    """Returns a geom of the hull, with the parameters of its contact with the probing obstacle."""
    model = data.model
    contact = next(each for each in data.contact if set(each.geom) == {probe, geom})
    capsule = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CAPSULE
    flat = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CYLINDER
    axis = data.xpos[model.jnt_bodyid[0]]
    forward_m, left_m, _ = data.geom_xpos[geom] - axis
    return Disc(
        forward_m=float(forward_m),
        left_m=float(left_m),
        height_m=float(data.geom_xpos[geom][2]),
        radius_m=float(model.geom_size[geom][0]),
        half_length_m=float(model.geom_size[geom][1]) if capsule or flat else 0.0,
        capsule=bool(capsule),
        flat=bool(flat),
        upturned=bool(data.geom_xmat[geom][8] < 0),
        friction=float(contact.friction[0]) if contact.dim > 1 else None,
        margin_m=float(contact.includemargin),
        softness=_softness(data, contact.efc_address, contact.solimp),
    )


def _softness(data: mujoco.MjData, row: int, solimp: Float64[np.ndarray, "5"]) -> Softness:
    """Returns how a constraint row gives way, from what MuJoCo computed for it."""
    stiffness, damping, impedance, _ = data.efc_KBIP[row]
    least, most, width_m, midpoint, power = solimp
    return Softness(
        stiffness=float(stiffness),
        damping=float(damping),
        inverse_mass=float(data.efc_R[row] * impedance / (1 - impedance)),
        impedance=(
            _impedance(least),
            _impedance(most),
            max(float(width_m), 0.0),
            _impedance(midpoint),
            max(float(power), 1.0),
        ),
    )


def _impedance(value: float) -> float:
    return float(np.clip(value, _LEAST_IMPEDANCE, _MOST_IMPEDANCE))


def _dry_frictions(data: mujoco.MjData) -> tuple[DryFriction, ...]:
    """Returns the friction losses; a joint's row has MuJoCo's own regularizer, constant since it has no position."""
    rows = np.flatnonzero(data.efc_type == mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF)
    return tuple(
        DryFriction(
            axis=int(data.efc_id[row]),
            limit=float(data.efc_frictionloss[row]),
            damping=float(data.efc_KBIP[row][1]),
            weight=float(data.efc_D[row]),
        )
        for row in rows
    )


def _motor(data: mujoco.MjData, number: int) -> Motor:
    model = data.model
    kind = mujoco.mjtDyn(model.actuator_dyntype[number])
    filters = (mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)
    moment = _three(_moments(data)[number])
    turns = model.actuator_trntype[number] == mujoco.mjtTrn.mjTRN_SITE
    clamped = not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL
    affine = model.actuator_gaintype[number] == mujoco.mjtGain.mjGAIN_AFFINE
    gain = _three(model.actuator_gainprm[number])
    biased = model.actuator_biastype[number] == mujoco.mjtBias.mjBIAS_AFFINE
    return Motor(
        moment=moment,
        turns=bool(turns),
        # A site without a reference site has no length (MuJoCo documentation, "Actuators").
        length=(0.0, 0.0, 0.0) if turns else moment,
        control_range=_range(model.actuator_ctrllimited[number] and clamped, model.actuator_ctrlrange[number]),
        force_range=_range(model.actuator_forcelimited[number], model.actuator_forcerange[number]),
        gain=gain if affine else (gain[0], 0.0, 0.0),
        bias=_three(model.actuator_biasprm[number]) if biased else (0.0, 0.0, 0.0),
        activation=int(model.actuator_actadr[number]) if kind != mujoco.mjtDyn.mjDYN_NONE else None,
        time_constant_s=float(model.actuator_dynprm[number][0]) if kind in filters else None,
        exact_filter=bool(kind == mujoco.mjtDyn.mjDYN_FILTEREXACT),
        activation_range=_range(model.actuator_actlimited[number], model.actuator_actrange[number]),
        early=bool(model.actuator_actearly[number]),
    )


def _moments(data: mujoco.MjData) -> Float64[np.ndarray, "actuators 3"]:
    moments = np.zeros((data.model.nu, 3))
    mujoco.mju_sparse2dense(moments, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind)
    return moments


def _damps_implicitly(model: mujoco.MjModel) -> bool:
    """Returns whether the integrator treats joint damping implicitly: always, but for Euler told not to."""
    told_not_to = bool(model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    euler = model.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER
    return bool(model.dof_damping.any()) and not (euler and told_not_to)


def _range(limited: object, limits: Float64[np.ndarray, "2"]) -> tuple[float, float] | None:
    return (float(limits[0]), float(limits[1])) if limited else None


def _three(values: Float64[np.ndarray, "numbers"]) -> tuple[float, float, float]:
    return (float(values[0]), float(values[1]), float(values[2]))
