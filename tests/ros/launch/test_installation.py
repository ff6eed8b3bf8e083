"""Where ROS is looked for, and what is said where it is not."""

from pathlib import Path

import pytest

from specs.errors import LaunchRefused
from tasks.ros.launch.launch_plan import LaunchSource, make_home, node_environment, resolve
from tasks.ros.launch.packages import ROS_PYTHON, RosInstallation, ros_installation

OPT = RosInstallation(Path("/usr/bin/python3"), Path("/opt/ros/noetic"), "noetic", "1.15.15")


def test_a_python_that_is_not_there_is_named_with_the_variable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(ROS_PYTHON, "/nowhere/python")
    assert ros_installation().sentence.startswith("/nowhere/python is not there")
    with pytest.raises(LaunchRefused, match=ROS_PYTHON):
        resolve(LaunchSource(Path("/"), "x", "x.launch"), [{}])


def test_a_python_without_ros_says_what_to_install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    bare = tmp_path / "python"
    bare.write_text("#!/bin/sh\necho No module named roslaunch >&2\nexit 1\n")
    bare.chmod(0o755)
    monkeypatch.setenv(ROS_PYTHON, str(bare))
    assert "No module named roslaunch; install ROS 1 Noetic" in ros_installation().missing


def test_an_installation_below_opt_brings_its_own_paths() -> None:
    found = OPT.environment()
    assert found["PATH"].startswith("/opt/ros/noetic/bin:")
    assert found["PYTHONPATH"] == "/opt/ros/noetic/lib/python3/dist-packages"
    assert found["ROS_PACKAGE_PATH"] == "/opt/ros/noetic/share"


def test_a_node_has_the_episodes_variables_and_nothing_of_this_process(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
    variables = {"AWS_ROBOMAKER_SIMULATION_JOB_ID": "sim-1", "ROS_MASTER_URI": "http://elsewhere/"}
    found = node_environment(OPT, tmp_path / "bundle", "http://127.0.0.1:1/", tmp_path / "home", variables)
    assert found["AWS_ROBOMAKER_SIMULATION_JOB_ID"] == "sim-1"
    assert found["ROS_MASTER_URI"] == "http://127.0.0.1:1/"
    assert found["ROS_PACKAGE_PATH"].startswith(f"{tmp_path}/bundle:")
    assert "AWS_SECRET_ACCESS_KEY" not in found


def test_scripts_from_before_noetic_find_their_python(tmp_path: Path) -> None:
    home = make_home(tmp_path / "home", OPT)
    assert (home / "bin/python").readlink() == OPT.python
    assert make_home(home, OPT) == home
