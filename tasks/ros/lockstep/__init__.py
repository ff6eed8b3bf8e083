"""Episodes in lock-step with ROS applications, ROS 1 or ROS 2. Simulate may import it."""
