"""Stand-ins for the modules launch and launch_ros where ROS 2 is not. The program beside them may import it."""
