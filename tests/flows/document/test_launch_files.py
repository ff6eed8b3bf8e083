"""What `simyard validate` can know without a store of what a document launches."""

import shutil
from pathlib import Path
from typing import Any

import pytest

from flows.pipeline.bundle_checks import check_launch_files, check_own_bundles, unchecked_references
from specs.errors import DocumentError
from specs.pipeline.document import PipelineSpec
from tasks.simulate.plan.plan_batch import plan_batch
from tests.repository import ROOT


def _use(application: str, package: str, file: str) -> dict[str, Any]:
    return {"application": application, "launchConfig": {"packageName": package, "launchFile": file}}


def _spec(folder: Path, robot: dict[str, Any], **sections: object) -> PipelineSpec:
    if not (folder / "mine").exists():
        shutil.copytree(ROOT / "applications/courier", folder / "mine")
    request = {
        "maxJobDurationInSeconds": 60,
        "robotApplications": [robot],
        "simulationApplications": [_use("delivery", "delivery", "rooms")],
    }
    batch = {"matrix": {"worlds": ["g/w"]}, "createSimulationJobRequests": [request]}
    own = [{"name": "mine", "source": "mine"}]
    return PipelineSpec.model_validate({"name": "n", "applications": own, "simulationBatch": batch, **sections})


def test_a_launch_file_that_the_own_bundle_does_not_have_is_refused(tmp_path: Path):
    with pytest.raises(DocumentError, match=r"launchFile: 'go_to_gaol': a module in mine's bundle"):
        check_launch_files(_spec(tmp_path, _use("mine", "courier", "go_to_gaol")), tmp_path)


def test_a_script_that_the_own_bundle_does_not_have_is_refused(tmp_path: Path):
    deployment = {"fleet": "team", "deploymentApplicationConfigs": [_use("mine", "courier", "walk.sh")]}
    spec = _spec(tmp_path, _use("mine", "courier", "go_to_goal"), deployment=deployment)
    with pytest.raises(DocumentError, match=r"deploymentApplicationConfigs\[0\].launchConfig.launchFile: 'walk.sh'"):
        check_launch_files(spec, tmp_path)


@pytest.mark.parametrize(
    ("changes", "paths"),
    [
        ({"robotApplications": None}, ["robotApplications"]),
        ({"simulationApplications": None}, ["simulationApplications"]),
        (
            {"robotApplications": [{"application": "mine", "launchConfig": {"command": ["go"]}}]},
            [f"robotApplications[0].launchConfig.{name}" for name in ("packageName", "launchFile")],
        ),
    ],
)
def test_what_cannot_be_driven_is_refused_without_a_store_in_the_words_of_a_plan(
    tmp_path: Path, changes: dict[str, Any], paths: list[str]
):
    document = _spec(tmp_path, _use("mine", "courier", "go_to_goal")).model_dump(mode="json", exclude_none=True)
    document["simulationBatch"]["createSimulationJobRequests"][0] |= changes
    spec = PipelineSpec.model_validate(document)
    assert spec.simulationBatch is not None

    with pytest.raises(DocumentError) as refused:
        check_own_bundles(spec, tmp_path)
    with pytest.raises(DocumentError) as planned:
        plan_batch(spec.simulationBatch, ("g/w",), {}, lambda *_: pytest.fail("looked up"))

    where = "simulationBatch.createSimulationJobRequests[0]"
    assert [fault.path for fault in refused.value.faults] == [f"{where}.{path}" for path in paths]
    assert refused.value.faults == planned.value.faults


def test_what_is_there_is_not_refused(tmp_path: Path):
    check_launch_files(_spec(tmp_path, _use("mine", "courier", "go_to_goal")), tmp_path)


def test_what_only_the_store_knows_is_listed_once(tmp_path: Path):
    deployment = {"fleet": "team", "deploymentApplicationConfigs": [_use("tuger", "courier", "run.sh")]}
    spec = _spec(tmp_path, _use("tuger", "courier", "x"), deployment=deployment)
    assert unchecked_references(spec) == ["robot application tuger", "fleet team"]


def _ros_package(folder: Path, *files: str) -> None:
    """Makes a bundle called mine that has a ROS package patrol with these files, all empty."""
    for name in ("patrol/package.xml", *files):
        path = folder / "mine" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("")


@pytest.mark.parametrize(
    ("package", "place"),
    [
        ("patrol", "patrol/launch/go.launch"),
        ("patrol", "patrol/go.launch"),
        ("scout", "ws/src/scout/launch/more/go.launch"),
    ],
)
def test_a_launch_file_of_ros_may_lie_where_roslaunch_finds_it(tmp_path: Path, package: str, place: str):
    _ros_package(tmp_path, place, "robot.xml", "ws/src/scout/package.xml")
    check_launch_files(_spec(tmp_path, _use("mine", package, "go.launch")), tmp_path)


def test_a_launch_file_that_a_ros_package_does_not_have_is_refused_with_the_places_where_it_was_looked_for(
    tmp_path: Path,
):
    _ros_package(tmp_path, "patrol/launch/go.launch", "robot.xml")
    looked = r"it has no patrol/launch/went.launch or patrol/went.launch, nor went.launch elsewhere in patrol"
    with pytest.raises(DocumentError, match=looked):
        check_launch_files(_spec(tmp_path, _use("mine", "patrol", "went.launch")), tmp_path)


def test_a_ros_package_without_a_robot_is_refused_with_the_robot_that_may_be_copied(tmp_path: Path):
    _ros_package(tmp_path, "patrol/launch/go.launch")
    with pytest.raises(DocumentError, match=r"packageName: 'patrol': .*examples/ros/turtlebot3/robot.xml") as refused:
        check_launch_files(_spec(tmp_path, _use("mine", "patrol", "go.launch")), tmp_path)
    assert len(refused.value.faults) == 1


def test_a_document_from_before_that_says_launch_for_a_module_is_not_refused(tmp_path: Path):
    check_launch_files(_spec(tmp_path, _use("mine", "courier", "go_to_goal.launch")), tmp_path)


def test_a_deployment_may_launch_what_episodes_are_driven_with(tmp_path: Path):
    _ros_package(tmp_path, "patrol/launch/go.launch", "robot.xml")
    use = _use("mine", "patrol", "go.launch")
    deployment = {"fleet": "team", "deploymentApplicationConfigs": [use]}
    check_launch_files(_spec(tmp_path, use, deployment=deployment), tmp_path)


def test_a_launch_file_of_ros_is_no_scenario(tmp_path: Path):
    _ros_package(tmp_path, "patrol/launch/go.launch", "robot.xml")
    spec = _spec(tmp_path, _use("mine", "patrol", "go.launch"))
    document = spec.model_dump(mode="json", exclude_none=True)
    document["applications"].append({"name": "mine", "kind": "simulation", "source": "mine"})
    request = document["simulationBatch"]["createSimulationJobRequests"][0]
    request["simulationApplications"] = [_use("mine", "patrol", "go.launch")]
    with pytest.raises(DocumentError, match=r"'go.launch': a module in mine's bundle; it has no patrol/go.py"):
        check_launch_files(PipelineSpec.model_validate(document), tmp_path)
