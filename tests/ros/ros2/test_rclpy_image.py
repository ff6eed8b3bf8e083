"""Nodes of rclpy in a container image that judges, beside the robot's, in lock-step."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from specs.bundle_files import ContainerImage
from specs.launched_file import IMAGE_FILE
from tasks.ros.launch.launch_plan import LaunchSource
from tasks.ros.lockstep.exchange import Launch
from tasks.ros.lockstep.ros2_lockstep import Ros2Lockstep
from tasks.ros.lockstep.step_driver import LockstepPatience
from tasks.ros.ros2.ros2_installation import ros2_installation
from tests.repository import ROOT
from tests.ros.lockstep.room import nothing_left
from tests.ros.ros2.players import CONTROL_S, Run, make_base, make_rclcpp

_DIGEST, _PATIENT = "2" * 64, LockstepPatience(stage_s=20.0)
_JUDGE = """
import rclpy
from nav_msgs.msg import Odometry
from rclpy.parameter import Parameter
rclpy.init()
node = rclpy.create_node("judge", parameter_overrides=[Parameter("use_sim_time", value=True)])
hear = lambda seen: print("seen", seen.header.stamp.sec, flush=True)
node.create_subscription(Odometry, "odom", hear, 10)
rclpy.spin(node)
"""

_TIMED = """
import ctypes
ctypes.CDLL("librclcpp.so")
import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.parameter import Parameter
rclpy.init()
node, fired = rclpy.create_node("judge", parameter_overrides=[Parameter("use_sim_time", value=True)]), []
def fire():
    fired.append(node.get_clock().now().nanoseconds)
    print("fired", len(fired), "times at", fired[-1], flush=True)
node.create_timer(0.05, fire, clock=Clock(clock_type=ClockType.STEADY_TIME))
rclpy.spin(node)
"""


@pytest.fixture
def judge() -> Iterator[Path]:
    """A program outside ``/tmp``, which is another one inside."""
    with tempfile.TemporaryDirectory(dir="/var/tmp") as folder:
        path = Path(folder) / "judge.py"
        path.write_text(_JUDGE)
        yield path


@pytest.fixture
def image(rclpy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A bundle whose image is this machine: what rclpy needs is in it."""
    if shutil.which("bwrap") is None:
        (pytest.fail if os.environ.get("CI") else pytest.skip)("apt-get install bubblewrap")
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path / "cache"))
    (tmp_path / "cache/images" / _DIGEST).mkdir(parents=True)
    (tmp_path / "cache/images" / _DIGEST / "files").symlink_to("/")
    variables = ros2_installation().environment()
    told = ContainerImage(digest=_DIGEST, architecture="X86_64", environment=variables, ros=2)
    (tmp_path / "judge").mkdir()
    (tmp_path / "judge" / IMAGE_FILE).write_text(told.model_dump_json())
    return tmp_path / "judge"


@pytest.fixture
def rclcpp(rclpy: Path, judge: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """This machine with what stands for rclcpp."""
    found = make_rclcpp(judge.parent / "rclcpp")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{found}:{rclpy}")
    return found


def _drive(folder: Path, judge: LaunchSource | None = None) -> tuple[Run, str]:
    folder.mkdir()
    shutil.copytree(ROOT / "examples/ros/roamer2", folder / "bundle/roamer2")
    launch = Launch(folder / "bundle", "roamer2", "roam.launch.py", folder / "home", [{"SPEED": "0.2"}], judge)
    with Ros2Lockstep(launch, make_base(), CONTROL_S, patience=_PATIENT) as lockstep:
        run, printed = Run(lockstep, 1, 25), lockstep.printed(0)
    assert nothing_left(folder / "home")
    return run, printed


@pytest.mark.long
def test_an_image_with_rclpy_judges_beside_nodes_that_drive_as_they_do_without(
    image: Path, judge: Path, rclpy: Path, tmp_path: Path
) -> None:
    alone, _ = _drive(tmp_path / "alone")
    words = (str(rclpy / "bin/python3"), str(judge))
    both, printed = _drive(tmp_path / "both", LaunchSource(image, "", "", words))
    assert (alone.failures, both.failures) == ({}, {}), printed
    assert both.digests == alone.digests
    assert [(each.late, each.stray) for each in (*alone.tallies, *both.tallies)] == [(0, 0)] * 2
    assert "simulation application:" in printed
    assert "seen 2" in printed
    ended, _ = _drive(tmp_path / "ended", LaunchSource(image, "", "", ("sh", "-c", "echo why; exit 7")))
    assert ended.failures[0] == "node /simulation-image ended with status 7: why"


@pytest.mark.long
@pytest.mark.usefixtures("rclcpp")
def test_the_steady_clock_in_an_image_is_simulated_time(judge: Path, rclpy: Path, image: Path, tmp_path: Path) -> None:
    """A timer has not fired while nodes started, and once a tick since."""
    judge.write_text(_TIMED)
    words = (str(rclpy / "bin/python3"), str(judge))
    run, printed = _drive(tmp_path / "run", LaunchSource(image, "", "", words))
    assert run.failures == {}, printed
    assert "fired 20 times at 2000000000" in printed
    assert [(each.late, each.stray) for each in run.tallies] == [(0, 0)]
