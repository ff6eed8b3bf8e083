"""What a Twist does to a robot's actuators: the control of each as a sum over the Twist's parts.

It follows from ``robot.xml`` for a planar base whose velocity actuators turn with it: each gets the speed that its
transmission has when the base moves as the Twist says. That serves speeds ahead and turn rates, and tyres at either
side, whatever they are called. Any other robot declares it in ``ros.yaml``.
"""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Float32, Float64

from specs.errors import SimyardError
from specs.ros_robot import ROS_FILE, DifferentialDrive, RosDrive, RosRobot, VelocityDrive
from tasks.simulate.application.mjcf_check import RobotRefused
from tasks.simulate.application.robot_file import read_robot_mjcf
from tasks.simulate.application.robot_model import Base, base_of, compile_robot, rest_control, rest_position
from tasks.simulate.host.declaration import read_ros_robot

_DYNAMICS = (mujoco.mjtDyn.mjDYN_NONE, mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)
_YAW, _QUARTER_RAD = 2, np.pi / 2
_AHEAD, _LEFT, _TURN = np.eye(3)


class _DriveUnclear(SimyardError):  # noqa: N818 - a state
    """It cannot be seen what a Twist does to a robot.

    Attributes:
        why: All that is in the way, for a person.
    """

    def __init__(self, why: Sequence[str]) -> None:
        self.why = tuple(why)
        super().__init__("; ".join(why))


class _TwistRows(NamedTuple):
    """What each actuator gets of a Twist in the robot's frame, and of the same along the world's axes."""

    own: Float64[np.ndarray, "actuators 3"]
    world: Float64[np.ndarray, "actuators 3"]


# It follows from ``robot.xml`` where it can be seen there, and from the declaration in ``ros.yaml`` where it cannot.
@dataclass(frozen=True, eq=False)
class TwistMap:
    """How Twists become controls.

    Attributes:
        own: What each actuator gets of a Twist in the robot's frame: (m/s ahead, m/s to the left, rad/s).
        world: What it gets of the same Twist along the world's axes: (m/s, m/s, rad/s).
        rest: What actuators get that a Twist does not command.
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
        """Returns the Twists that come nearest to controls, by the sum of squares; what they cannot show is 0.

        Args:
            controls: Of a robot.
            yaw_rad: Where it heads.
        """
        cos, sin = np.cos(np.asarray(yaw_rad, np.float64)), np.sin(np.asarray(yaw_rad, np.float64))
        turn = np.zeros((len(cos), 3, 3))
        turn[:, 0, 0], turn[:, 0, 1], turn[:, 1, 0], turn[:, 1, 1], turn[:, 2, 2] = cos, -sin, sin, cos, 1.0
        rows = self.own + self.world @ turn
        commanded = (np.asarray(controls, np.float64) - self.rest)[:, :, None]
        return (np.linalg.pinv(rows) @ commanded)[:, :, 0]


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
        rows = _rows_of_base(model, base) if drive is None else _declared_rows(model, base, drive)
    except _DriveUnclear as unclear:
        raise RobotRefused(_remedy(model, unclear)) from unclear
    rest = np.where((rows.own != 0).any(1) | (rows.world != 0).any(1), 0.0, rest_control(model))
    return TwistMap(rows.own, rows.world, rest)


# A wheel gets the speed with which it rolls without slipping (Siegwart, Nourbakhsh, Scaramuzza: Introduction to
# Autonomous Mobile Robots, 2nd edition, section 3.2). Wheels that do not stand on one axle slip sideways when the
# robot turns, and turn it less: how much less is measured, in a turn on the spot.
def _rows_of_base(model: mujoco.MjModel, base: Base) -> _TwistRows:
    """Returns what the actuators of a planar base get of a Twist.

    One that pushes sideways and has no ``ctrlrange`` stands for tyres that hold the base: it gets 0.

    Raises:
        _DriveUnclear: The base is none, or an actuator pushes it whose control is no speed in the base's own frame.
    """
    if base.free:
        raise _DriveUnclear(["its base has a free joint, so that wheels or legs move it"])
    rows, why = np.zeros((model.nu, 3)), list[str]()
    moments, turns = _base_moments(model)
    for number, name in enumerate(_actuator_names(model)):
        moment = moments[number]
        holds = turns[number] and not moment[0] and moment[1] and not model.actuator_ctrllimited[number]
        if moment.any() and not _takes_speed(model, number):
            why.append(f"actuator {name} pushes the base and is no velocity actuator, so that a speed tells it nothing")
        elif moment.any() and not turns[number]:
            why.append(f"actuator {name} does not push along the base's own axes")
        elif not holds:
            rows[number] = moment
    commanded = rows[:, [0, 2]]
    if not why:
        parts = zip(("drives it ahead", "turns it"), commanded.T, strict=True)
        why = [f"no actuator {part} that takes a speed" for part, column in parts if not column.any()]
    if not why and np.linalg.matrix_rank(commanded) < commanded.shape[1]:
        why = ["its actuators cannot drive it ahead and turn it apart from each other"]
    if why:
        raise _DriveUnclear(why)
    return _TwistRows(rows, np.zeros_like(rows))


def _takes_speed(model: mujoco.MjModel, number: int) -> bool:
    """Returns whether an actuator's control is a speed that it keeps, as MuJoCo's ``velocity`` actuators do."""
    gain, bias = model.actuator_gainprm[number], model.actuator_biasprm[number]
    return bool(
        model.actuator_gaintype[number] == mujoco.mjtGain.mjGAIN_FIXED
        and model.actuator_biastype[number] == mujoco.mjtBias.mjBIAS_AFFINE
        and mujoco.mjtDyn(model.actuator_dyntype[number]) in _DYNAMICS
        and gain[0] > 0.0
        and np.allclose(bias[:3], (0.0, 0.0, -gain[0]))
    )


def _base_moments(
    model: mujoco.MjModel,
) -> tuple[Float64[np.ndarray, "actuators 3"], Bool[np.ndarray, "actuators"]]:
    """Returns each transmission's speed for each of a planar base's speeds, and which actuators turn with the base.

    One that acts about z alone does.
    """
    before, after = _moments(model, 0.0), _moments(model, _QUARTER_RAD)
    turned = np.stack([-before[:, 1], before[:, 0], before[:, 2]], axis=1)
    return before, np.asarray(np.isclose(after, turned, atol=1e-9).all(axis=1))


def _moments(model: mujoco.MjModel, yaw_rad: float) -> Float64[np.ndarray, "actuators 3"]:
    data = mujoco.MjData(model)
    data.qpos[:] = rest_position(model)
    data.qpos[_YAW] = yaw_rad
    mujoco.mj_forward(model, data)
    moments = np.zeros((model.nu, model.nv))
    mujoco.mju_sparse2dense(moments, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind)
    return np.round(moments[:, :3], 9)


def _actuator_names(model: mujoco.MjModel) -> list[str]:
    """Returns the names of a robot's actuators, in the order of its controls."""
    return [model.actuator(number).name or f"actuator {number}" for number in range(model.nu)]


