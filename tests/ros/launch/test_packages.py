"""What a bundle's packages need, by their package.xml."""

from collections.abc import Callable
from pathlib import Path

import pytest

from specs.errors import LaunchRefused
from tasks.ros.launch import packages
from tasks.ros.launch.packages import RosInstallation, bundle_packages, missing_packages

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
