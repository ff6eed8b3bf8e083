"""What runs on a robot, and nothing else. Kit and rollout may import it."""
