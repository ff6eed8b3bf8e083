"""Which file of a bundle a launch configuration means, and where ROS finds the bundle's packages."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from specs.launched_file import is_ros2, module_name, ros_launch_file, simulated_file, workspace_variables

FILES = [
    "robot.xml",
    "patrol/package.xml",
    "patrol/launch/go.launch",
    "patrol/go.launch",
    "patrol/go.py",
    "patrol/net.onnx",
]


@pytest.mark.parametrize(
    ("launch_file", "found"),
    [
        ("go.launch", "patrol/launch/go.launch"),
        ("go.launch.py", "patrol/go.py"),
        ("go.py", "patrol/go.py"),
        ("go", "patrol/go.py"),
        ("net.onnx", "patrol/net.onnx"),
        ("net", "patrol/net.onnx"),
        ("went.launch", None),
    ],
)
def test_a_launch_file_is_looked_for_before_a_module_and_a_module_before_a_policy(launch_file: str, found: str | None):
    assert simulated_file(FILES, "patrol", launch_file) == found


def test_a_package_below_the_root_is_found_by_its_package_xml():
    files = ["ws/src/scout/package.xml", "ws/src/scout/launch/deep/go.launch.py"]
    assert ros_launch_file(files, "scout", "go.launch.py") == files[1]
    assert ros_launch_file(files[1:], "scout", "go.launch.py") is None


def test_a_file_of_another_package_whose_name_begins_alike_is_not_found():
    assert ros_launch_file(["patrol_more/launch/go.launch"], "patrol", "go.launch") is None


@pytest.mark.parametrize(
    ("launch_file", "second"), [("a.launch", False), ("a.launch.py", True), ("a.launch.xml", True)]
)
def test_the_ending_tells_ros_from_ros_2(launch_file: str, second: bool):  # noqa: FBT001 - a parameter
    assert is_ros2(launch_file) is second


@given(st.from_regex(r"[a-z][a-z0-9_]{0,9}", fullmatch=True), st.sampled_from(["", ".py", ".launch", ".launch.py"]))
def test_a_module_has_one_name_by_whatever_ending(name: str, ending: str):
    assert module_name(f"{name}{ending}") == name


BUNDLE, ROS = Path("/b"), {"ROS_PACKAGE_PATH": "/opt/ros/noetic/share", "PYTHONPATH": "/opt/ros/noetic/python"}


def test_packages_of_the_bundle_are_found_before_those_of_ros():
    found = workspace_variables(BUNDLE, ["patrol/package.xml", "patrol/launch/go.launch"], ROS)
    assert found == {"ROS_PACKAGE_PATH": "/b:/opt/ros/noetic/share"}


def test_modules_of_a_package_that_is_not_built_are_imported_from_its_source():
    package = ["src/patrol/package.xml", "src/patrol/setup.py", "src/patrol/src/patrol/__init__.py"]
    found = workspace_variables(BUNDLE, package, ROS)
    assert found["PYTHONPATH"] == "/b/src/patrol/src:/opt/ros/noetic/python"
    assert "PYTHONPATH" not in workspace_variables(BUNDLE, package[:1] + package[2:], ROS)


def test_an_install_space_brings_its_programs_libraries_and_modules():
    files = ["install/_setup_util.py", "install/share/patrol/package.xml", "install/lib/python3/dist-packages/p.py"]
    found = workspace_variables(BUNDLE, files, {})
    assert found["CMAKE_PREFIX_PATH"] == "/b/install"
    assert found["LD_LIBRARY_PATH"] == "/b/install/lib"
    assert found["PYTHONPATH"] == "/b/install/lib/python3/dist-packages"
