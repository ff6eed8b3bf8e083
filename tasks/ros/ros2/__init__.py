"""ROS 2 over DDS: names, types, qualities of service, launch files in Python. Lockstep may import it."""
