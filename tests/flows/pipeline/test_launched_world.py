"""A request without a world runs in that which its simulation application's launch file starts Gazebo with."""

import shutil
from pathlib import Path
from typing import Any

import pytest

from flows.pipeline.references import latest_finder, resolve_references
from flows.pipeline.tested_batch import batch_plan, worldless_fault
from specs.data.world import Start
from specs.errors import DocumentError
from specs.pipeline.document import PipelineSpec
from tasks.ros.launch.packages import RosInstallation
from tasks.simulate.plan.episode_layout import Layout
from tasks.storage.base.store import Store
from tasks.storage.worlds import decode_world, world_bytes
from tests.repository import ROOT
from tests.ros.conftest import ros

__all__ = ["ros"]
pytestmark = pytest.mark.long


@pytest.fixture
def folder(tmp_path: Path, ros: RosInstallation) -> Path:
    shutil.copytree(ROOT / "tests/data/ros/examiner", tmp_path / "bundle/examiner")
    shutil.copy(ROOT / "tests/simulate/bundles/patrol/robot.xml", tmp_path / "bundle/robot.xml")
    return tmp_path


def document(launch_file: str) -> PipelineSpec:
    launch = {"packageName": "examiner", "launchFile": launch_file}
    request: dict[str, Any] = {
        "maxJobDurationInSeconds": 3,
        "simulationApplications": [{"application": "examiner", "launchConfig": launch}],
    }
    return PipelineSpec.model_validate(
        {
            "name": "yard",
            "applications": [{"name": "examiner", "kind": "simulation", "source": "bundle"}],
            "simulationBatch": {"createSimulationJobRequests": [request]},
        }
    )


def test_the_world_is_imported_and_the_spawn_is_its_start(folder: Path, file_store: Store):
    spec = document("gazebo.launch")
    found = resolve_references(spec, file_store, folder).batch
    assert found is not None
    (template,) = found.templates
    (world,) = template.worlds
    assert decode_world(world_bytes(file_store, world)).start == Start(x_m=1.0, y_m=0.5)
    assert (found.worlds_used().keys(), Layout(found).episodes) == ({world}, 1)
    assert spec.simulationBatch is not None
    again = batch_plan(spec.simulationBatch, (), file_store, latest_finder(file_store))
    assert (again.templates[0].worlds, worldless_fault(again)) == (template.worlds, None)


def test_a_document_that_makes_worlds_needs_none_of_a_launch_file(folder: Path, file_store: Store):
    spec = document("alone.launch").model_dump(mode="json", exclude_none=True)
    template = str(ROOT / "examples/templates/two-rooms.json")
    makes = {**spec, "worldGeneration": {"template": template, "worldCount": {"floorplanCount": 1}}}
    found = resolve_references(PipelineSpec.model_validate(makes), file_store, folder).batch
    assert found is not None
    assert not found.world_digests


def test_a_launch_file_without_a_world_is_refused_with_what_to_do(folder: Path, file_store: Store):
    with pytest.raises(DocumentError, match=r"worldConfigs.*alone.launch brings none: it starts no world of Gazebo's"):
        resolve_references(document("alone.launch"), file_store, folder)
