"""Where the packages of a bundle have what ROS looks for."""

from pathlib import Path

from specs.launched_file import workspace_variables

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
