"""Lanes of a chunk as ROS applications drive them: what goes out, what comes back. Host alone imports it."""
