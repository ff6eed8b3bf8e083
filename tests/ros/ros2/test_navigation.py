"""Goals as actions of Nav2's NavigateToPose: what comes of them, of each lane, in lock-step."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from specs.ros_robot import RosRobot, RosTopics
from tasks.ros.lockstep.exchange import FloorMap, GoalEnd, Launch
from tasks.ros.lockstep.ros2_lockstep import Ros2Lockstep
from tasks.ros.lockstep.step_driver import LockstepPatience
from tests.repository import ROOT
from tests.ros.ros2.players import CONTROL_S, Run, drive, make_base

_COSTMAP = "/global_costmap/costmap"
_NAVIGATOR = ROOT / "tests/data/rclpy/navigator"
_ROBOT = RosRobot(goals="navigate_to_pose", first_command_s=3.0)
_GOAL_M = (2.0, 2.0)


def navigate(folder: Path, *plays: str, steps: int = 40, robot: RosRobot = _ROBOT) -> Run:
    """Returns what came of lanes whose navigators do what they are told."""
    environments = [{"PLAYS": each} for each in plays]
    return drive(folder, "navigator", len(plays), steps, robot=robot, environments=environments)


def test_a_goal_that_is_aborted_ends_its_lane_with_nav2s_error_code(tmp_path: Path) -> None:
    run = navigate(tmp_path, "aborts")
    assert (run.failures, run.goal_ends) == ({}, {0: GoalEnd("aborted", 9002)})
    assert (run.tallies[0].late, run.tallies[0].stray) == (0, 0)
    assert run.commands[0][0].turn_rad_s
    assert run.tallies[0].recoveries == 20 // 8, "as its own feedback says, not another goal's"


@pytest.mark.long
def test_each_lane_has_its_own_end_and_the_same_commands_as_alone(tmp_path: Path) -> None:
    plays = ("", "cancels", "busy", "late")
    run = navigate(tmp_path / "four", *plays, steps=280)
    assert (run.failures, run.goal_ends) == ({}, {1: GoalEnd("canceled", 0), 2: GoalEnd("aborted", 0)})
    assert not any(each.late or each.stray for each in run.tallies)
    assert [bool(np.linalg.norm(pose[:2] - _GOAL_M) < 0.35) for pose in run.poses] == [True, False, False, True]
    assert [each.ahead_m_s for each in run.commands[3]].count(0.0) > 40, "it stands until its goal is taken"
    assert navigate(tmp_path / "one", "", steps=280).digests == run.digests[:1]


@pytest.mark.soak
@pytest.mark.usefixtures("nav2_msgs")
def test_a_navigator_of_rclpy_gets_there_by_the_map_alone_and_among_four(tmp_path: Path) -> None:
    robot = _ROBOT.model_copy(
        update={"topics": RosTopics(floor_map="/map"), "record": {_COSTMAP: "nav_msgs/OccupancyGrid"}}
    )
    cells = np.full((60, 60), 100, np.int8)
    cells[1:-1, 1:-1] = 0
    floor, digests = FloorMap(cells, (-3.0, -3.0), 0.1), list[str]()
    for lanes in (1, 4):
        folder = tmp_path / str(lanes)
        shutil.copytree(_NAVIGATOR, folder / "bundle/navigator")
        launch = Launch(folder / "bundle", "navigator", "navigator.launch.py", folder / "home", [{}] * lanes)
        patience = LockstepPatience(stage_s=20.0)  # far more than a node takes, on a machine that does much else
        with Ros2Lockstep(launch, make_base(robot), CONTROL_S, patience=patience) as lockstep:
            run = Run(lockstep, lanes, 200, floor)
            assert [topic for topic, _ in lockstep.heard(0)] == [_COSTMAP]
        assert (run.failures, run.goal_ends) == ({}, {})
        assert not any(each.late or each.stray for each in run.tallies)
        assert float(np.linalg.norm(run.poses[0][:2] - _GOAL_M)) < 0.2
        digests.append(run.digests[0])
    assert digests[0] == digests[1]


@pytest.mark.soak
@pytest.mark.usefixtures("nav2_msgs")
def test_a_document_whose_goals_are_actions_passes_its_gate(tmp_path: Path) -> None:
    data, bundle = _NAVIGATOR.parent, tmp_path / "bundle"
    shutil.copytree(_NAVIGATOR, bundle / "navigator")
    shutil.copy(ROOT / "examples/ros/turtlebot3/robot.xml", bundle)
    shutil.copy(data / "nav_ros.yaml", bundle / "ros.yaml")
    shutil.copy(ROOT / "examples/templates/two-rooms.json", tmp_path)
    shutil.copy(data / "nav.yaml", tmp_path)
    store = (tmp_path / "store").as_uri()
    command = [Path(sys.executable).with_name("simyard"), "run", "nav.yaml", "--direct", "--store", store]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    (path,) = tmp_path.glob("store/buckets/results/nav/*/results.parquet")
    rows = pq.read_table(path).to_pylist()
    found = [(row["outcome"], row["late"], row["stray"], dict(row["metrics"])["navigation_recoveries"]) for row in rows]
    assert found == [("Passed", 0, 0, 0.0)] * 4
