"""What a robot's owner carries to the robot: the agent as a wheel of its own, a systemd unit, the root of trust."""
