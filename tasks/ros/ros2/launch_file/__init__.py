"""Launch files of ROS 2 in Python: packages, what they start, stand-ins where ROS 2 is not. Lockstep imports it."""
