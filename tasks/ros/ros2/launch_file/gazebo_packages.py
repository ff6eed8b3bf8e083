"""Packages that stand in for Gazebo's own in launch files of ROS 2, so that those which include them are read.

An install space holds them: ROS 2's own ``launch`` finds them there as well as the stand-ins do. What they call their
launch files, arguments and programs is what the public documentation of ``gazebo_ros`` and ``ros_gz_sim`` says.
"""

import json
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import NamedTuple

from tasks.ros.launch.packages import STAND_INS, has_xacro, make_xacro, write_program


class _Launch(NamedTuple):
    """A launch file of theirs: a program, its arguments (``$name`` for the value of one), and their defaults."""

    program: str
    arguments: tuple[str, ...] = ()
    defaults: Mapping[str, str] = {}


_PLACE = ("x", "y", "z", "R", "P", "Y")
_SPAWN = ("-name", "$entity_name", "-file", "$file", "-topic", "$topic", "-string", "$model_string")
_SPAWN_DEFAULTS: Mapping[str, str] = {
    **dict.fromkeys(("entity_name", "file", "topic", "model_string"), ""),
    **dict.fromkeys(_PLACE, "0"),
}
_CLASSIC = _Launch("gzserver", ("$world",), {"world": ""})
_GZ = _Launch("gz_server", ("$world_sdf_file",), {"world_sdf_file": ""})
_CREATE = _Launch("create", (*_SPAWN, *(word for name in _PLACE for word in (f"-{name}", f"${name}"))), _SPAWN_DEFAULTS)
_LAUNCHES: Mapping[str, Mapping[str, _Launch]] = {
    "gazebo_ros": {
        "gazebo.launch.py": _CLASSIC,
        "gzserver.launch.py": _CLASSIC,
        "gzclient.launch.py": _Launch("gzclient"),
    },
    "ros_gz_sim": {
        "gz_sim.launch.py": _Launch("gz_sim", ("$gz_args",), {"gz_args": ""}),
        "gz_server.launch.py": _GZ,
        "gz_spawn_model.launch.py": _CREATE,
    },
    "ros_ign_gazebo": {"ign_gazebo.launch.py": _Launch("gz_sim", ("$ign_args",), {"ign_args": ""})},
    "ros_gz_bridge": {"ros_gz_bridge.launch.py": _Launch("bridge_node")},
}
_PROGRAMS: Mapping[str, tuple[str, ...]] = {
    "gazebo_ros": ("gzserver", "gzclient", "spawn_entity.py"),
    "gazebo_plugins": (),
    "ros_gz_sim": ("gz_sim", "gz_server", "create"),
    "ros_ign_gazebo": ("gz_sim", "create"),
    "ros_gz_bridge": ("parameter_bridge", "bridge_node"),
    "ros_ign_bridge": ("parameter_bridge",),
    "ros_gz_image": ("image_bridge",),
    "ros_ign_image": ("image_bridge",),
    "rviz2": ("rviz2",),
    "joint_state_publisher": ("joint_state_publisher",),
    "joint_state_publisher_gui": ("joint_state_publisher_gui",),
}
# Where ROS 2 has them, they are its own.
_ELSE: Mapping[str, tuple[str, ...]] = {"robot_state_publisher": ("robot_state_publisher",), "xacro": ()}
_TEXT = """from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

ASKED = {asked}


def generate_launch_description():
    words = [LaunchConfiguration(each[1:]) if each.startswith("$") else each for each in ASKED["arguments"]]
    given = [DeclareLaunchArgument(name, default_value=value) for name, value in ASKED["defaults"].items()]
    return LaunchDescription([*given, Node(package={package!r}, executable=ASKED["program"], arguments=words)])
"""


def make_gazebo_space(folder: Path, known: Collection[str]) -> Path:
    """Makes the install space of these packages, and returns it.

    A program of theirs does nothing: it has a name, by which it is known what it would have done.

    Args:
        folder: Where it is made; what an earlier call made there is the same.
        known: Packages that the bundle and ROS 2 have.
    """
    space = folder / STAND_INS
    if space.is_dir():
        return space
    index = space / "share/ament_index/resource_index/packages"
    index.mkdir(parents=True)
    for name, programs in {**_PROGRAMS, **{name: each for name, each in _ELSE.items() if name not in known}}.items():
        (index / name).touch()
        (space / "lib" / name).mkdir(parents=True)
        for program in programs:
            write_program(space / "lib" / name / program)
        (space / "share" / name / "launch").mkdir(parents=True)
        for file, launch in _LAUNCHES.get(name, {}).items():
            text = _TEXT.format(asked=json.dumps(launch._asdict()), package=name)
            (space / "share" / name / "launch" / file).write_text(text)
    if has_xacro() and "xacro" not in known:
        make_xacro(space / "bin")
    return space
