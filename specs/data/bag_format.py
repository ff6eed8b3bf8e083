"""The formats in which ROS's tools read what an episode's topics had, and what their files are called."""

from collections.abc import Mapping
from typing import Literal

BagFormat = Literal["rosbag", "mcap-ros1", "rosbag2"]
"""A bag of ROS 1; MCAP with ROS 1's messages; a folder of rosbag2, with ROS 2's messages in MCAP."""

BAG_ENDINGS: Mapping[BagFormat, str] = {"rosbag": ".bag", "mcap-ros1": "-ros1.mcap", "rosbag2": "-rosbag2"}
"""What the name of a format's file ends in, or the name of its folder."""
