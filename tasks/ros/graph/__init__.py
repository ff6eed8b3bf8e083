"""A ROS 1 master, its parameters, the robot's node, and bounded connections on the loopback. Lockstep may import it."""
