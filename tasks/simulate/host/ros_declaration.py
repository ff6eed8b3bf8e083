"""What a bundle declares of its ROS robot, in ``ros.yaml`` at its root."""

from pathlib import Path

from specs.bundle.ros_robot import ROS_FILE, RosRobot
from tasks.simulate.host.declaration import read_declaration


def read_ros_robot(folder: Path) -> RosRobot:
    """Returns what a bundle declares of its ROS robot; the defaults of one that declares nothing.

    Args:
        folder: Where the bundle is unpacked.

    Raises:
        RobotRefused: The file is no YAML, or says what it must not.
    """
    return read_declaration(folder / ROS_FILE, ROS_FILE, RosRobot) or RosRobot()
