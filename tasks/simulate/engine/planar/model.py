"""Reads a planar base from the model that MuJoCo compiled.

Numbers that MuJoCo derives (mass matrix, mixed contact parameters, stiffness, regularizers, transmissions) are not
derived again: the robot is compiled with an obstacle pressed into each of its hull's geoms, and MuJoCo's own constraint
rows are read (MuJoCo documentation, chapter Computation, "Constraint model").
"""

from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float64

from specs.data.episode import CONTROL_S
from tasks.simulate.application.robot_mjcf import add_obstacle, collision_bits, hull_of, read_robot_mjcf
from tasks.simulate.engine.planar.parts import Disc, DryFriction, Motor, PlanarRobot, Softness
from tasks.simulate.engine.planar.refusals import colliding_geoms, refuse_what_is_not_planar

_PROBE_HALF_M = 1.0
# How deep a probing obstacle sits in the hull: a share of the hull's radius.
_PROBE_DEPTH = 0.01
# MuJoCo keeps impedances, and the midpoint between them, within these (mjMINIMP, mjMAXIMP).
_LEAST_IMPEDANCE, _MOST_IMPEDANCE = 1e-4, 0.9999


def planar_robot(path: Path) -> PlanarRobot:
    """Returns the robot of a ``robot.xml`` as the planar engine steps it.

    Raises:
        RobotRefused: The engine cannot represent it; names every culprit, and the remedy.
    """
    spec = read_robot_mjcf(path)
    host = spec.compile()
    refuse_what_is_not_planar(host)
    geoms = colliding_geoms(host)
    data = _pressed(spec, host, geoms)
    discs = tuple(_disc(data, probe, geom + len(geoms)) for probe, geom in enumerate(geoms))
    inertia = _mass_matrix(data)
    return PlanarRobot(
        hull=hull_of(host),
        discs=discs,
        motors=tuple(_motor(data, number) for number in range(host.nu)),
        dry_frictions=_dry_frictions(data),
        masses=_three(np.diag(inertia)),
        lever=(float(inertia[1, 2]), -float(inertia[0, 2])),
        damping=_three(host.dof_damping),
        rest_activations=tuple(float(each) for each in (host.key_act[0] if host.nkey else np.zeros(host.na))),
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
    data = mujoco.MjData(pressed.compile())
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


def _mass_matrix(data: mujoco.MjData) -> Float64[np.ndarray, "3 3"]:
    matrix = np.zeros((3, 3))
    mujoco.mj_fullM(data.model, data, matrix)
    return matrix


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
