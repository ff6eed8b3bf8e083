from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import EnvironmentVariable, LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description():
    speed = EnvironmentVariable("SPEED", default_value="0.2")
    return LaunchDescription(
        [
            DeclareLaunchArgument("speed", default_value=speed),
            Node(
                package="roamer2",
                executable="roam",
                name="roam",
                output="screen",
                parameters=[{"speed": LaunchConfiguration("speed"), "near": 0.45}],
            ),
            Node(package="roamer2", executable="watch", name="watch", output="screen"),
        ]
    )
