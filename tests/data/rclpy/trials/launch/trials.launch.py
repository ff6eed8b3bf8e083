import os

from launch import LaunchDescription
from launch_ros.actions import Node


def generate_launch_description():
    names = os.environ["NODES"].split()
    return LaunchDescription([Node(package="trials", executable=each, name=each) for each in names])
