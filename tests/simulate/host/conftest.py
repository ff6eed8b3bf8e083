"""ROS 1 for episodes that nodes drive."""

from tests.ros.conftest import ros

__all__ = ["ros"]
