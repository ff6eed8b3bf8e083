"""How ROS sees the robot of an application, ROS or not: its topics and frames, and its controls as Twists."""

import functools
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from specs.bundle_files import RosRobot
from tasks.simulate.application.mjcf_check import RobotRefused
from tasks.simulate.host.declaration import read_ros_robot
from tasks.simulate.host.twist_drive import twist_map

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
