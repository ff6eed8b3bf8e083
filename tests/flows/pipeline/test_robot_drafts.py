"""Drafts of a launch file's robot and world, as `simyard app draft` makes them."""

import shutil
from pathlib import Path

import pytest

from flows.pipeline.robot_drafts import draft_of_launch, world_entry, write_draft
from specs.data.world import Start
from specs.errors import DocumentError
from tasks.applications.robot_draft import RobotDraft
from tasks.ros.launch.gazebo_launch import GazeboLaunch
from tasks.ros.launch.launch_plan import LaunchSource
from tasks.ros.launch.packages import RosInstallation
from tests.repository import ROOT
from tests.ros.conftest import ros

__all__ = ["ros"]
GAZEBO = ROOT / "examples/ros/gazebo"


def test_what_somebody_wrote_is_not_written_over(tmp_path: Path):
    (tmp_path / "ros.yaml").write_text("lidar: null\n")
    with pytest.raises(DocumentError, match=r"--out: .*ros\.yaml: a folder without them"):
        write_draft(RobotDraft(robot_xml="<mujoco/>", ros_yaml="{}"), tmp_path)
    assert [each.name for each in tmp_path.iterdir()] == ["ros.yaml"]


def test_the_entry_of_a_world_names_its_file_from_the_documents_folder(tmp_path: Path):
    asked = GazeboLaunch(
        world=tmp_path / "sim/hall.world", model_folders=(tmp_path / "sim/models",), spawn=Start(x_m=1.0, y_m=-2.5)
    )
    assert world_entry(asked, tmp_path) == (
        "- {name: hall, source: sim/hall.world, models: [sim/models], start: [1, -2.5, 0]}"
    )
    assert world_entry(GazeboLaunch(), tmp_path) == ""


@pytest.mark.long
def test_a_launch_file_that_spawns_nothing_is_refused_with_what_it_lacks(ros: RosInstallation, tmp_path: Path):
    bundle = tmp_path / "gazebo"
    shutil.copytree(GAZEBO, bundle)
    launch = bundle / "rover_sim/launch/hall.launch"
    launch.write_text(launch.read_text().replace("robot_description", "other", 1))
    with pytest.raises(DocumentError, match="spawns what the parameter /robot_description describes, and nobody sets"):
        draft_of_launch(LaunchSource(bundle, "rover_sim", "hall.launch"), {})
