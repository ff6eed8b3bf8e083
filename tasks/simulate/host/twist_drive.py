"""What a Twist does to a robot's actuators: the control of each as a sum over the Twist's parts."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float, Float32, Float64

from specs.bundle_files import ROS_FILE, DifferentialDrive, RosDrive, VelocityDrive
from specs.errors import SimyardError
from tasks.simulate.application.mjcf_check import RobotRefused
from tasks.simulate.application.robot_model import Base, base_of, compile_robot, pose_of, read_robot_mjcf, rest_position

_DYNAMICS = (mujoco.mjtDyn.mjDYN_NONE, mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)


class DriveUnclear(SimyardError):  # noqa: N818 - a state
    """It cannot be seen what a Twist does to a robot.

    Attributes:
        why: All that is in the way, for a person.
    """

    def __init__(self, why: Sequence[str]) -> None:
        self.why = tuple(why)
        super().__init__("; ".join(why))


class TwistRows(NamedTuple):
    """What each actuator gets of a Twist in the robot's frame, and of the same along the world's axes."""

    own: Float64[np.ndarray, "actuators 3"]
    world: Float64[np.ndarray, "actuators 3"]

    @classmethod
    def none(cls, actuators: int) -> "TwistRows":
        """Returns rows of actuators that get nothing."""
        return cls(np.zeros((actuators, 3)), np.zeros((actuators, 3)))


def actuator_names(model: mujoco.MjModel) -> list[str]:
    """Returns the names of a robot's actuators, in the order of its controls."""
    return [model.actuator(number).name or f"actuator {number}" for number in range(model.nu)]


def takes_speed(model: mujoco.MjModel, number: int) -> bool:
    """Returns whether an actuator's control is a speed that it keeps, as MuJoCo's ``velocity`` actuators do."""
    gain, bias = model.actuator_gainprm[number], model.actuator_biasprm[number]
    return bool(
        model.actuator_gaintype[number] == mujoco.mjtGain.mjGAIN_FIXED
        and model.actuator_biastype[number] == mujoco.mjtBias.mjBIAS_AFFINE
        and mujoco.mjtDyn(model.actuator_dyntype[number]) in _DYNAMICS
        and gain[0] > 0.0
        and np.allclose(bias[:3], (0.0, 0.0, -gain[0]))
    )


def rest_controls(model: mujoco.MjModel) -> Float64[np.ndarray, "actuators"]:
    """Returns what actuators are told that nobody commands: the controls of the first keyframe, else 0."""
    return np.array(model.key_ctrl[0]) if model.nkey else np.zeros(model.nu)


_YAW = 2
_QUARTER_RAD = np.pi / 2


class BaseMotor(NamedTuple):
    """How an actuator acts on a planar base that is not turned.

    Attributes:
        moment: Its transmission's speed for each of the base's: along x, along y, about z.
        turns: Whether it turns with the base; one that acts about z alone does.
        strange: Whether it neither turns with the base nor stays with the world's axes.
    """

    moment: Float64[np.ndarray, "3"]
    turns: bool
    strange: bool


def base_motors(model: mujoco.MjModel) -> list[BaseMotor]:
    """Returns how each actuator acts on a planar base."""
    rest = rest_position(model)
    before = _moments(model, rest, 0.0)
    after = _moments(model, rest, _QUARTER_RAD)
    found: list[BaseMotor] = []
    for here, there in zip(before, after, strict=True):
        turns = np.allclose(there, (-here[1], here[0], here[2]), atol=1e-9)
        found.append(BaseMotor(here, bool(turns), not turns and not np.allclose(there, here, atol=1e-9)))
    return found


