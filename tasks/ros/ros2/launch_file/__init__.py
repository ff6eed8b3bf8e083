"""Launch files of ROS 2 in Python: packages, the process that runs them, what they start. Lockstep imports it."""
