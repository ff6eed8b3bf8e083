"""A ROS 1 master, its parameters and the robot's node. Lockstep may import it."""
