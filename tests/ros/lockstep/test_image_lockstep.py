"""ROS 1 in a container image, in lock-step: as outside, with the ROS that the image has."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from specs.bundle_files import ContainerImage
from specs.launched_file import IMAGE_FILE
from tasks.ros.launch.launch_plan import LaunchSource
from tasks.ros.launch.packages import RosInstallation
from tasks.ros.lockstep.exchange import Launch
from tests.ros.lockstep.room import drive, nothing_left

_DIGEST = "1" * 64
_STEPS = 20


@pytest.fixture
def packages(courier: Path) -> Iterator[Path]:
    """The courier's packages outside ``/tmp``, which is another one inside."""
    with tempfile.TemporaryDirectory(dir="/var/tmp") as folder:
        yield shutil.copytree(courier, Path(folder) / "src")


@pytest.fixture
def image(packages: Path, ros: RosInstallation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A bundle whose image is this machine: what ROS needs is in it."""
    if shutil.which("bwrap") is None:
        (pytest.fail if os.environ.get("CI") else pytest.skip)("apt-get install bubblewrap")
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path / "cache"))
    (tmp_path / "cache/images" / _DIGEST).mkdir(parents=True)
    (tmp_path / "cache/images" / _DIGEST / "files").symlink_to("/")
    own = ros.environment()
    environment = {**own, "ROS_PACKAGE_PATH": f"{packages}:{own['ROS_PACKAGE_PATH']}"}
    told = ContainerImage(digest=_DIGEST, architecture="X86_64", environment=environment, ros=1)
    (tmp_path / "bundle").mkdir()
    (tmp_path / "bundle" / IMAGE_FILE).write_text(told.model_dump_json())
    return tmp_path / "bundle"


@pytest.mark.long
@pytest.mark.parametrize(("file", "kind"), [("fault.launch", "none"), ("gives_up.launch", "message")])
def test_an_image_gives_the_commands_that_its_launch_file_gives_outside(
    image: Path, packages: Path, home: Path, file: str, kind: str
) -> None:
    environment = [{"KIND": kind}] * 2
    outside = drive(Launch(packages, "courier", file, home, environment), [0, 1], _STEPS)
    command = ("roslaunch", "courier", file)
    inside = drive(Launch(image, "", "", home, environment, command=command), [0, 1], _STEPS)
    assert nothing_left(home)
    assert (outside.failures, inside.failures) == ({}, {})
    assert inside.digests == outside.digests
    assert {(tally.late, tally.stray, tally.commands > 0) for tally in inside.tallies} == {(0, 0, True)}


_JUDGE = """#!/usr/bin/env python3
import rospy
from nav_msgs.msg import Odometry
rospy.init_node("judge")
rospy.Subscriber("/odom", Odometry, lambda seen: print("seen", seen.header.stamp.to_sec(), flush=True))
rospy.spin()
"""


@pytest.mark.long
def test_an_image_judges_beside_nodes_and_beside_another_image_as_a_launch_file_does(
    image: Path, packages: Path, home: Path
) -> None:
    judge = packages / "judge"
    (judge / "launch").mkdir(parents=True)
    (judge / "package.xml").write_text("<package format='2'><name>judge</name></package>")
    (judge / "launch/judge.launch").write_text(
        '<launch><node pkg="judge" type="judge.py" name="judge" output="screen"/></launch>'
    )
    (judge / "judge.py").write_text(_JUDGE)
    (judge / "judge.py").chmod(0o755)
    words, judging = (
        ("roslaunch", each, f"{file}.launch") for each, file in (("courier", "fault"), ("judge", "judge"))
    )
    outside = Launch(packages, "courier", "fault.launch", home, [{"KIND": "none"}])
    inside = Launch(image, "", "", home, [{"KIND": "none"}], command=words)
    judges = LaunchSource(packages, "judge", "judge.launch"), LaunchSource(image, "", "", judging)
    asked = [(outside, judges[0]), (outside, judges[1]), (inside, judges[1])]
    found = [drive(robot._replace(simulation=each), [0], _STEPS) for robot, each in asked]
    assert [each.failures for each in found] == [{}, {}, {}]
    assert len({each.digests[0] for each in found}) == 1
    assert [(each.tallies[0].late, each.tallies[0].stray) for each in found] == [(0, 0)] * 3
    assert all("simulation application:" in each.printed[0] and "seen 2" in each.printed[0] for each in found)
    crashed = drive(inside._replace(simulation=LaunchSource(image, "", "", ("sh", "-c", "exit 7"))), [0], 1)
    assert crashed.failures[0] == "node /simulation-image ended with status 7"
    assert nothing_left(home)


@pytest.mark.long
def test_what_an_image_lacks_or_ends_with_is_the_reason(image: Path, home: Path) -> None:
    nothing = drive(Launch(image, "", "", home, [{}], command=("nowhere",)), [0], 1)
    assert "the image has no program 'nowhere'" in nothing.failures[0]
    ended = drive(Launch(image, "", "", home, [{}], command=("sh", "-c", "echo why; exit 7")), [0], 1)
    assert ended.failures[0] == "node /image ended with status 7: why"
    assert nothing_left(home)
