"""What a Twist does to a robot's actuators: the control of each as a sum over the Twist's parts.

It follows from ``robot.xml`` where it can be seen (``planar_drive``, ``wheels``), and from the declaration in
``ros.yaml`` where it cannot.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float, Float32, Float64

from specs.bundle.ros_robot import ROS_FILE, DifferentialDrive, RosDrive, VelocityDrive
from tasks.simulate.application.robot_mjcf import Base, base_of, compile_robot, read_robot_mjcf
from tasks.simulate.host.drive.planar_drive import base_motors, planar_rows
from tasks.simulate.host.drive.twist_rows import DriveUnclear, TwistRows, actuator_names, rest_controls
from tasks.simulate.host.drive.wheels import wheel_rows
from tasks.simulate.refusal import RobotRefused

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
