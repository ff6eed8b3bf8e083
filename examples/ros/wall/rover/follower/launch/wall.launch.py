from launch import LaunchDescription
from launch_ros.actions import Node


def generate_launch_description():
    return LaunchDescription([Node(package="follower", executable="follow_ros2", name="follow", output="screen")])