def planar_rows(model: mujoco.MjModel) -> TwistRows:
    """Returns what the actuators of a planar base get of a Twist.

    One that pushes sideways and has no ``ctrlrange`` stands for tyres that hold the base: it gets 0.

    Raises:
        DriveUnclear: An actuator pushes the base, and its control is no speed.
    """
    rows, why = TwistRows.none(model.nu), list[str]()
    for number, (motor, name) in enumerate(zip(base_motors(model), actuator_names(model), strict=True)):
        if not motor.moment.any():
            continue
        if motor.strange:
            why.append(f"actuator {name} pushes the base neither along its own axes nor along the world's")
        elif not takes_speed(model, number):
            why.append(f"actuator {name} pushes the base and is no velocity actuator, so that a speed tells it nothing")
        elif not _holds(model, number, motor):
            (rows.own if motor.turns else rows.world)[number] = motor.moment
    if why:
        raise DriveUnclear(why)
    return rows


def _holds(model: mujoco.MjModel, number: int, motor: BaseMotor) -> bool:
    sideways = motor.turns and not motor.moment[0] and bool(motor.moment[1])
    return sideways and not model.actuator_ctrllimited[number]


def _moments(
    model: mujoco.MjModel, rest: Float64[np.ndarray, "coordinates"], yaw_rad: float
) -> Float64[np.ndarray, "actuators 3"]:
    data = mujoco.MjData(model)
    data.qpos[:] = rest
    data.qpos[_YAW] = yaw_rad
    mujoco.mj_forward(model, data)
    moments = np.zeros((model.nu, model.nv))
    mujoco.mju_sparse2dense(moments, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind)
    return np.round(moments[:, :3], 9)


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


_AHEAD, _LEFT, _TURN = np.eye(3)


@dataclass(frozen=True, eq=False)
class TwistMap:
    """How Twists become controls.

    Attributes:
        own: What each actuator gets of a Twist in the robot's frame: (m/s ahead, m/s to the left, rad/s).
        world: What it gets of the same Twist along the world's axes: (m/s, m/s, rad/s).
        rest: What actuators that a Twist does not command are told.
    """

    own: Float64[np.ndarray, "actuators 3"]
    world: Float64[np.ndarray, "actuators 3"]
    rest: Float64[np.ndarray, "actuators"]

    def controls(
        self, twists: Float[np.ndarray, "lanes 3"], yaw_rad: Float[np.ndarray, "lanes"]
    ) -> Float32[np.ndarray, "lanes actuators"]:
        """Returns the controls of robots.

        Args:
            twists: Of each, in its own frame: (m/s ahead, m/s to the left, rad/s).
            yaw_rad: Where each believes to head.
        """
        given = np.asarray(twists, np.float64)
        cos, sin = np.cos(np.asarray(yaw_rad, np.float64)), np.sin(np.asarray(yaw_rad, np.float64))
        ahead, left, turn = given.T
        turned = np.stack([cos * ahead - sin * left, sin * ahead + cos * left, turn], axis=-1)
        return (given @ self.own.T + turned @ self.world.T + self.rest).astype(np.float32)

    def twists(
        self, controls: Float[np.ndarray, "samples actuators"], yaw_rad: Float[np.ndarray, "samples"]
    ) -> Float64[np.ndarray, "samples 3"]:
        """Returns the Twists that come nearest to controls, by the sum of squares; what they cannot tell is 0.

        Args:
            controls: Of a robot.
            yaw_rad: Where it heads.
        """
        cos, sin = np.cos(np.asarray(yaw_rad, np.float64)), np.sin(np.asarray(yaw_rad, np.float64))
        turn = np.zeros((len(cos), 3, 3))
        turn[:, 0, 0], turn[:, 0, 1], turn[:, 1, 0], turn[:, 1, 1], turn[:, 2, 2] = cos, -sin, sin, cos, 1.0
        rows = self.own + self.world @ turn
        told = (np.asarray(controls, np.float64) - self.rest)[:, :, None]
        return (np.linalg.pinv(rows) @ told)[:, :, 0]


