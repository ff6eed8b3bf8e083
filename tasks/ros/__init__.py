"""ROS 1 and ROS 2 without ROS: messages, a graph, applications in lock-step. All capabilities may import it."""
