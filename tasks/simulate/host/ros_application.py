"""ROS applications as the controllers of episodes: a launch file of ROS 1 or ROS 2, run as it is.

What the robot has follows from ``ros.yaml`` and ``robot.xml`` at the bundle's root, before anything is started.
"""
# ruff: noqa: PLC0415 - what a kind of ROS needs is imported when an application of that kind is driven

from collections.abc import Mapping
from typing import NamedTuple

from specs.bundle.ros_robot import RosRobot
from specs.bundle.sensors import BumperDeclaration, LidarDeclaration, OdometryDeclaration
from specs.data.episode import CONTROL_S
from tasks.ros.lockstep.exchange import Base, Launch, Lockstep
from tasks.simulate.application.code import BundleCrash
from tasks.simulate.host.controller_kind import ControllerKind
from tasks.simulate.host.controllers import HostApplication, HostBundle
from tasks.simulate.host.drive.twist import twist_map
from tasks.simulate.host.ros_declaration import read_ros_robot
from tasks.simulate.host.ros_lane.ros_lanes import LockstepMaker, RosLanes, RosSetup
from tasks.simulate.host.ros_lane.ros_senses import JointPlaces
from tasks.simulate.refusal import RobotRefused


class DeclaredSensors(NamedTuple):
    """A ROS robot's sensors, as a controller object has them."""

    lidar: LidarDeclaration | None
    odometry: OdometryDeclaration | None
    bumper: BumperDeclaration | None


def ros_application(bundle: HostBundle, kind: ControllerKind, make: LockstepMaker) -> HostApplication:
    """Returns the application of a ROS launch file.

    Args:
        bundle: Where it lies.
        kind: ``ros`` or ``ros2``.
        make: Returns the lock-step with applications of that kind.

    Raises:
        BundleCrash: Its ``ros.yaml`` or its ``robot.xml`` is refused, or does not say what a Twist does.
    """
    try:
        robot = read_ros_robot(bundle.folder)
        setup = RosSetup(bundle, robot, twist_map(bundle.robot, robot.drive), JointPlaces(bundle.robot), make)
    except RobotRefused as refused:
        raise BundleCrash("RobotApplicationCrash", f"{bundle.launch.name}: {refused}") from refused
    sensors = declared_sensors(robot)

    def declare(environment: Mapping[str, object]) -> DeclaredSensors:  # noqa: ARG001 - nodes read it, sensors do not
        return sensors

    return HostApplication(kind, declare, lambda start: RosLanes(setup, start))


def declared_sensors(robot: RosRobot) -> DeclaredSensors:
    """Returns a robot's sensors, without those that no topic tells of."""
    return DeclaredSensors(
        lidar=robot.lidar if robot.topics.scan else None,
        odometry=robot.odometry,
        bumper=robot.bumper if robot.topics.bumper else None,
    )


def ros1_lockstep(base: Base, launch: Launch) -> Lockstep:
    """Returns the applications of ROS 1."""
    from tasks.ros.lockstep.ros1_lockstep import Ros1Lockstep

    return Ros1Lockstep(launch, base, CONTROL_S)


def ros2_lockstep(base: Base, launch: Launch) -> Lockstep:
    """Returns the applications of ROS 2."""
    from tasks.ros.lockstep.ros2_lockstep import Ros2Lockstep

    return Ros2Lockstep(launch, base, CONTROL_S)
