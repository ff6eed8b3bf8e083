"""ROS messages as bytes: definitions, digests, ROS 1's form and CDR. All of tasks.ros may import it."""
