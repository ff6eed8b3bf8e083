"""Drafts of a launch file's robot and world, as `simyard app draft` makes them."""

import shutil
from pathlib import Path

import pytest

from flows.pipeline.bundle_checks import check_own_bundles
from flows.pipeline.references import latest_finder
from flows.pipeline.robot_drafts import draft_of_launch, with_drafts, world_entry, write_draft
from flows.pipeline.tested_batch import batch_plan, launch_faults
from flows.preview.plan import plan_lines
from specs.data.world import Start
from specs.errors import DocumentError
from specs.pipeline.document import PipelineSpec
from specs.pipeline.simulation_section import SimulationBatch
from specs.ros_robot import RobotDraft
from tasks.applications.registry import publish_bundle
from tasks.ros.launch.gazebo_launch import GazeboLaunch
from tasks.ros.launch.launch_plan import LaunchSource
from tasks.ros.launch.packages import RosInstallation
from tasks.storage.archives import list_bundle_files
from tasks.storage.base.store import Store
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


_NODE = "#!/usr/bin/env python3\nimport rospy\nrospy.init_node('stand')\nrospy.spin()\n"


def _document(folder: Path) -> PipelineSpec:
    """Returns a document whose robot application has a node and no robot, which its simulation application spawns."""
    shutil.copytree(GAZEBO, folder / "sim")
    package = folder / "robot/stand"
    (package / "launch").mkdir(parents=True)
    (package / "package.xml").write_text("<package format='2'><name>stand</name></package>")
    (package / "launch/stand.launch").write_text('<launch><node pkg="stand" type="stand.py" name="stand"/></launch>')
    (package / "stand.py").write_text(_NODE)
    (package / "stand.py").chmod(0o755)
    request: dict[str, object] = {
        "maxJobDurationInSeconds": 1,
        "robotApplications": [
            {"application": "stand", "launchConfig": {"packageName": "stand", "launchFile": "stand.launch"}}
        ],
        "simulationApplications": [
            {"application": "hall", "launchConfig": {"packageName": "rover_sim", "launchFile": "hall.launch"}}
        ],
    }
    data: dict[str, object] = {
        "name": "drafted",
        "applications": [
            {"name": "stand", "kind": "robot", "source": "robot"},
            {"name": "hall", "kind": "simulation", "source": "sim"},
        ],
        "worlds": [{"name": "hall", "source": "sim/rover_sim/worlds/hall.world"}],
        "simulationBatch": {"createSimulationJobRequests": [request]},
    }
    return PipelineSpec.model_validate(data)


def test_a_document_whose_robots_are_there_stays_as_it_is(tmp_path: Path):
    spec = _document(tmp_path)
    (tmp_path / "robot/robot.xml").write_text("<mujoco/>")
    assert with_drafts(spec, tmp_path) == (spec, ())


@pytest.mark.long
def test_a_bundle_without_a_robot_gets_that_which_gazebo_spawns(
    ros: RosInstallation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("SIMYARD_CACHE", str(tmp_path / "cache"))
    spec = _document(tmp_path)
    (tmp_path / "robot/ros.yaml").write_text("first_command_s: 5\n")
    drafted = with_drafts(spec, tmp_path)
    stand, hall = drafted.spec.applications
    assert (
        (tmp_path / stand.source / "robot.xml").read_text().startswith("<!-- A draft, made of the description of rover")
    )
    assert (tmp_path / stand.source / "ros.yaml").read_text() == "first_command_s: 5\n"
    assert (tmp_path / stand.source / "stand/stand.py").stat().st_mode & 0o111
    assert not (tmp_path / "robot/robot.xml").exists()
    assert hall.source == "sim"
    assert drafted.notes[0].startswith("stand has no robot.xml: one is drafted of what its launch file spawns")
    assert with_drafts(spec, tmp_path).spec == drafted.spec
    assert any("rover starts at [1, 0.5, 1.57]" in each for each in check_own_bundles(drafted.spec, tmp_path))


def judged_bundle(folder: Path) -> Path:
    """Returns a simulation application without a robot.xml whose launch file starts Gazebo, drives and judges."""
    shutil.copytree(GAZEBO, folder)
    shutil.copytree(ROOT / "tests/data/ros/examiner", folder / "examiner")
    text = '<launch><include file="$(find rover_sim)/launch/hall.launch"/>'
    text += '<include file="$(find examiner)/launch/alone.launch"/></launch>'
    (folder / "rover_sim/launch/judged.launch").write_text(text)
    return folder


@pytest.mark.long
def test_an_application_of_the_store_gets_a_draft_and_keeps_its_version(
    ros: RosInstallation, tmp_path: Path, file_store: Store
):
    version = publish_bundle(file_store, "simulation-application", "judge", judged_bundle(tmp_path / "judge"))
    launch = {"packageName": "rover_sim", "launchFile": "judged.launch"}
    uses = [{"application": "judge", "launchConfig": launch}]
    request: dict[str, object] = {"maxJobDurationInSeconds": 3, "simulationApplications": uses}
    section = SimulationBatch.model_validate({"createSimulationJobRequests": [request]})
    plan = batch_plan(section, (), file_store, latest_finder(file_store))
    (template,) = plan.templates
    assert template.alone
    assert (template.robot.version, template.robot.digest != version.digest) == ("1", True)
    assert "robot.xml" in list_bundle_files(file_store, template.robot.digest)
    assert launch_faults(plan, file_store) == []
    assert batch_plan(section, (), file_store, latest_finder(file_store)) == plan
    spec = PipelineSpec.model_validate({"name": "judged", "simulationBatch": section.model_dump(exclude_none=True)})
    assert any(line.startswith("simulationBatch   1 episode") for line in plan_lines(spec, tmp_path, file_store))