def _declared_rows(model: mujoco.MjModel, base: Base, drive: RosDrive) -> _TwistRows:
    """Returns the rows of a declaration, if the robot has the actuators that it names."""
    names = _actuator_names(model)
    asked = _asked(drive)
    missing = [f"drive.{field}: {name}: no actuator of robot.xml" for field, name in asked if name not in names]
    if missing:
        raise _DriveUnclear(missing)
    own, world = np.zeros((model.nu, 3)), np.zeros((model.nu, 3))
    if isinstance(drive, DifferentialDrive):
        radius_m, half_m = drive.wheel_radius_m or 1.0, drive.track_m / 2
        for field, name in asked:
            own[names.index(name)] = np.array([1.0, 0.0, -half_m if field == "left" else half_m]) / radius_m
        return _TwistRows(own, world)
    along_world = not base.free and _along_world(model, drive, names)
    parts = {"forward": _AHEAD, "sideways": _LEFT, "turn": _TURN}
    for field, name in asked:
        (world if along_world else own)[names.index(name)] = parts[field]
    return _TwistRows(own, world)


def _asked(drive: RosDrive) -> list[tuple[str, str]]:
    """Returns the fields of a declaration, each with an actuator that it names."""
    if isinstance(drive, DifferentialDrive):
        sides = (("left", drive.left), ("right", drive.right))
        return [(field, name) for field, side in sides for name in ([side] if isinstance(side, str) else side)]
    every = [("forward", drive.forward), ("sideways", drive.sideways), ("turn", drive.turn)]
    return [(field, name) for field, name in every if name is not None]


def _along_world(model: mujoco.MjModel, drive: VelocityDrive, names: Sequence[str]) -> bool:
    """Returns whether ``forward`` and ``sideways`` push along the world's axes, however the robot stands.

    Raises:
        _DriveUnclear: ``forward`` does, and nothing pushes along the other axis.
    """
    _, turns = _base_moments(model)
    fixed = [not turns[names.index(name)] for name in (drive.forward, drive.sideways) if name]
    if fixed[0] and len(fixed) == 1:
        why = (
            f"drive.forward: {drive.forward} pushes along an axis of the world: a robot that turns needs sideways, too"
        )
        raise _DriveUnclear([why])
    return all(fixed)


def _remedy(model: mujoco.MjModel, unclear: _DriveUnclear) -> str:
    names = ", ".join(_actuator_names(model))
    return (
        f"robot.xml: what a Twist does to its actuators ({names}) cannot be seen: {'; '.join(unclear.why)}; write into "
        f"{ROS_FILE} beside it 'drive: {{kind: differential, left: NAME, right: NAME, track_m: METRES}}', with "
        "wheel_radius_m for actuators that turn wheels and lists of names for several wheels at a side, or "
        "'drive: {kind: velocity, forward: NAME, turn: NAME}', with sideways for a robot that can"
    )


_ROBOTS_KEPT = 8


class RobotView(NamedTuple):
    """A robot as ROS sees it.

    Attributes:
        robot: Names of its topics and frames; the defaults of one that declares nothing.
        twists: Returns the Twists of controls, given headings; None where it cannot be seen what a Twist does.
    """

    robot: RosRobot
    twists: Callable[[np.ndarray, np.ndarray], np.ndarray] | None


@functools.lru_cache(maxsize=_ROBOTS_KEPT)
def robot_view(folder: Path) -> RobotView:
    """Returns how ROS sees the robot of a bundle.

    Args:
        folder: Where the bundle is unpacked, named by its digest.
    """
    try:
        robot = read_ros_robot(folder)
    except RobotRefused:  # its episodes failed with that
        robot = RosRobot()
    try:
        return RobotView(robot, twist_map(folder / "robot.xml", robot.drive).twists)
    except RobotRefused:  # a robot of any kind drives without Twists
        return RobotView(robot, None)
