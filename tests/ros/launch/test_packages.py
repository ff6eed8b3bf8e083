"""Where ROS is looked for, and what is said where it is not."""

from collections.abc import Callable
from pathlib import Path

import pytest

from specs.errors import LaunchRefused
from tasks.ros.launch import packages
from tasks.ros.launch.launch_plan import LaunchSource, make_ros_home, node_environment, resolve_launch
from tasks.ros.launch.packages import ROS_PYTHON, RosInstallation, bundle_packages, missing_packages, ros_installation

OPT = RosInstallation(Path("/usr/bin/python3"), Path("/opt/ros/noetic"), "noetic", "1.15.15")


def test_a_python_that_is_not_there_is_named_with_the_variable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(ROS_PYTHON, "/nowhere/python")
    assert ros_installation().sentence.startswith("/nowhere/python is not there")
    with pytest.raises(LaunchRefused, match=ROS_PYTHON):
        resolve_launch(LaunchSource(Path("/"), "x", "x.launch"), [{}])


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
    home = make_ros_home(tmp_path / "home", OPT)
    assert (home / "bin/python").readlink() == OPT.python
    assert make_ros_home(home, OPT) == home


Add = Callable[..., None]


@pytest.fixture
def prefix(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A ROS that has rospy and nothing else."""
    (tmp_path / "ros/share/rospy").mkdir(parents=True)
    (tmp_path / "ros/share/rospy/package.xml").write_text("<package><name>rospy</name></package>")
    found = RosInstallation(Path("/usr/bin/python3"), tmp_path / "ros", "noetic", "1")
    monkeypatch.setattr(packages, "ros_installation", lambda: found)
    monkeypatch.setattr(packages, "_DEBIAN_INFO", tmp_path / "none")
    return tmp_path / "ros"


@pytest.fixture
def add(tmp_path: Path) -> Add:
    def write(name: str, *needs: str, kind: str = "exec_depend") -> None:
        folder = tmp_path / "bundle" / name
        folder.mkdir(parents=True)
        tags = "".join(f"<{kind}>{need}</{kind}>" for need in needs)
        (folder / "package.xml").write_text(f"<package><name>{name}</name>{tags}</package>")

    return write


def test_packages_of_the_bundle_are_followed_to_what_is_missing(prefix: Path, add: Add, tmp_path: Path) -> None:
    add("robot", "rospy", "arm")
    add("arm", "move_base", kind="depend")
    (found,) = missing_packages(tmp_path / "bundle", "robot")
    assert (found.name, found.needed_by) == ("move_base", "arm")
    assert "ros-noetic-move-base" in found.sentence


def test_what_only_the_build_needs_is_not_missing(prefix: Path, add: Add, tmp_path: Path) -> None:
    add("robot", "catkin", kind="buildtool_depend")
    assert missing_packages(tmp_path / "bundle", "robot") == []


@pytest.mark.parametrize(
    ("condition", "needed"),
    [
        ("$ROS_VERSION == 1", True),
        ("$ROS_VERSION==2", False),
        ("$ROS_VERSION != '2'", True),
        ("$ROS_VERSION != 1", False),
        ("$ROS_VERSION == 2 or $ROS_DISTRO == noetic", True),
    ],
)
def test_what_the_other_ros_needs_is_not_missing(
    prefix: Path, add: Add, tmp_path: Path, condition: str, *, needed: bool
) -> None:
    add("robot", "nowhere")
    manifest = tmp_path / "bundle/robot/package.xml"
    manifest.write_text(manifest.read_text().replace("<exec_depend>", f'<exec_depend condition="{condition}">'))
    assert bool(missing_packages(tmp_path / "bundle", "robot")) == needed


def test_a_ring_of_packages_comes_to_an_end(prefix: Path, add: Add, tmp_path: Path) -> None:
    add("one", "two")
    add("two", "one")
    assert missing_packages(tmp_path / "bundle", "one") == []


def test_a_package_that_the_bundle_lacks_is_refused_with_those_it_has(prefix: Path, add: Add, tmp_path: Path) -> None:
    add("robot")
    with pytest.raises(LaunchRefused, match="which has robot"):
        missing_packages(tmp_path / "bundle", "robto")


_ENTITIES = "<!DOCTYPE p [<!ENTITY a 'b'>]><package>&a;</package>"


@pytest.mark.parametrize(
    "text",
    [
        b"<package",
        _ENTITIES.encode(),
        _ENTITIES.encode("utf-16"),
        b"<?xml version='1.0' encoding='none'?><package/>",
        b"<package>" + b" " * (1 << 20) + b"</package>",
    ],
)
def test_a_package_xml_that_cannot_be_read_is_named(prefix: Path, tmp_path: Path, text: bytes) -> None:
    (tmp_path / "bundle/robot").mkdir(parents=True)
    (tmp_path / "bundle/robot/package.xml").write_bytes(text)
    with pytest.raises(LaunchRefused, match=r"package\.xml"):
        bundle_packages(tmp_path / "bundle")


@pytest.mark.parametrize("need", ["/etc", "**/*", "../../x", "a b", "**x"])
def test_a_need_that_is_no_name_is_refused_and_looked_for_nowhere(
    prefix: Path, add: Add, tmp_path: Path, need: str
) -> None:
    add("robot", need)
    with pytest.raises(LaunchRefused, match="is no name of a package"):
        missing_packages(tmp_path / "bundle", "robot")
