"""What a Twist does to a robot that rolls on wheels, from where its driven wheels stand and how large they are.

A wheel gets the speed with which it rolls without slipping (Siegwart, Nourbakhsh, Scaramuzza: Introduction to
Autonomous Mobile Robots, 2nd edition, section 3.2). Wheels that do not stand on one axle slip sideways when the robot
turns, and turn it less: how much less is measured, in a turn on the spot.
"""

from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float64

from tasks.simulate.application.coordinates import pose_of
from tasks.simulate.application.robot_mjcf import base_of, rest_position
from tasks.simulate.host.drive.twist_rows import DriveUnclear, TwistRows, actuator_names, rest_controls, takes_speed

_ROUND = (mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_CAPSULE)
_JOINT = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
_LEVEL = 0.1
_AXLE_M = 0.01
_TURN_RAD_S, _SETTLE_S, _MEASURE_S = 1.0, 1.0, 2.0
# Coarse, so that two machines whose last bits differ measure the same.
_SHARE_STEP, _MOST_SHARE = 0.05, 5.0


class Wheel(NamedTuple):
    """A driven wheel of a robot at rest.

    Attributes:
        place_m: Of its hub in the robot's frame: ahead, to the left.
        axis: That it turns about, in the robot's frame.
        radius_m: 0 where nothing tells.
    """

    actuator: int
    place_m: Float64[np.ndarray, "2"]
    axis: Float64[np.ndarray, "2"]
    radius_m: float

    @property
    def row(self) -> Float64[np.ndarray, "3"]:
        """Returns the turning speed (rad/s) for each part of a Twist."""
        ahead, left = self.axis[1], -self.axis[0]
        x_m, y_m = self.place_m
        return np.array([ahead, left, left * x_m - ahead * y_m]) / self.radius_m


def wheel_rows(model: mujoco.MjModel) -> TwistRows:
    """Returns what the actuators of a robot with a free joint get of a Twist.

    Raises:
        DriveUnclear: No wheel is driven, or how large one is cannot be seen, or the wheels are steered.
    """
    wheels = _driven_wheels(model)
    names = actuator_names(model)
    if not wheels:
        raise DriveUnclear(["no velocity actuator turns a wheel: a body of its own that turns about a level axis"])
    why = [
        f"actuator {names[wheel.actuator]} turns a wheel without a cylinder, sphere or capsule that tells its radius"
        for wheel in wheels
        if not wheel.radius_m
    ]
    why += [f"actuator {names[number]} steers a wheel" for number in _steering(model, wheels)]
    if why:
        raise DriveUnclear(why)
    rows = TwistRows.none(model.nu)
    for wheel in wheels:
        rows.own[wheel.actuator] = wheel.row
    if max(wheel.place_m[0] for wheel in wheels) - min(wheel.place_m[0] for wheel in wheels) > _AXLE_M:
        rows.own[:, 2] *= _slip_share(model, rows.own[:, 2])
    return rows


def _driven_wheels(model: mujoco.MjModel) -> list[Wheel]:
    data, base = mujoco.MjData(model), base_of(model)
    data.qpos[:] = rest_position(model)
    mujoco.mj_forward(model, data)
    yaw_rad = float(pose_of(base, np.array(data.qpos), np)[2])
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    into_robot = np.array([[cos, sin], [-sin, cos]])
    wheels: list[Wheel] = []
    for number in range(model.nu):
        joint = int(model.actuator_trnid[number][0])
        if not takes_speed(model, number) or not _is_wheel_joint(model, data, number, joint):
            continue
        gear = float(model.actuator_gear[number][0])
        hub_m = into_robot @ (data.xanchor[joint] - data.xpos[base.body])[:2]
        axis = into_robot @ data.xaxis[joint][:2] * gear
        wheels.append(Wheel(number, hub_m, axis, _radius_m(model, int(model.jnt_bodyid[joint]))))
    return wheels


def _is_wheel_joint(model: mujoco.MjModel, data: mujoco.MjData, number: int, joint: int) -> bool:
    if not _acts_on_joint(model, number) or model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_HINGE:
        return False
    level = abs(data.xaxis[joint][2]) < _LEVEL
    return bool(level and any(_touches(model, geom) for geom in _geoms(model, int(model.jnt_bodyid[joint]))))


def _geoms(model: mujoco.MjModel, body: int) -> list[int]:
    first, count = int(model.body_geomadr[body]), int(model.body_geomnum[body])
    return list(range(first, first + count)) if count else []


def _touches(model: mujoco.MjModel, geom: int) -> bool:
    return bool(model.geom_contype[geom] or model.geom_conaffinity[geom])


def _radius_m(model: mujoco.MjModel, body: int) -> float:
    geoms = [
        geom
        for geom in _geoms(model, body)
        if _touches(model, geom) and mujoco.mjtGeom(model.geom_type[geom]) in _ROUND
    ]
    return max((float(model.geom_size[geom][0]) for geom in geoms), default=0.0)


def _steering(model: mujoco.MjModel, wheels: list[Wheel]) -> list[int]:
    """Returns the actuators that turn what carries a driven wheel."""
    driven = {wheel.actuator for wheel in wheels}
    carriers = {body for wheel in wheels for body in _ancestors(model, _joint_body(model, wheel.actuator))}
    others = (number for number in range(model.nu) if number not in driven and _acts_on_joint(model, number))
    return [number for number in others if _joint_body(model, number) in carriers]


def _acts_on_joint(model: mujoco.MjModel, number: int) -> bool:
    return mujoco.mjtTrn(model.actuator_trntype[number]) in _JOINT


def _joint_body(model: mujoco.MjModel, number: int) -> int:
    return int(model.jnt_bodyid[model.actuator_trnid[number][0]])


def _ancestors(model: mujoco.MjModel, body: int) -> list[int]:
    found: list[int] = [body]
    while body := int(model.body_parentid[body]):
        found.append(body)
    return found


def _slip_share(model: mujoco.MjModel, turn_row: Float64[np.ndarray, "actuators"]) -> float:
    """Returns how many times faster wheels must roll than they would without slipping, for a robot to turn so fast.

    Raises:
        DriveUnclear: The robot does not turn.
    """
    data, base, rest = mujoco.MjData(model), base_of(model), rest_controls(model)
    data.qpos[:] = rest_position(model)
    data.ctrl[:] = np.where(turn_row != 0.0, _TURN_RAD_S * turn_row, rest)
    step_s = float(model.opt.timestep)
    mujoco.mj_step(model, data, round(_SETTLE_S / step_s))
    turned_rad, before_rad = 0.0, float(pose_of(base, np.array(data.qpos), np)[2])
    for _ in range(round(_MEASURE_S / step_s)):
        mujoco.mj_step(model, data)
        now_rad = float(pose_of(base, np.array(data.qpos), np)[2])
        turned_rad += (now_rad - before_rad + np.pi) % (2 * np.pi) - np.pi
        before_rad = now_rad
    share = _MEASURE_S * _TURN_RAD_S / turned_rad if turned_rad > 0.0 else _MOST_SHARE + 1.0
    if share > _MOST_SHARE:
        raise DriveUnclear([f"its wheels, driven to turn it at {_TURN_RAD_S:g} rad/s, slip and hardly turn it"])
    return max(1.0, _SHARE_STEP * round(share / _SHARE_STEP))
