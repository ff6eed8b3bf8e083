"""A DDS domain, and ROS 2's rclpy: its wheels, in a folder of their own that is kept from run to run."""

import hashlib
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tasks.ros.ros2.dds_domain import EpisodeDomain, episode_domains
from tests.repository import ROOT

_MAKE, _PINS = ROOT / "examples/ros/make_wheels.sh", ROOT / "examples/ros/wheels.txt"
_MAKE_NAV2 = ROOT / "tests/data/rclpy/make_nav2_msgs.sh"
_FOLDER = Path.home() / ".cache/simyard-tests" / f"ros2-{hashlib.sha256(_PINS.read_bytes()).hexdigest()[:16]}"


@pytest.fixture
def domain() -> Iterator[EpisodeDomain]:
    """A domain that no other process has."""
    (found,) = episode_domains(1)
    yield found
    found.close()


@pytest.fixture(scope="session")
def wheels() -> Path:
    """The folder, in which they are installed once."""
    if os.environ.get("AMENT_PREFIX_PATH"):
        pytest.skip("the tests of rclpy are for the wheels, and AMENT_PREFIX_PATH names another ROS 2")
    done = subprocess.run([_MAKE, _FOLDER], capture_output=True, text=True, check=False)
    if done.returncode:
        why = f"ROS 2's wheels cannot be installed: {done.stderr.strip()[-500:]}"
        pytest.fail(why) if os.environ.get("CI") == "true" else pytest.skip(why)
    return _FOLDER


@pytest.fixture
def rclpy(wheels: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """This machine with ROS 2."""
    for name in ("ROS_DISTRO", "RMW_IMPLEMENTATION"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(wheels))
    return wheels


@pytest.fixture
def nav2_msgs(monkeypatch: pytest.MonkeyPatch) -> Path:
    """This machine with ROS 2, and nav2_msgs built from Nav2's own definition."""
    folder = _FOLDER.with_name(f"{_FOLDER.name}-nav2")
    done = subprocess.run([_MAKE_NAV2, folder], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(folder))
    return folder


@pytest.fixture
def rclpy_that_is_here(request: pytest.FixtureRequest) -> Path:
    """The same where they are installed already: that takes minutes."""
    if not (_FOLDER / ".ready").is_file() and os.environ.get("CI") != "true":
        pytest.skip(f"ROS 2's wheels are not in {_FOLDER}: make test-all puts them there")
    return request.getfixturevalue("rclpy")
