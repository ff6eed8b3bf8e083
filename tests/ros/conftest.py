"""ROS 1 for the tests that need it: they skip where it is missing, and fail where CI has to have it."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tasks.ros.launch.packages import RosInstallation, ros_installation
from tasks.ros.lockstep.exchange import Launch
from tests.repository import ROOT

COURIER = ROOT / "tests/data/ros"
_LIBRARIES = ("roscpp", "rostime", "rosconsole", "roscpp_serialization", "boost_thread", "pthread")


def _missing(why: str) -> None:
    if os.environ.get("CI") == "true":
        pytest.fail(f"CI has to have ROS: {why}")
    pytest.skip(why)


@pytest.fixture(scope="session")
def ros() -> RosInstallation:
    """The ROS 1 of this machine."""
    installation = ros_installation()
    if installation.missing:
        _missing(installation.missing)
    return installation


@pytest.fixture(scope="session")
def courier(ros: RosInstallation, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bundle with a package of small nodes, the one in C++ compiled."""
    bundle = tmp_path_factory.mktemp("bundle")
    shutil.copytree(COURIER / "courier", bundle / "courier")
    compiler = shutil.which("g++")
    if compiler is not None and Path("/usr/include/ros/ros.h").exists():
        libraries = [f"-l{name}" for name in _LIBRARIES]
        source, program = bundle / "courier/src/wheel.cpp", bundle / "courier/scripts/wheel"
        subprocess.run([compiler, "-O1", "-o", program, source, *libraries], check=True)
    return bundle


@pytest.fixture(scope="session")
def wheel(courier: Path) -> Path:
    """The same bundle, where its node in C++ could be compiled."""
    if not (courier / "courier/scripts/wheel").exists():
        _missing("g++ and ROS's headers are needed to compile a node in C++")
    return courier


@pytest.fixture
def home(tmp_path: Path) -> Iterator[Path]:
    """A folder for an application, of which nothing may be left."""
    folder = tmp_path / "home"
    yield folder
    assert not folder.exists()


@pytest.fixture
def burners() -> Iterator[None]:
    """A process on each core that computes as long as the test lasts."""
    command = [sys.executable, "-I", "-S", "-c", "while True: pass"]
    running = [subprocess.Popen(command) for _ in range(os.cpu_count() or 2)]
    yield
    for each in running:
        each.kill()
        each.wait()


def launch_of(bundle: Path, file: str, home: Path, environment: list[dict[str, str]]) -> Launch:
    """Returns a launch of the courier's package."""
    return Launch(bundle, "courier", file, home, environment)
