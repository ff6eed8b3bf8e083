"""docs/guide/ros.md says what there is, and whatever it tells one to type is typed; so is the example run, in small."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pyarrow.parquet as pq
import pytest
import yaml

from specs.ros_robot import RosFrames, RosRobot, RosTopics
from tasks.deploy.step import agents_folder
from tasks.ros.launch.robot_command import OWN_VARIABLES
from tasks.ros.lockstep.robot_topics import published
from tasks.storage.store_url import open_store
from tests.repository import ROOT
from tests.ros.ros2.conftest import wheels

__all__ = ["wheels"]

PAGE = (ROOT / "docs/guide/ros.md").read_text()
EXAMPLE = (ROOT / "examples/ros.yaml").read_text()
NEEDS_ROS = pytest.mark.skipif(
    shutil.which("roslaunch") is None and os.environ.get("CI") != "true", reason="ROS 1 is not installed"
)


def _cells(row: str) -> tuple[list[str], list[str]]:
    """Returns the names in the second and the third cell of the table about ros.yaml, in the row of a field."""
    cells = next(line for line in PAGE.splitlines() if line.startswith(f"| `{row}` |")).split("|")
    return re.findall(r"`([\w/]+)`", cells[2]), re.findall(r"`([\w/]+)`", cells[3])


def test_every_field_of_the_declaration_is_explained():
    table = PAGE.split("## ros.yaml")[1].split("## ")[0]
    assert re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE) == [*RosRobot.model_fields]


def test_the_defaults_of_topics_and_frames_are_those_that_it_says():
    for row, declared in (("topics", RosTopics()), ("frames", RosFrames())):
        names, defaults = _cells(row)
        fields = declared.model_dump()
        assert [name for name in names if name != "null"] == [*fields]
        assert defaults == [value for value in fields.values() if value]


def test_the_robot_that_sees_may_be_declared():
    (text,) = re.findall(r"<!-- file: sensors/ros.yaml -->\n```yaml\n(.*?)```", PAGE, re.DOTALL)
    robot = RosRobot.model_validate(yaml.safe_load(text))
    assert robot.range_topics == ("/sonar_0", "/sonar_1", "/sonar_2")
    assert {"/camera/depth/image_raw", "/camera/color/image_raw", "/sonar_2"} <= {
        each.name for each in published(robot)
    }


def test_what_it_shows_of_the_example_is_the_example():
    parts = re.findall(r"<!-- part of: examples/ros.yaml -->\n```yaml\n(.*?)```", PAGE, re.DOTALL)
    assert len(parts) == 2
    assert all(part in EXAMPLE for part in parts)


def test_it_names_every_variable_that_a_robots_owner_hands_on():
    assert all(f"`{name}`" in PAGE for name in OWN_VARIABLES)


def _checkout(folder: Path) -> Path:
    shutil.copytree(ROOT / "examples", folder / "examples")
    return folder


def _typed(command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    variables = {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}
    return subprocess.run(
        ["bash", "-euo", "pipefail", "-c", command],
        cwd=folder,
        env={**os.environ, **variables, "SIMYARD_STORE": (folder / "store").as_uri()},
        capture_output=True,
        text=True,
        check=False,
    )


def _write_smaller(document: Path, smaller: Mapping[str, str]) -> None:
    text = document.read_text()
    for before, after in smaller.items():
        assert before in text
        text = text.replace(before, after)
    document.write_text(text)


@NEEDS_ROS
@pytest.mark.long
@pytest.mark.integration
@pytest.mark.parametrize("block", re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL))
def test_each_shell_block_succeeds(block: str, tmp_path: Path):
    done = _typed(block, _checkout(tmp_path))

    assert done.returncode == 0, done.stderr
    if "app draft" in block:
        assert (tmp_path / "my_robot/robot.xml").is_file()
        assert "source: examples/ros/gazebo/rover_sim/worlds/hall.world, start: [1, 0.5, 1.57]" in done.stdout
        return
    assert "roamer roam.launch starts /roam (roamer roam.py)" in done.stdout
    assert "robots run roslaunch roamer roam.launch" in done.stdout


@NEEDS_ROS
@pytest.mark.long
@pytest.mark.integration
def test_the_example_goes_from_a_launch_file_to_a_robot(tmp_path: Path):
    folder = _checkout(tmp_path)
    smaller = {
        "floorplanCount: 2": "floorplanCount: 1",
        "seeds: 4": "seeds: 2",
        "audit: {lanes: 1}": "audit: {lanes: 0}",
        "atLeast: 0.5": "atLeast: 0.2",
        "maxJobDurationInSeconds: 60": "maxJobDurationInSeconds: 40",
    }
    _write_smaller(folder / "examples/ros.yaml", smaller)

    done = _typed("simyard run examples/ros.yaml --direct", folder)

    assert done.returncode == 0, done.stdout + done.stderr
    robots = agents_folder(open_store((folder / "store").as_uri()))
    logs = list((robots / "roamers-1/logs").glob("*-launch.log"))
    assert any("process[roam-" in log.read_text() for log in logs)


@NEEDS_ROS
@pytest.mark.long
@pytest.mark.integration
def test_pictures_lead_nodes_of_either_ros_along_walls_and_to_the_same_row(wheels: Path, tmp_path: Path):
    folder = _checkout(tmp_path)
    smaller = {
        "floorplanCount: 2": "floorplanCount: 1",
        "seeds: 2": "seeds: 1",
        "audit: {lanes: 1}": "audit: {lanes: 0}",
        "atLeast: 0.5": "atLeast: 0.2",
    }
    _write_smaller(folder / "examples/ros/wall.yaml", smaller)

    done = _typed(f"AMENT_PREFIX_PATH={wheels} simyard run examples/ros/wall.yaml --direct", folder)

    assert done.returncode == 0, done.stdout + done.stderr
    (results,) = folder.glob("store/buckets/results/wall/simb-*/results.parquet")
    ros1, ros2 = pq.read_table(results).to_pylist()
    assert (ros1["success"], ros1["late"], ros1["stray"]) == (True, 0, 0)
    differ = {name for name, cell in ros1.items() if cell != ros2[name]}
    assert differ == {"index", "job", "robot_launch_file"}


@pytest.mark.long
@pytest.mark.integration
@pytest.mark.timeout(900)
def test_make_ros2_goes_from_a_launch_file_of_rclpy_to_a_robot(wheels: Path, tmp_path: Path):
    command = f"AMENT_PREFIX_PATH={wheels} SIMYARD_ROS2_WORK={tmp_path}/work {ROOT}/examples/ros/make_ros2.sh"

    done = _typed(command, tmp_path)

    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.endswith("Done, and everything that was asked for passed.\n")
    robots = agents_folder(open_store((tmp_path / "store").as_uri()))
    log = "".join(each.read_text() for each in (robots / "roamers2-1/logs").glob("*-launch.log"))
    assert "process[roam]: started" in log
    assert "process[watch]: started" in log
