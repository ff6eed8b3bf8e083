"""What the robots of all lanes sense, as their ROS applications are told of it."""

from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Float64

from specs.bundle.ros_robot import RosRobot
from specs.data.episode import CONTROL_S
from tasks.ros.lockstep.exchange import Base, FloorPlan, Joints, Sensed
from tasks.simulate.application.contract import HostMap, Observation
from tasks.simulate.application.robot_mjcf import base_of, compile_robot, read_robot_mjcf
from tasks.simulate.sensor.lidar import Lidar, ray_angles

_FREE, _OCCUPIED = 0, 100
_PLANAR_JOINTS = 3
_ONE_NUMBER = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)


class JointPlaces:
    """Where the joints that ``/joint_states`` tells of lie among a robot's coordinates and speeds.

    Attributes:
        names: Of the joints.
    """

    def __init__(self, robot: Path) -> None:
        """Reads them.

        Args:
            robot: Its ``robot.xml``.

        Raises:
            RobotRefused: It is no robot.
        """
        model = compile_robot(read_robot_mjcf(robot))
        first = 1 if base_of(model).free else _PLANAR_JOINTS
        told = [joint for joint in range(first, model.njnt) if mujoco.mjtJoint(model.jnt_type[joint]) in _ONE_NUMBER]
        self.names = tuple(model.joint(joint).name or f"joint_{joint}" for joint in told)
        self._positions = np.array([model.jnt_qposadr[joint] for joint in told], np.int64)
        self._speeds = np.array([model.jnt_dofadr[joint] for joint in told], np.int64)

    def of(self, observed: Observation, lane: int) -> Joints | None:
        """Returns a lane's joints; None for a robot that is no more than its base."""
        if observed.joints is None or not self.names:
            return None
        qpos, qvel = np.asarray(observed.joints.qpos)[lane], np.asarray(observed.joints.qvel)[lane]
        return Joints(self.names, qpos[self._positions].astype(np.float64), qvel[self._speeds].astype(np.float64))


class LaneSenses:
    """Turns the observations of all lanes into what each lane's nodes are told."""

    def __init__(self, joints: JointPlaces) -> None:
        """Begins with robots that do not accelerate."""
        self._joints = joints
        self._before: Float64[np.ndarray, "lanes 3"] | None = None

    def sensed(self, observed: Observation, asked: Bool[np.ndarray, "lanes"]) -> list[Sensed | None]:
        """Returns what each lane's robot senses now; None for lanes that are not asked.

        Args:
            observed: Of all lanes, lanes first, in NumPy.
            asked: Which lanes; the others, idle ones at the end among them, are done.
        """
        pose = np.asarray(observed.pose, np.float64)
        velocity = np.asarray(observed.velocity, np.float64)
        change = velocity - (velocity if self._before is None else self._before)
        self._before = velocity
        own, acceleration = _turned_back(velocity, pose[:, 2]), _turned_back(change, pose[:, 2])[:, :2] / CONTROL_S
        ranges_m, bumper, goal_m = (np.asarray(each) for each in (observed.ranges_m, observed.bumper, observed.goal_m))
        return [
            Sensed(
                pose=pose[lane],
                velocity=own[lane],
                acceleration=acceleration[lane],
                ranges_m=ranges_m[lane],
                bumper=bumper[lane],
                goal=goal_m[lane].astype(np.float64),
                joints=self._joints.of(observed, lane),
            )
            if wanted
            else None
            for lane, wanted in enumerate(asked.tolist())
        ]


def told_base(robot: RosRobot, lidar: Lidar) -> Base:
    """Returns what nodes are told of a base.

    Args:
        robot: What its bundle declares.
        lidar: As the program has it.
    """
    angles = ray_angles(lidar)
    if not len(angles):
        return Base(robot, 0, 0.0, 0.0, float(lidar.range_m))
    step_rad = float(np.float64(angles[-1]) - np.float64(angles[0])) / max(len(angles) - 1, 1)
    return Base(robot, len(angles), float(angles[0]), step_rad, float(lidar.range_m))


def floor_plan(floor: HostMap) -> FloorPlan:
    """Returns a world's map as an occupancy grid has it, whose origin is the corner of its first cell."""
    cells = np.where(floor.clearance_m > 0.0, _FREE, _OCCUPIED).astype(np.int8)
    half_m = float(floor.cell_m) / 2
    x_m, y_m = (float(each) - half_m for each in floor.origin_m)
    return FloorPlan(cells, (x_m, y_m), float(floor.cell_m))


def _turned_back(
    vectors: Float[np.ndarray, "lanes 3"], yaw_rad: Float[np.ndarray, "lanes"]
) -> Float64[np.ndarray, "lanes 3"]:
    """Returns vectors along the world's axes in the frames of robots that head there."""
    exact_rad = yaw_rad.astype(np.float64)  # as for the lidar's rays: docs/decisions/0042-directions-from-doubles.md
    cos, sin = np.cos(exact_rad), np.sin(exact_rad)
    ahead = cos * vectors[:, 0] + sin * vectors[:, 1]
    left = cos * vectors[:, 1] - sin * vectors[:, 0]
    return np.stack([ahead, left, vectors[:, 2]], axis=-1)
