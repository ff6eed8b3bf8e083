"""What an owner carries to a robot: the agent's wheel, a systemd unit, the root of trust. Flows may import it."""
