"""What a bundle declares in files: the base of a ROS robot, a policy. Tasks and flows may import it."""
