import os

from launch import LaunchDescription
from launch_ros.actions import Node


def generate_launch_description():
    names = os.environ["NODES"].split()
    programs = [each.partition(":")[::2] for each in names]
    return LaunchDescription([Node(package="trials", executable=each, name=name or each) for each, name in programs])