def twist_map(robot: Path, drive: RosDrive | None = None) -> TwistMap:
    """Returns how a Twist becomes controls of a robot.

    Args:
        robot: Its ``robot.xml``.
        drive: What ``ros.yaml`` declares; None if it shall follow from the robot.

    Raises:
        RobotRefused: The file is no robot, the declaration names what it has not, or nothing follows from it; says what
            to write.
    """
    model = compile_robot(read_robot_mjcf(robot))
    base = base_of(model)
    try:
        rows = _seen(model, base) if drive is None else _declared(model, base, drive)
    except DriveUnclear as unclear:
        raise RobotRefused(_remedy(model, unclear)) from unclear
    rest = np.where((rows.own != 0).any(1) | (rows.world != 0).any(1), 0.0, rest_controls(model))
    return TwistMap(rows.own, rows.world, rest)


def _seen(model: mujoco.MjModel, base: Base) -> TwistRows:
    rows = wheel_rows(model) if base.free else planar_rows(model)
    commanded = (rows.own + rows.world)[:, [0, 2]]
    parts = ("drives it ahead", "turns it")
    why = [
        f"no actuator {name} that takes a speed"
        for name, column in zip(parts, commanded.T, strict=True)
        if not column.any()
    ]
    if not why and np.linalg.matrix_rank(commanded) < len(parts):
        why = ["its actuators cannot drive it ahead and turn it apart from each other"]
    if why:
        raise DriveUnclear(why)
    return rows


def _declared(model: mujoco.MjModel, base: Base, drive: RosDrive) -> TwistRows:
    """Returns the rows of a declaration, if the robot has the actuators that it names."""
    names = actuator_names(model)
    asked = _asked(drive)
    missing = [f"drive.{field}: {name}: no actuator of robot.xml" for field, name in asked if name not in names]
    if missing:
        raise DriveUnclear(missing)
    rows = TwistRows.none(model.nu)
    if isinstance(drive, DifferentialDrive):
        radius_m, half_m = drive.wheel_radius_m or 1.0, drive.track_m / 2
        rows.own[names.index(drive.left)] = np.array([1.0, 0.0, -half_m]) / radius_m
        rows.own[names.index(drive.right)] = np.array([1.0, 0.0, half_m]) / radius_m
        return rows
    places = [names.index(name) for _, name in asked]
    along_world = not base.free and _along_world(model, drive, names)
    kinds = [part for part, name in ((_AHEAD, drive.forward), (_LEFT, drive.sideways), (_TURN, drive.turn)) if name]
    for place, part in zip(places, kinds, strict=True):
        (rows.world if along_world else rows.own)[place] = part
    return rows


def _asked(drive: RosDrive) -> list[tuple[str, str]]:
    if isinstance(drive, DifferentialDrive):
        return [("left", drive.left), ("right", drive.right)]
    every = [("forward", drive.forward), ("sideways", drive.sideways), ("turn", drive.turn)]
    return [(field, name) for field, name in every if name is not None]


def _along_world(model: mujoco.MjModel, drive: VelocityDrive, names: Sequence[str]) -> bool:
    """Returns whether ``forward`` and ``sideways`` push along the world's axes, however the robot stands.

    Raises:
        DriveUnclear: ``forward`` does, and nothing pushes along the other axis.
    """
    motors = base_motors(model)
    fixed = [not motors[names.index(name)].turns for name in (drive.forward, drive.sideways) if name]
    if fixed[0] and len(fixed) == 1:
        why = (
            f"drive.forward: {drive.forward} pushes along an axis of the world: a robot that turns needs sideways, too"
        )
        raise DriveUnclear([why])
    return all(fixed)


def _remedy(model: mujoco.MjModel, unclear: DriveUnclear) -> str:
    names = ", ".join(actuator_names(model))
    return (
        f"robot.xml: what a Twist does to its actuators ({names}) cannot be seen: {'; '.join(unclear.why)}; write into "
        f"{ROS_FILE} beside it 'drive: {{kind: differential, left: NAME, right: NAME, track_m: METRES}}', with "
        "wheel_radius_m for actuators that turn wheels, or 'drive: {kind: velocity, forward: NAME, turn: NAME}', with "
        "sideways for a robot that can"
    )
