"""Recordings as rosbag, and as MCAP with ROS messages. Results and flows may import it."""
